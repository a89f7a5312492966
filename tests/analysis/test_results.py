"""Results kept in a recording: when one can be computed again from the recording alone."""

from __future__ import annotations

import sqlite3
from dataclasses import asdict
from pathlib import Path

import pytest

from analysis import Options, analyse
from analysis.results import reproduce, store_analysis
from tests.analysis.boat_builder import Staircase, write_boat


@pytest.mark.parametrize(
    ("read_utc", "corrected"),
    [
        ("2026-07-01T12:59:59.999+02:00", False),  # 10:59:59.999 UTC, a millisecond before the result
        ("2026-07-01T13:00:00.001+02:00", True),
        ("2026-07-01T05:59:59.999-05:00", False),
        ("2026-07-01T06:00:00.001-05:00", True),
        ("2026-07-01T10:59:59.999+00:00", False),
        ("2026-07-01T11:00:00.001+00:00", True),
    ],
)
def test_a_reading_is_newer_than_a_result_by_its_instant(tmp_path: Path, read_utc: str, corrected: bool) -> None:
    """Readings carry the offset of where they were read, results are in UTC: as text they do not compare."""
    run = write_boat(tmp_path / "run.boat", Staircase(cycles=1).recording())
    analysis = analyse(run, options=Options(mcmc=False))
    assert store_analysis(run, analysis) == ""
    with sqlite3.connect(run) as db:
        db.execute("UPDATE result SET utc = '2026-07-01T11:00:00.000000+00:00'")
        insert = "INSERT INTO reading (utc, step, elongation_mm, source) VALUES (?, 99, 1.0, 'test')"
        db.execute(insert, (read_utc,))
    db.close()
    again = reproduce(run, 1, {"options": asdict(analysis.options)})
    assert (again is None) == corrected
