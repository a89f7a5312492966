"""`boat-daq calibration`: the calibration of a run in every format, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.artefact.calibration_file import read_calibration
from boat_daq.commands.calibration import written
from tests.boat_daq.commands.calls import call, exit_code, program, refusal


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
    assert written(again, "json") == ended.out
    assert written(again, "matlab").startswith("function [elongation_mm, u_mm, flags]")
    assert written(again, "csv", 0.01).startswith("# SIMULATED calibration")
    assert "typedef float boat_real" in written(again, "c", 0.01)


def test_run_without_calibration_is_refused(stairs: tuple[Path, Path]) -> None:
    """Cause and remedy; a format or a bound that does not exist is a usage error."""
    assert "no calibration" in refusal("calibration", stairs[0], "--format", "c").cause
    assert exit_code("calibration", stairs[0], "--format", "pascal") == 2
    assert exit_code("calibration", stairs[0], "--format", "json", "--table-error", "0.1") == 2
