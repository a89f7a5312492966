"""`boat-daq tradeoff` as typed: files, JSON, refusals, Ctrl-C; and the file of the named machine against the code."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.fidelity import LEVELS
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.studies.tradeoff.charts import MAY_BE_INFINITE
from analysis.studies.tradeoff.jobs import JOBS, METHODS, STEPS
from analysis.studies.tradeoff.measure import CostPoint, Measured, Method, measure
from boat_daq.cli import app
from boat_daq.viewmodels.models.tradeoff import METHOD_NAMES as ON_THE_PAGE
from boat_daq.workflows.measured_methods import camera_tracker
from protocol.base.errors import RequestError, StorageError

ROOT = Path(__file__).resolve().parents[3]
RECORDED = ROOT / "analysis" / "studies" / "tradeoff" / "references" / "measured.json"
CHARTS = ROOT / "docs" / "tradeoff"
RULED = [step.name for step in STEPS]
"""Methods whose settings the rule chooses; a job's follow from theirs."""


def test_one_cheap_method_from_the_command_line(tmp_path: Path) -> None:
    """JSON on standard output equals the file; CSV and both charts are there; the default is the chosen one."""
    result = CliRunner().invoke(app, ["tradeoff", "bootstrap", "--quick", "--json", "--out", str(tmp_path / "new")])
    assert result.exit_code == 0, result.output
    output = json.loads(result.stdout)
    (method,) = output["methods"]
    assert json.loads((tmp_path / "new" / "tradeoff.json").read_text())["methods"] == output["methods"]
    assert {p.name for p in (tmp_path / "new").iterdir()} == {
        "tradeoff.json", "tradeoff.csv", "bootstrap.png", "bootstrap.svg", "overview.png", "overview.svg",
    }  # fmt: skip
    assert method["reference"].endswith("; independent")
    assert method["independent"] is True
    assert set(method["fidelity"]) == set(LEVELS)
    assert all(p["first_seconds"] > 0 and p["cpu_spread"] >= 0 for p in method["points"])
    errors = [p["error"] for p in method["points"]]
    assert errors[0] > errors[-1] > 0


def test_unknown_method_and_unwritable_folder_are_refused(tmp_path: Path) -> None:
    """A method that is none, and a folder that is a file, before any time is spent."""
    refused = CliRunner().invoke(app, ["tradeoff", "guessing", "--out", str(tmp_path)])
    assert isinstance(refused.exception, RequestError)
    assert "guessing" in refused.exception.cause
    assert "tracer" in refused.exception.remedy
    (tmp_path / "file").write_text("")
    unwritable = CliRunner().invoke(app, ["tradeoff", "inverse", "--out", str(tmp_path / "file")])
    assert isinstance(unwritable.exception, StorageError)
    assert not list(tmp_path.glob("*.json"))


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
def test_ctrl_c_ends_a_measurement_with_130(tmp_path: Path) -> None:
    """Interrupted while it measures: exit code 130, and nothing that looks like a result is left."""
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "boat_daq", "tradeoff", "segmentation", "--out", str(folder)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not folder.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    time.sleep(0.3)
    while process.poll() is None:  # again and again, also while the interpreter ends
        process.send_signal(signal.SIGINT)
        time.sleep(0.005)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert list(folder.iterdir()) == []


def test_the_page_offers_what_the_command_measures() -> None:
    """One list of methods."""
    assert set(ON_THE_PAGE) == {*METHODS, camera_tracker().name}


@pytest.fixture(scope="module")
def recorded() -> dict[str, Measured]:
    """The results of the named machine under the current rule."""
    content = json.loads(RECORDED.read_text(encoding="utf-8"))

    def point(row: dict[str, Any]) -> CostPoint:
        return CostPoint(**{**row, **{name: math.inf for name in MAY_BE_INFINITE if row[name] is None}})

    kept = {m["name"]: m["points"] for m in content["methods"] if m["name"] in METHODS}
    return {name: Measured.of(METHODS[name], [point(row) for row in rows]) for name, rows in kept.items()}


