"""`boat-daq analyze`: the figures of a run, and of its exported and imported copy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.boat_daq.commands.calls import call, exit_code, text


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
    options = ("--elongation", readings, "--no-mcmc", "--no-shadow", "--no-store", "--x-resolution", 0)
    line, spline = (call("analyze", boat, *options, "--degree", curve) for curve in ("1", "spline"))
    assert [sensor["calibration"]["curve"] for sensor in line["sensors"]] == ["1"]
    assert [sensor["calibration"]["coefficients"] for sensor in spline["sensors"]] == [[]]
    assert {sensor["adequacy"]["verdict"] for sensor in line["sensors"]} == {"inadequate"}
    assert exit_code("analyze", boat, *options, "--degree", "cubic") == 2


def test_text_output_names_the_reason_of_every_undefined_figure(stairs: tuple[Path, Path]) -> None:
    """Without readings there is no sensitivity and no actuator hysteresis: the text gives the reason of both."""
    shown = text("analyze", stairs[0], "--no-mcmc", "--no-shadow", "--no-store")
    assert "Undefined for system: no elongation was read (hysteresis, actuator)." in shown
    assert "not every sensor is calibrated (sensitivity, system)." in shown


def test_limits_and_contributions_are_in_the_result(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A limit of the user and the published ones with conformity; a rig's parallax in the budget; traceability."""
    boat, readings = stairs
    (tmp_path / "rig.toml").write_text("[type_b.parallax]\nhalf_width_mm = 0.1\ndistribution = 'rectangular'\n")
    options = ("--elongation", readings, "--no-mcmc", "--no-shadow", "--no-store", "--type-b", tmp_path / "rig.toml")
    found = call("analyze", boat, *options, "--limit", "snr=40")
    stated = {(c["name"], c["sensor"]): c for c in found["conformity"]}
    assert stated["snr", "s1"]["conformity"] == "pass"
    assert stated["snr", "s1"]["source"] == "set by the user"
    assert stated["system_hysteresis_percent_fso", "s1"]["limit"] == 5.0
    budget = found["elongation_budget"]["sensors"][0]
    lines = {line["name"]: line for line in budget["components"]}
    assert lines["parallax"]["u_mm"] == pytest.approx(0.1 / 3**0.5)
    assert lines["temperature"]["u_mm"] is None
    assert budget["traceable"] is False
    shown = text("analyze", boat, *options, "--limit", "snr=40")
    assert "no uncertainty is given for scale of grid or photograph, pressure gauge, temperature" in shown
    assert "pass: signal-to-noise ratio, sensor 1: " in shown
    assert exit_code("analyze", boat, *options, "--limit", "snr") == 2


def test_a_wrong_reading_is_left_out_on_request(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A reading 1 mm off is named and used; with --leave-out it is not used."""
    boat, readings = stairs
    rows = readings.read_text().splitlines()
    head, row = rows[0].split(","), rows[12].split(",")
    at = head.index("elongation_mm")
    row[at] = str(float(row[at]) + 1.0)
    (tmp_path / "wrong.csv").write_text("\n".join([*rows[:12], ",".join(row), *rows[13:]]) + "\n")
    options = ("--elongation", tmp_path / "wrong.csv", "--no-mcmc", "--no-shadow", "--no-store", "--x-resolution", 0)
    used, left = call("analyze", boat, *options), call("analyze", boat, *options, "--leave-out")
    assert left["sensors"][0]["calibration"]["n"] == used["sensors"][0]["calibration"]["n"] - 1
    assert [w["code"] for w in left["warnings"]].count("reading_left_out") == 1
    assert "reading_left_out" not in [w["code"] for w in used["warnings"]]
