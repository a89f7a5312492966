"""Signals that are no measurement: clipped, frozen, dropped out; and sound ones left alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from tests.analysis.boat_builder import Plant, Staircase, triangle
from tests.conftest import mostly_at_night

QUICK = Options(mcmc=False)


def changed(recording: Recording, rows: slice, sensor: int, value: float) -> Recording:
    """The run with one sensor's rows set to a value."""
    signal = recording.signal_mv.copy()
    signal[rows, sensor] = value
    return Recording.from_arrays(recording.time_s, recording.pressure_kpa, signal)


def test_a_clipped_csv_signal_is_left_out_with_its_count() -> None:
    """Cut off at 1,650 mV for half the run: sensor 1 has no figures and names the reason, sensor 2 keeps its own."""
    run = Plant().run(*triangle(4, 20))
    cut = Recording.from_arrays(run.time_s, run.pressure_kpa, np.minimum(run.signal_mv, [1650.0, 9999.0]))
    at_rail = int((cut.signal_mv[:, 0] == 1650.0).sum())
    whole, found = analyse(run, options=QUICK), analyse(cut, options=QUICK)
    assert found.recording.masked["clipped"] == at_rail
    assert whole.recording.masked["clipped"] == 0
    assert "standing" in found.sensors[0].figures["system_hysteresis_percent_fso"].void
    assert np.isnan(found.sensors[0].figures["fso_mv"].value)
    kept, before = (a.sensors[1].figures["system_hysteresis_percent_fso"] for a in (found, whole))
    assert kept.value == pytest.approx(before.value, rel=1e-9)


def test_a_clipped_plateau_voids_that_sensor_alone(tmp_path: Path) -> None:
    """A staircase clipped above +45 kPa: sensor 1's fit ends at the level below, sensor 2's at the top."""
    stairs = Staircase()
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    run = stairs.recording()
    cut = Recording.from_arrays(run.time_s, run.pressure_kpa, np.minimum(run.signal_mv, [1760.0, 9999.0]))
    found = analyse(cut, tmp_path / "e.csv", options=QUICK)
    ends = [sensor.calibration.x_range[1] for sensor in found.sensors if sensor.calibration is not None]
    assert ends[0] < 3.7
    assert ends[1] == pytest.approx(3.8)
    void = [w.sentence for w in found.warnings if w.code == "void"]
    assert any("(+50 kPa, " in text for text in void)
    assert all(" of s1" in text and " of s2" not in text for text in void)


@pytest.mark.parametrize("value", [0.0, np.nan, 3300.0])
def test_drop_outs_are_left_out_with_a_count(value: float) -> None:
    """Forty samples of sensor 1 gone to zero, to nothing, to the rail: counted, and the figures stay."""
    run = Plant().run(*triangle(6, 20))
    rows = np.r_[700:720, 3333:3353]
    broken = analyse(changed(run, rows, 0, value), options=QUICK)  # type: ignore[arg-type]
    masked = broken.recording.masked
    assert masked["dropped_out"] + masked["signal_not_finite"] + masked["clipped"] == 40
    window = broken.sensors[0].figures["snr_db"].window
    assert window is not None
    assert window.damaged == 40
    whole = analyse(run, options=QUICK)
    for name in ("fso_mv", "noise_mv", "system_hysteresis_percent_fso"):
        figure, before = (a.sensors[0].figures[name] for a in (broken, whole))
        assert figure.value == pytest.approx(before.value, rel=0.02), name


@pytest.mark.parametrize("value", mostly_at_night(200.0, -300.0))
def test_a_pressure_that_drops_out_cuts_no_hold_in_two(tmp_path: Path, value: float) -> None:
    """Four samples of a loose wire within a hold: counted, left out, and the readings still find their plateaus."""
    stairs = Staircase(cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    run = stairs.recording()
    pressure = run.pressure_kpa.copy()
    first, last = stairs.trace()[3][7]
    pressure[(first + last) // 2 + np.arange(4)] = value
    broken = Recording.from_arrays(run.time_s, pressure, run.signal_mv)
    found = [analyse(one, tmp_path / "e.csv", options=QUICK) for one in (run, broken)]
    assert [one.recording.masked["pressure_dropped_out"] for one in found] == [0, 4]
    assert len(found[0].plateaus) == len(found[1].plateaus)
    for whole, cut in zip(found[0].sensors, found[1].sensors, strict=True):
        assert whole.calibration is not None
        assert cut.calibration is not None
        assert cut.calibration.coefficients == pytest.approx(whole.calibration.coefficients, rel=1e-2)
    assert "pressure_dropped_out" in {warning.code for warning in found[1].warnings}


def test_a_frozen_channel_is_left_out() -> None:
    """Two whole cycles of eight at one value: those cycles carry nothing, the others all."""
    run = Plant().run(*triangle(8, 20))
    found = analyse(changed(run, slice(4000, 8000), 0, 1600.0), options=QUICK)
    assert found.recording.masked["frozen"] == 4000
    assert np.isfinite(found.loops.signal_mv[0]).any(axis=(0, 2)).tolist() == [k not in (2, 3) for k in range(8)]
    assert np.isfinite(found.loops.signal_mv[1]).any(axis=(0, 2)).all()


def test_quiet_and_coarse_signals_are_no_faults() -> None:
    """Neither a staircase without noise nor one rounded to 5 mV is clipped, frozen or dropped out."""
    clean = Staircase(Plant(noise_mv=(0.0, 0.0))).recording()
    coarse = Recording.from_arrays(clean.time_s, clean.pressure_kpa, 5.0 * np.round(clean.signal_mv / 5.0))
    for run in (clean, coarse, Staircase().recording()):
        masked = analyse(run, options=QUICK).recording.masked
        assert [masked[name] for name in ("clipped", "frozen", "dropped_out")] == [0, 0, 0]


@pytest.mark.parametrize("seconds", [1.2, 8.0, 60.0])
def test_noise_at_rest_is_no_fault(seconds: float) -> None:
    """Whole counts of 1.9 counts' noise, a pressure that only flutters: nothing is clipped, frozen or dropped out."""
    n = round(100 * seconds)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        signal = 0.8 * np.round(rng.normal(2000.0, 1.9, (n, 2)))
        run = Recording.from_arrays(np.arange(n) / 100, rng.normal(0.0, 0.05, n), signal)
        masked = analyse(run, options=QUICK).recording.masked
        assert [masked[name] for name in ("clipped", "frozen", "dropped_out")] == [0, 0, 0]
