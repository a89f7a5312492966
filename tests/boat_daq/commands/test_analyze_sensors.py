"""One to four sensors through every command that takes a run: figures, reports, calibration, conversion."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.analysis.boat_builder import PAPER, PAPER_NOISE, Plant, Staircase, triangle, write_boat
from tests.boat_daq.commands.calls import call

CUBICS = (*PAPER, (1500.0, 30.0, -1.0, -0.2), (1400.0, 25.0, -2.0, -0.1))
NOISE = (*PAPER_NOISE, 1.2, 1.0)
EVERY_COUNT = [pytest.param(n, n, marks=() if n == 3 else pytest.mark.nightly) for n in (1, 2, 3, 4)]


def plant(sensors: int) -> Plant:
    """An actuator without a loop, with the first so many sensors."""
    return Plant(cubics=CUBICS[:sensors], noise_mv=NOISE[:sensors])


@pytest.fixture
def run(tmp_path: Path, request: pytest.FixtureRequest) -> tuple[Path, Path]:
    """A staircase of that many sensors, and its true readings."""
    stairs = Staircase(plant(request.param), cycles=3, dwell_s=1.0)
    stairs.elongations().to_csv(tmp_path / "readings.csv", index=False)
    return write_boat(tmp_path / "run.boat", stairs.recording(), meta={"unit": "U1"}), tmp_path / "readings.csv"


@pytest.mark.parametrize(("run", "sensors"), EVERY_COUNT, indirect=["run"])
def test_signals_are_converted_by_all_sensors(run: tuple[Path, Path], sensors: int, tmp_path: Path) -> None:
    """Each sensor is calibrated; fused, they give the true elongation of other signals within its U."""
    path, readings = run
    made, out = tmp_path / "calibration.json", tmp_path / "converted.csv"
    call("calibration", path, "--elongation", readings, "--format", "json", "--out", made)
    assert [s["name"] for s in json.loads(made.read_text(encoding="utf-8"))["sensors"]] == [
        f"s{n}" for n in range(1, sensors + 1)
    ]
    pressure, loading, cycle = triangle(1, 8.0)[:3]
    exact = replace(plant(sensors), noise_mv=(0.0,) * sensors)
    other = write_boat(tmp_path / "other.boat", exact.run(pressure, loading, cycle), meta={"unit": "U1"})
    call("convert", other, "--calibration", made, "--out", out)
    converted = pd.read_csv(out, comment="#")
    inside = np.abs(pressure - 5.0) < 44.0
    apart = np.abs(converted.elongation_mm - exact.elongation(pressure, loading))[inside]
    assert len(converted) == len(pressure)
    assert (apart <= converted.u_mm[inside]).all()


@pytest.mark.nightly
@pytest.mark.parametrize(("run", "sensors"), [(n, n) for n in (1, 2, 3, 4)], indirect=["run"])
def test_reports_name_every_sensor(run: tuple[Path, Path], sensors: int, tmp_path: Path) -> None:
    """Calibration and continuous cycles, HTML and PDF; strokes, several runs, the shadow, artefacts, export."""
    path, readings = run
    pressure, loading, cycle = triangle(12, 8.0)[:3]
    cycles = write_boat(tmp_path / "cycles.boat", plant(sensors).run(pressure, loading, cycle), meta={"unit": "U1"})
    for name, words in (("run", (path, "--elongation", readings)), ("cycles", (cycles,)), ("both", (path, cycles))):
        call("report", *words, "--no-mcmc", "--out", tmp_path / f"{name}.html")
        text = (tmp_path / f"{name}.html").read_text(encoding="utf-8").lower()
        assert [f"sensor {n}" in text for n in range(1, 5)] == [n <= sensors for n in range(1, 5)], name
        call("report", *words, "--no-mcmc", "--out", tmp_path / f"{name}.pdf")
        assert (tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    call("strokes", cycles)
    call("shadow", "replay", cycles, "--calibration", path, "--elongation", readings)
    for suffix in ("c", "matlab", "csv"):
        call("calibration", path, "--elongation", readings, "--format", suffix, "--out", tmp_path / f"made.{suffix}")
    call("export", path, "--format", "csv", "--out", tmp_path / "samples.csv")
    header = pd.read_csv(tmp_path / "samples.csv", comment="#", nrows=1).columns
    assert [f"s{n}_mv" in header for n in range(1, 5)] == [n <= sensors for n in range(1, 5)]
