"""`boat-daq calibration`: the calibration of a run in every format, and what is refused."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis import load_recording
from analysis.calibration_export.calibration_file import CalibrationFile, read_calibration
from analysis.calibration_export.forms import calibration_text
from boat_daq.engine.simulator.server import BoardSettings
from tests.boat_daq.commands.calls import call, exit_code, program, refusal
from tests.boat_daq.engine.served_board import serve_in_thread


def test_calibration_is_written_as_code(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A header of the run's one sensor, and what is noted of it."""
    target = tmp_path / "calibration.h"
    found = call("calibration", stairs[0], "--elongation", stairs[1], "--format", "h", "--out", target)
    assert (found["file"], found["format"], found["sensors"], found["void"]) == (str(target), "h", 1, "")
    assert any("not traceable" in note for note in found["notes"])
    assert target.read_text(encoding="ascii").startswith("/*\n * SIMULATED calibration of unit SA1")


def test_json_goes_to_standard_output_and_is_read_again(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """The notes are on standard error; the coefficients are those of the fit; the other forms are of the same value."""
    ended = program("calibration", stairs[0], "--elongation", stairs[1], "--format", "json", "--degree", "2")
    assert ended.code == 0
    assert "note: an elongation is not traceable" in ended.err
    content = json.loads(ended.out)
    assert len(content["sensors"][0]["fit"]["coefficients"]) == 3
    (tmp_path / "c.json").write_text(ended.out)
    again = read_calibration(tmp_path / "c.json")
    assert calibration_text(again, "json") == ended.out
    assert calibration_text(again, "matlab").startswith("function [elongation_mm, u_mm, flags]")
    assert calibration_text(again, "csv", 0.01).startswith("# SIMULATED calibration")
    assert "typedef float boat_real" in calibration_text(again, "c", 0.01)


def test_run_without_calibration_is_refused(stairs: tuple[Path, Path]) -> None:
    """Cause and remedy; a format or a bound that does not exist is a usage error."""
    assert "not a calibration" in refusal("calibration", stairs[0], "--format", "c").cause
    assert exit_code("calibration", stairs[0], "--format", "pascal") == 2
    assert exit_code("calibration", stairs[0], "--format", "json", "--table-error", "0.1") == 2


@pytest.fixture(scope="module")
def calibrated(stairs: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CalibrationFile]:
    """Return the calibration of the run of one sensor, as a file and as a value."""
    target = tmp_path_factory.mktemp("calibrated") / "c.json"
    call("calibration", stairs[0], "--elongation", stairs[1], "--format", "json", "--out", target)
    return target, read_calibration(target)


def test_file_is_converted_sample_by_sample(
    stairs: tuple[Path, Path], calibrated: tuple[Path, CalibrationFile], tmp_path: Path
) -> None:
    """Every row has the elongation and U of `Fusion`; the head states SIMULATED and the calibration."""
    target = tmp_path / "x.csv"
    found = call("convert", stairs[0], "--calibration", calibrated[0], "--out", target)
    rows = pd.read_csv(target, comment="#")
    recording = load_recording(stairs[0])
    expected = calibrated[1].reader().evaluate(recording.signal_mv)
    assert found["samples"] == len(rows) == recording.n
    assert found["valid"] == int(rows["valid"].sum()) > 0.9 * len(rows)
    np.testing.assert_allclose(rows["elongation_mm"], expected.elongation_mm, rtol=1e-12)
    np.testing.assert_allclose(rows["u_mm"], 2 * expected.standard_uncertainty_mm, rtol=1e-12)
    assert target.read_text().startswith("# SIMULATED\n# converted by: SIMULATED calibration of unit SA1")


def test_table_of_signals_needs_no_pressure(calibrated: tuple[Path, CalibrationFile], tmp_path: Path) -> None:
    """Time and signal suffice, on standard output; outside the range the cells are empty and the row is not valid."""
    inside = float(calibrated[1].reader().inverses[0].nodes[100])
    (tmp_path / "s.csv").write_text(f"# simulated: true\ntime_s,s1_mv\n0,{inside}\n0.5,9000\n1,\n")
    ended = program("convert", tmp_path / "s.csv", "--calibration", calibrated[0])
    assert ended.code == 0, ended.err
    rows = pd.read_csv(io.StringIO(ended.out), comment="#")
    assert rows["valid"].tolist() == [1, 0, 0]
    assert rows["elongation_mm"].isna().tolist() == [False, True, True]
    assert "3 samples, 1 with a valid elongation" in ended.err
    (tmp_path / "s.csv").write_text(f"# simulated: true\n# unit: SB9\ntime_s,s1_mv\n0,{inside}\n1,{inside}\n")
    assert (
        "of unit SB9, the calibration is of SA1"
        in program("convert", tmp_path / "s.csv", "--calibration", calibrated[0]).err
    )


def test_calibration_of_the_other_kind_or_unit_is_refused(
    calibrated: tuple[Path, CalibrationFile], tmp_path: Path
) -> None:
    """Signals of a real board, or of two sensors, by a calibration of one simulated sensor; a file that is none."""
    for content, cause in (
        ("time_s,s1_mv\n0,1600\n1,1600\n", "real board are not converted"),
        ("# simulated: true\ntime_s,s1_mv,s2_mv\n0,1600,1600\n1,1,1\n", "those of 2 sensors"),
    ):
        (tmp_path / "s.csv").write_text(content)
        assert cause in refusal("convert", tmp_path / "s.csv", "--calibration", calibrated[0]).cause
    assert "not a calibration" in refusal("convert", tmp_path / "s.csv", "--calibration", tmp_path / "s.csv").cause
    assert exit_code("convert", "--calibration", calibrated[0]) == 2


def test_signals_are_converted_live(tmp_path: Path) -> None:
    """Samples of a board become rows until the duration is over; a calibration of one sensor is refused for two."""
    run = Path(__file__).resolve().parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"
    call("calibration", run, "--format", "json", "--out", tmp_path / "c.json")
    with serve_in_thread(BoardSettings(speed=20.0)) as board:
        ended = program("convert", "--port", board.url, "--calibration", tmp_path / "c.json", "--duration", "2")
    assert ended.code == 0, ended.err
    rows = pd.read_csv(io.StringIO(ended.out), comment="#")
    assert len(rows) == 200
    assert rows["time_s"].iloc[-1] == pytest.approx(1.99)
    assert rows["elongation_mm"].abs().max() < 0.2
    assert rows["valid"].all()
