"""The calibrations of a unit over time: their order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.history.unit_history import en_scores, unit_history
from tests.analysis.boat_builder import Plant, Staircase


def test_calibrations_are_in_the_order_of_their_instants(tmp_path: Path) -> None:
    """02:30 summer time is before 02:10 winter time, forty minutes later; one of unknown time is first."""
    times = ("2026-10-25T02:10:00+01:00", "2026-10-25T02:30:00+02:00", "2026-10-25T01:00:00+00:00", "")
    analyses = []
    for k, when in enumerate(times):
        stairs = Staircase(Plant(cubics=((1000.0 + 10 * k, 40.0, 0.0, 0.0),), noise_mv=(0.1,)), cycles=1)
        stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
        recording = stairs.recording(meta={"started_utc": when, "uuid": str(k)})
        analyses.append(analyse(recording, tmp_path / "e.csv", options=Options(mcmc=False)))
    history = unit_history(analyses, 0)
    assert history.when == tuple(times[k] for k in (3, 1, 2, 0))
    assert history.value_mv == pytest.approx([1030.0, 1010.0, 1020.0, 1000.0], abs=0.5)


def test_en_score_by_hand() -> None:
    """(10 - 7) / sqrt(3^2 + 4^2) = 0.6."""
    scores = en_scores(np.asarray([7.0, 10.0]), np.asarray([3.0, 4.0]))
    assert np.isnan(scores[0])
    assert scores[1] == pytest.approx(0.6)
