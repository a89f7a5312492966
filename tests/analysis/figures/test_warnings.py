"""Warnings of a run and its sensors: code, subject, and what the text names."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np

from analysis import Options, Recording, analyse
from tests.analysis.boat_builder import Plant, Staircase, triangle, write_boat

QUICK = Options(mcmc=False, x_resolution_mm=0.0)


def elongation_file(stairs: Staircase, folder: Path) -> Path:
    """The exact elongations of a staircase as a file."""
    path = folder / "elongation.csv"
    stairs.elongations().to_csv(path, index=False)
    return path


def test_a_warning_of_a_reading_names_its_plateau_with_units(tmp_path):
    """A millimetre too much at one plateau: value, pressure, branch, cycle and the signal's unit are in its warning."""
    stairs = Staircase(cycles=2)
    table = stairs.elongations()
    row = len(table) - 5  # the last cycle ends at its highest pressure: loading
    table.loc[row, "elongation_mm"] += 1.0
    table.to_csv(tmp_path / "e.csv", index=False)
    found = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False, x_resolution_mm=0.0))
    text = next(w.text for w in found.warnings if w.code == "outlier" and w.subject == "s1")
    pressure, x = table.loc[row, "pressure_kpa"], table.loc[row, "elongation_mm"]
    assert f"the reading {x:+.2f} mm at {pressure:+.0f} kPa, loading, cycle 2 is " in text
    assert " mV off the curve" in text


def test_a_signal_constant_while_pressure_changes_is_warned_of() -> None:
    """A CSV has no saturation flag: a signal cut off at 1,650 mV is flagged with its share; a whole one is not."""
    run = Plant().run(*triangle(4, 20))
    cut = Recording.from_arrays(run.time_s, run.pressure_kpa, np.minimum(run.signal_mv, [1650.0, 9999.0]))
    texts = [w.sentence for w in analyse(cut, mcmc=False).warnings if w.code == "flat"]
    assert len(texts) == 1
    assert texts[0].startswith("s1")
    assert not [w for w in analyse(run, mcmc=False).warnings if w.code == "flat"]


def test_frames_that_failed_their_crc_are_counted_apart(tmp_path: Path) -> None:
    """The link's counter over two connections grows by 3 and by 2: five frames; 7 from before do not count."""
    path = write_boat(tmp_path / "a.boat", Staircase(cycles=1).recording())
    with sqlite3.connect(path) as db:
        for count in (7, 10, 0, 2):
            db.execute(
                "INSERT INTO health (host_ns, bytes, frames, samples, lost, crc_errors, malformed, oversize,"
                " duplicates, unknown) VALUES (0, 0, 0, 0, 0, ?, 0, 0, 0, 0)", (count,),
            )  # fmt: skip
    db.close()
    found = analyse(path, options=QUICK)
    assert found.to_json()["crc_errors"] == 5
    assert next(w.sentence for w in found.warnings if w.code == "crc_errors").startswith("5 frames")


def test_a_constant_signal_has_its_own_warning(tmp_path: Path) -> None:
    """One value in all samples of one sensor: reported with the value and the count, and of that sensor alone."""
    stairs = Staircase(cycles=1)
    run = stairs.recording()
    signal = run.signal_mv.copy()
    signal[:, 1] = 1650.0
    constant = Recording.from_arrays(run.time_s, run.pressure_kpa, signal)
    found = analyse(constant, elongation_file(stairs, tmp_path), options=QUICK)
    texts = [w.sentence for w in found.warnings if w.code == "constant_signal"]
    assert len(texts) == 1
    assert f"the signal is constant, 1650 mV in all {run.n} samples" in texts[0]
    assert texts[0].startswith(found.sensors[1].name)
    assert np.isfinite(found.sensors[0].figures["snr_db"].value)
    assert not np.isfinite(found.sensors[1].figures["snr_db"].value)