@pytest.mark.parametrize("name", RULED)
def test_defaults_and_levels_in_the_code_are_what_the_rule_chooses_on_the_named_machine(
    recorded: dict[str, Measured], name: str
) -> None:
    """The committed chart, the rule and the code agree for every method and every level."""
    found = recorded[name]
    assert found.chosen == found.method.default, found.verdict
    assert dict(found.levels) == found.method.in_code
    by_name = {point.setting: point for point in found.points}
    errors = [by_name[setting].error for setting in found.front]
    assert len(errors) >= 1
    assert errors == sorted(errors, reverse=True)  # along the front, what costs more errs less


@pytest.mark.parametrize("job", JOBS, ids=lambda job: job.name)
def test_a_job_at_the_default_level_is_sufficient_on_the_named_machine(
    recorded: dict[str, Measured], job: Method
) -> None:
    """The steps' defaults together stay below what the consumer of the whole notices."""
    default = next(point for point in recorded[job.name].points if point.setting == job.default)
    assert default.error < job.tolerance


def test_named_machine_and_its_date_are_given() -> None:
    """The record names machine and date, is of a full run, and names no method without a reference."""
    content = json.loads(RECORDED.read_text(encoding="utf-8"))
    assert content["quick"] is False
    assert content["machine"]["processor"]
    assert content["machine"]["date_utc"].startswith("20")
    assert all(m["independent"] for m in content["methods"] if m["name"] in RULED)
    for name in ("overview", *METHODS):
        assert (CHARTS / f"{name}.png").stat().st_size < 250_000


@pytest.mark.nightly
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", RULED)
def test_measured_here_and_now_the_default_is_good_enough_and_costs_no_more_than_it_must(name: str) -> None:
    """The default is below its tolerance by the margin here too; what is good enough saves less than half of it."""
    found = measure(METHODS[name], quick=False)
    points = {p.setting: p for p in found.points}
    default = points[found.method.default]
    assert 2.0 * default.error <= found.method.tolerance * 1.1
    assert found.chosen is not None
    # the clock of another machine differs; a setting that costs twice as much as needed would still show
    assert default.cpu_seconds < 2.0 * points[found.chosen].cpu_seconds


@pytest.mark.nightly
@pytest.mark.timeout(1200)
def test_the_kept_references_are_what_their_scripts_make() -> None:
    """The second tracer, the importance sampling and the fit again, with fewer draws where only precision is lost."""
    from analysis.optics.scene.curves import frames_of
    from analysis.optics.scene.parameters import PAPER_OPTIMUM, Waveguide
    from analysis.studies.tradeoff.references import load
    from tests.analysis.shadow.geometry_fit import fit_geometry
    from tests.analysis.studies.tradeoff import make_posterior_reference, make_tracer_reference

    table = load("tracer")
    frames = frames_of(np.array(table["curves_mm"]), Waveguide())
    again = [make_tracer_reference.ndr(frames[s], PAPER_OPTIMUM, 100_000, phase=0.1) for s in table["states"]]
    np.testing.assert_allclose(again, table["ndr"], atol=0.1)
    width = make_posterior_reference.made(2**14)["width_mv"]
    np.testing.assert_allclose(width, load("posterior")["width_mv"], rtol=0.025)
    default, fitted = ActuatorParameters(), fit_geometry().parameters
    assert default.wall_modulus_kpa == pytest.approx(fitted.wall_modulus_kpa, rel=1e-4)
    assert default.neck_radius_mm == pytest.approx(fitted.neck_radius_mm, rel=1e-4)


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_calculix_again_on_a_small_mesh(tmp_path: Path) -> None:
    """The script that made CalculiX's table, on the default mesh: every elongation is ours to 0.1 %."""
    import shutil

    if shutil.which("ccx") is None:
        pytest.skip("CalculiX (ccx, Debian's calculix-ccx) is not installed")
    from analysis.shadow.model.full import FullModel
    from tests.analysis.studies.tradeoff import make_calculix_reference

    table = make_calculix_reference.made((16, 2, 4), ActuatorParameters())
    model = FullModel()
    pressures, elongations = table["pressures_kpa"], table["elongations_mm"]
    assert isinstance(pressures, list)
    ours = [model.solve(pressure_kpa=p).elongation_mm for p in pressures]
    np.testing.assert_allclose(elongations, ours, rtol=1e-3)
