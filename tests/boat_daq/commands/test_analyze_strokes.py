"""`boat-daq strokes`: strokes and loops of a continuous run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.data.csv_table import read_table
from analysis.segmentation.strokes import crossings, thresholds
from protocol.base.errors import DataError
from tests.analysis.segmentation.drives import half_widths
from tests.boat_daq.commands.calls import call


def _loop(
    folder: Path, *, period_s: float = 10.0, cycles: int = 10, rate_hz: float = 200.0, noise_mv: float = 0.0
) -> Path:
    """Write a triangle of pressure and a signal of 5 mV/kPa with branches 8 mV apart, 1.6 kPa."""
    time_s = np.arange(0.0, cycles * period_s, 1.0 / rate_hz)
    phase = (time_s / period_s) % 1.0
    pressure = 45.0 * (1.0 - 4.0 * np.abs(phase - 0.5)) + 5.0
    noise = np.random.default_rng(0).normal(0.0, noise_mv, time_s.size)
    signal = 5.0 * pressure + np.where(phase < 0.5, -4.0, 4.0) + noise
    rows, file = np.column_stack([time_s, pressure, signal]), folder / "loop.csv"
    np.savetxt(file, rows, delimiter=",", header="time_s,pressure_kpa,s1_mv", comments="")
    return file


def test_triangular_drive_gives_its_loop(tmp_path: Path) -> None:
    """A signal of 5 mV/kPa with branches 8 mV apart: half width 4 mV, friction 0.8 kPa, area from the rectangle."""
    found = call("strokes", _loop(tmp_path))
    assert (found["strokes_up"], found["strokes_down"], found["cycles"]) == (10, 10, 9)
    assert found["period_s"]["mean"] == pytest.approx(10.0, abs=0.01)
    (sensor,) = found["sensors"]
    # a sample more or less at an edge of the middle part: half a step of 0.09 kPa or 0.45 mV
    assert sensor["half_width_mv"]["mean"] == pytest.approx(4.0, abs=0.23)
    assert sensor["friction_kpa"]["mean"] == pytest.approx(0.8, abs=0.045)
    assert sensor["loop_area_kpa_mv"]["mean"] == pytest.approx(8.0 * 90.0, rel=0.02)


def test_noise_of_the_signal_does_not_turn_the_drive_round(tmp_path: Path) -> None:
    """Branches 1.6 kPa apart, and noise far above the signal's step from sample to sample: friction 0.8 kPa."""
    (sensor,) = call("strokes", _loop(tmp_path, noise_mv=3.0))["sensors"]
    assert sensor["friction_kpa"]["mean"] == pytest.approx(0.8, abs=0.06)
    assert sensor["half_width_mv"]["mean"] == pytest.approx(4.0, abs=0.3)


PUBLISHED = ("Circle_3bar", "Circle_4bar", *(f"O-ring257_{bar}bar" for bar in (1, 3, 5, 7)))


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_strokes_are_reproduced(shared_data: Path, name: str) -> None:
    """An actuator driven by displacement, imported by its columns: the independent reference within 1 %.

    Its force passes the middle only where the stroke turns: along the drive the loop is as wide as the stroke there,
    and half of that is what is reported.
    """
    folder = shared_data / "zillen_pneumatic"
    truth = json.loads((folder / "expected.json").read_text())["files"][f"{name}.csv"]
    columns = ("--map", "time_s=1:ms", "--map", "pressure_kpa=5", "--map", "s1_mv=7")
    found = call("strokes", folder / f"{name}.csv", *columns, "--min-speed", 2)
    assert (found["strokes_up"], found["strokes_down"]) == (truth["upstrokes"], truth["downstrokes"])
    assert found["span_kpa"] == pytest.approx(truth["stroke_p1_p99"], rel=0.001)
    (sensor,) = found["sensors"]
    table = read_table(folder / f"{name}.csv").columns
    up, _ = crossings(table[4], *thresholds(table[4]))
    right = half_widths(table[0] / 1000, table[4], table[6], up)
    assert (sensor["half_width_mv"]["mean"], sensor["half_width_mv"]["sd"]) == pytest.approx(right, rel=0.01)
    assert sensor["loop_area_kpa_mv"]["mean"] == pytest.approx(truth["loop_area_mean_Nmm"], rel=0.001)
    assert 0.48 * found["span_kpa"] < sensor["friction_kpa"]["mean"] < 0.51 * found["span_kpa"]


def test_held_pressure_with_its_ripple_is_refused(tmp_path: Path) -> None:
    """A ripple of 0.3 kPa is no stroke, whatever the signal does."""
    time_s = np.arange(0.0, 60.0, 0.01)
    rows = np.column_stack([time_s, 20 + 0.3 * np.sin(time_s), 1600 + np.sin(time_s)])
    np.savetxt(tmp_path / "held.csv", rows, delimiter=",", header="time_s,pressure_kpa,s1_mv", comments="")
    with pytest.raises(DataError, match="nothing was driven"):
        call("strokes", tmp_path / "held.csv")


def test_constant_pressure_is_refused(tmp_path: Path) -> None:
    """A run without strokes has no loop."""
    rows = [f"{n},10,{1600 + n % 3}" for n in range(50)]
    (tmp_path / "still.csv").write_text("\n".join(["time_s,pressure_kpa,s1_mv", *rows]))
    with pytest.raises(DataError, match="does not move"):
        call("strokes", tmp_path / "still.csv")
