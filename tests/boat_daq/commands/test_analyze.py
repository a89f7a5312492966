"""`boat-daq analyze`: the figures of a run, and of its exported and imported copy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.boat_daq.commands.calls import call, exit_code


def test_exported_and_imported_copy_has_the_same_figures(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A run exported to CSV and imported again gives the same calibration and stays marked as simulated."""
    boat, readings = stairs
    options = ("--elongation", readings, "--no-mcmc", "--no-shadow")
    first = call("analyze", boat, "--no-store", *options)
    assert first["cycles"]["complete"] == 2
    call("export", boat, "--format", "csv", "--out", tmp_path / "r.csv")
    call("import", tmp_path / "r.csv", "--out", tmp_path / "again.boat")
    again = call("analyze", tmp_path / "again.boat", *options)
    assert first["simulated"] is again["simulated"] is True
    for a, b in zip(first["sensors"], again["sensors"], strict=True):
        np.testing.assert_allclose(a["calibration"]["coefficients"], b["calibration"]["coefficients"], rtol=1e-9)


def test_degree_names_the_curve_and_refuses_another(stairs: tuple[Path, Path]) -> None:
    """A line, the spline, and a word that is no curve: two curves, and the exit code of a wrong option."""
    boat, readings = stairs
    options = ("--elongation", readings, "--no-mcmc", "--no-shadow", "--no-store")
    line, spline = (call("analyze", boat, *options, "--degree", curve) for curve in ("1", "spline"))
    assert [sensor["calibration"]["curve"] for sensor in line["sensors"]] == ["1"]
    assert [sensor["calibration"]["coefficients"] for sensor in spline["sensors"]] == [[]]
    assert {sensor["adequacy"]["verdict"] for sensor in line["sensors"]} == {"inadequate"}
    assert exit_code("analyze", boat, *options, "--degree", "cubic") == 2
