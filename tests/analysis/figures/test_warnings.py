"""Warnings of a run and its sensors: code, subject, and what the text names."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from analysis.segmentation.plateaus import PlateauSettings
from analysis.studies.failure_maps.figures import Stairs
from analysis.warning import WarningCode
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
    (text,) = (w.text for w in found.warnings if w.code == "outlier")
    pressure, x = table.loc[row, "pressure_kpa"], table.loc[row, "elongation_mm"]
    place = f"check the reading {x:+.2f} mm at {pressure:+.0f} kPa, loading, cycle 2"
    assert text == f"{place}, 1.0 mm from the others (sensor 1, sensor 2)"


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
    with closing(sqlite3.connect(path)) as db, db:
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


def codes(recording: Recording) -> list[str]:
    """Return the codes of a run's warnings."""
    return [str(w.code) for w in analyse(recording, options=QUICK).warnings]


def test_run_that_nothing_drove_has_no_figures_and_a_warning() -> None:
    """A ripple of 0.3 kPa: no cycle, every figure void with the reason not_driven, one warning with the span."""
    time = np.arange(0.0, 200.0, 0.01)
    pressure = 0.3 * np.sin(2 * np.pi * time / 20)
    found = analyse(Plant().run(pressure, np.gradient(pressure) > 0, np.zeros(time.size)), options=QUICK)
    assert found.cycles.as_json() == {"complete": 0, "partial": 0, "with_gap": 0}
    assert {f.reason for s in found.sensors for f in s.figures.values()} == {"not_driven"}
    assert not [f for s in found.sensors for f in s.figures.values() if np.isfinite(f.value)]
    assert [str(w.code) for w in found.warnings] == ["not_driven", "no_cycle"]


def test_excursions_left_out_are_one_warning_with_their_count() -> None:
    """Twenty dips of 30 kPa in ten cycles, one of them of 40: one warning, which counts them and names the widest."""
    time = np.arange(0.0, 300.0, 0.01)
    pressure = 5 + 45 * np.cos(2 * np.pi * time / 30)
    for at in np.arange(7.5, 300.0, 15.0):
        dip = np.abs(time - at) < 1.5
        pressure = pressure - np.where(dip, (40.0 if at == 7.5 else 30.0) * np.cos(np.pi * (time - at) / 3), 0.0)
    found = analyse(Plant().run(pressure, np.gradient(pressure) > 0, np.zeros(time.size)), options=QUICK)
    texts = [w.text for w in found.warnings if w.code == "excursion_left_out"]
    assert len(found.cycles.excursions) == 20
    assert len(texts) == 1
    assert texts[0].startswith("20 reversals are too small to be a cycle, the widest from ")


def test_loop_wider_than_the_full_scale_output_is_marked() -> None:
    """A signal that follows the branch and hardly the pressure: 3,300 % FSO, with the code no_span."""
    time = np.arange(0.0, 200.0, 0.01)
    pressure = 5 + 45 * np.cos(2 * np.pi * time / 20)
    bow = 30 * np.sign(np.gradient(pressure)) * (1 - ((pressure - 5) / 45) ** 2)
    noise = 0.05 * np.random.default_rng(0).standard_normal(time.size)
    recording = Recording.from_arrays(time, pressure, (1600 + 0.02 * pressure + bow + noise)[:, None])
    figure = analyse(recording, options=QUICK).sensors[0].figures["system_hysteresis_percent_fso"]
    assert figure.value > 1000
    assert figure.reason == "wider_than_full_scale"
    assert "no_span" in codes(recording)
    assert "no_span" not in codes(Plant().run(pressure, np.gradient(pressure) > 0, np.zeros(time.size)))


@pytest.mark.parametrize(("tolerance_kpa", "lost"), [(1.0, False), (4.5, False), (5.0, True), (12.0, True)])
def test_a_tolerance_as_wide_as_half_a_step_is_warned_of(tolerance_kpa: float, lost: bool) -> None:
    """A staircase of 10 kPa: no plateau is left from 5 kPa on, which is reported with the step."""
    options = replace(QUICK, plateau=PlateauSettings(tolerance_kpa))
    found = analyse(Stairs().recording(), options=options)
    texts = [warning.text for warning in found.warnings if warning.code is WarningCode.TOLERANCE_TOO_WIDE]
    assert len(found.plateaus) == (0 if lost else 37)
    assert texts == (
        [
            f"37 of 37 plateaus are not found: the tolerance of {tolerance_kpa:g} kPa is half of a step of 10 kPa or "
            "more; give one well below that half"
        ]
        if lost
        else []
    )


def test_a_wave_without_plateaus_loses_none_to_the_tolerance() -> None:
    """A continuous run has no plateaus at any tolerance."""
    time_s = np.arange(0.0, 120.0, 0.01)
    wave = np.cos(time_s / 2.0)
    found = analyse(
        Recording.from_arrays(time_s, 5.0 + 45.0 * wave, 1600.0 + 100.0 * wave),
        options=replace(QUICK, plateau=PlateauSettings(5.0)),
    )
    assert WarningCode.TOLERANCE_TOO_WIDE not in {warning.code for warning in found.warnings}
