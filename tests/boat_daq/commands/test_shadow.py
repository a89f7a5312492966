"""`boat-daq shadow`: JSON keys, files and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from analysis.optics.scene.curves import default_curves, elongations
from analysis.shadow.model.full import MESH_ERROR_MM, MESH_ERROR_PERCENT
from analysis.shadow.model.states import GuideStates
from boat_daq.cli import app
from boat_daq.commands.shadow import save_figure
from boat_daq.engine.settings import UnitLibrary
from protocol.base.errors import BoatDaqError, StorageError
from tests.analysis.boat_builder import PAPER, Plant, triangle, write_boat
from tests.boat_daq.commands.calls import call, exit_code, program, refusal
from tests.boat_daq.viewmodels.results.units import unit


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of this test's own."""
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)


@pytest.fixture
def coarse(tmp_path: Path) -> list[str]:
    """The paper's actuator on a coarse mesh: for tests that do not check its numbers."""
    path = tmp_path / "coarse.toml"
    path.write_text("axial_elements = 4\nwall_elements = 1\nlattice_elements = 2\n")
    return ["--parameters", str(path)]


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize("model", ["full", "reduced"])
def test_solve_keeps_its_contract(model: str) -> None:
    """The keys of the surface, by either model, and the state of the paper's range."""
    found = call("shadow", "solve", "--pressure", "-40", "--model", model)
    keys = {"pressure_kpa", "elongation_mm", "lowest_eigenvalue", "iterations", "seconds", "tracked_points_mm", "model"}
    assert keys <= set(found)
    assert found["model"] == model
    assert found["warnings"] == []
    assert found["elongation_mm"] == pytest.approx(-2.7, abs=1e-3)
    assert np.shape(found["tracked_points_mm"]) == (2, 7, 2)
    assert 0.0 < found["lowest_eigenvalue"] < 0.2


def test_the_error_by_the_mesh_is_the_measured_one(coarse: list[str], tmp_path: Path) -> None:
    """As measured on the default actuator; of another one a share of the elongation, and none on another mesh."""
    other = tmp_path / "other.toml"
    other.write_text("wall_mm = 2.4\n")
    solved = call("shadow", "solve", "--pressure", "20", "--parameters", str(other))
    assert solved["error_mm"] == pytest.approx(MESH_ERROR_PERCENT / 100 * solved["elongation_mm"])
    found = call("shadow", "solve", "--pressure", "20", "--fidelity", "draft")
    assert found["error_mm"] == MESH_ERROR_MM
    assert call("shadow", "solve", "--pressure", "20", *coarse)["error_mm"] is None
    beyond = call("shadow", "solve", "--pressure", "70")  # than what it was measured at
    assert beyond["error_mm"] == pytest.approx(MESH_ERROR_PERCENT / 100 * beyond["elongation_mm"])


def test_solve_at_an_elongation() -> None:
    """The pressure follows from the elongation."""
    assert call("shadow", "solve", "--elongation", "3.8")["pressure_kpa"] == pytest.approx(50.0, abs=0.05)


@pytest.mark.parametrize("words", [["--pressure", "0"], ["--pressure", "-0.01"], ["--elongation", "0"]])
def test_solve_at_rest(words: list[str], coarse: list[str]) -> None:
    """Nothing moves, and the only warning is that of the coarse mesh."""
    found = call("shadow", "solve", *words, *coarse)
    assert found["elongation_mm"] == pytest.approx(0.0, abs=0.002)
    assert [one["code"] for one in found["warnings"]] == ["coarse_mesh"]


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["solve"], 2),
        (["solve", "--pressure", "1", "--model", "half"], 2),
        (["solve", "--pressure", "1", "--mesh", "x.vtu", "--model", "reduced"], 2),
        (["solve", "--pressure", "-80"], 1),
        (["solve", "--pressure", "nan"], 1),
        (["states", "--out", "states.docx"], 1),
        (["solve", "--elongation", "1", "--parameters", "none.toml"], 1),
        (["solve", "--elongation", "1", "--mesh", "none.vtu"], 1),
        (["export", "--format", "stl", "--out", "x.stl"], 1),
        (["modulus", "none.csv", "--height-mm", "50", "--area-mm2", "2500"], 1),
        (["modulus", "s1.csv", "./s1.csv", "--height-mm", "50", "--area-mm2", "2500"], 2),
    ],
)
def test_bad_requests(words: list[str], code: int) -> None:
    """A usage error is 2; a failure carries cause and remedy for the command line to print."""
    if code == 2:
        assert exit_code("shadow", *words) == 2
    else:
        assert isinstance(refusal("shadow", *words), BoatDaqError)


@pytest.mark.usefixtures("cache")
def test_table_has_its_error_and_speed() -> None:
    """Bound below 0.1 % of the range, more than 20,000 states a second."""
    found = call("shadow", "table")
    assert found["error_bound_percent"] < 0.1
    assert found["states_per_s"] > 20_000
    assert len(found["errors_mm"]) == found["modes"]


def test_export_writes_all_formats(tmp_path: Path, coarse: list[str]) -> None:
    """Each format's file, and its size in nodes and elements."""
    for kind in ("vtu", "msh", "inp"):
        out = tmp_path / f"actuator.{kind}"
        found = call("shadow", "export", "--format", kind, "--pressure", "20", "--out", str(out), *coarse)
        assert out.stat().st_size > 1000
        assert found["elements"] == 6 * 4 * 3
    assert call("shadow", "solve", "--pressure", "20", "--mesh", str(tmp_path / "actuator.msh"))["model"] == "full"


def test_states_writes_curves(tmp_path: Path, coarse: list[str]) -> None:
    """Fifteen states, seven points a guide."""
    found = call("shadow", "states", "--out", str(tmp_path / "curves.csv"), *coarse)
    assert found["points"] == 7
    assert len(found["elongation_mm"]) == 15
    lines = (tmp_path / "curves.csv").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("#")]) == 1 + 15 * 2 * 7


@pytest.mark.usefixtures("cache")
def test_modulus_gives_the_band(tmp_path: Path) -> None:
    """Three specimens become E with its spread, and the spread becomes a band of nominal elongation."""
    names = []
    for modulus in (16.5, 18.3, 20.2):
        way = np.linspace(0, 6, 100)
        path = tmp_path / f"{modulus}.csv"
        rows = np.column_stack([way, modulus * 1e-3 * 2500 * way / 50])
        np.savetxt(path, rows, delimiter=",", header="displacement_mm,force_n", comments="")
        names.append(str(path))
    small = tmp_path / "small.toml"
    small.write_text("cells = 2\naxial_elements = 4\nwall_elements = 1\nlattice_elements = 2\n")
    size = ["--height-mm", "50", "--area-mm2", "2500", "--parameters", str(small)]
    found = call("shadow", "modulus", *names, *size)
    assert found["mean_kpa"] == pytest.approx(np.mean([16.5, 18.3, 20.2]), rel=1e-6)
    assert found["sd_kpa"] == pytest.approx(np.std([16.5, 18.3, 20.2], ddof=1), rel=1e-6)
    assert all(0 < point["standard_uncertainty_mm"] < 0.2 for point in found["band"])


@pytest.mark.nightly
def test_state_is_plotted_into_a_file(tmp_path: Path, coarse: list[str]) -> None:
    """SVG is written; an unknown format is refused."""
    words = ("shadow", "solve", "--pressure", "30", "--model", "full", *coarse, "--plot")
    assert exit_code(*words, tmp_path / "state.svg") == 0
    assert (tmp_path / "state.svg").stat().st_size > 10_000
    with pytest.raises(StorageError):
        save_figure(Figure(), tmp_path / "state.xyz")


def test_replay_takes_the_calibration_of_the_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For a run without readings, and names it; where the unit has none, the refusal names both ways to one."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    continuous = Plant(cubics=PAPER[:1] * 2).run(*triangle(3, 8.0))
    run = write_boat(tmp_path / "cycles.boat", continuous, meta={"unit": "SA1"})
    missing = refusal("shadow", "replay", run)
    assert missing.cause == "no elongation was read in this run, and simulated unit SA1 has no accepted calibration"
    assert "--calibration" in missing.remedy
    assert missing.command == "boat-daq twin accept RUN"
    units = UnitLibrary(simulated=True)
    stored = units.add_calibration("SA1", unit(0.0).history[0].content)
    found = call("shadow", "replay", run)
    assert found["cycles"] == 3
    assert found["calibration"] == f"unit SA1, accepted {stored.history[0].utc}"


def test_every_help_has_an_example() -> None:
    """Each command's help ends with one."""
    for command in ("solve", "table", "modulus", "replay", "states", "export", "chain"):
        assert f"Example: boat-daq shadow {command}" in " ".join(
            CliRunner().invoke(app, ["shadow", command, "--help"]).output.split()
        )


def test_unstable_equilibrium_has_a_warning() -> None:
    """At -43 kPa the actuator is stable at -3 mm, not pulled to +7 mm."""
    for elongation, codes in (("7", ["contradictory_state", "unstable_state"]), ("-3", [])):
        result = call("shadow", "solve", "--pressure", "-43", "--elongation", elongation)
        stable = "unstable_state" not in codes
        assert (result["lowest_eigenvalue"] > 0) == stable
        assert [warning["code"] for warning in result["warnings"]] == codes
        assert result["notes"] == [warning["text"] for warning in result["warnings"]]


@pytest.mark.usefixtures("cache")
def test_a_fallback_to_the_full_model_is_reported() -> None:
    """In JSON by its code, on standard error by the rectangle that was left."""
    words = ("shadow", "solve", "--pressure", "-42", "--elongation", "-3.6", "--model", "reduced", "--json")
    ended = program(*words)
    result = json.loads(ended.out)
    assert result["model"] == "full"
    assert "outside_table" in [warning["code"] for warning in result["warnings"]]
    assert "outside the table of the reduced model (-41.5 .. 55.0 kPa" in ended.err
    assert "the full model was used" in ended.err


def test_chain_compares_light_with_the_published_signals(monkeypatch: pytest.MonkeyPatch) -> None:
    """The light of the paper's design falls over the states, so both gains are negative; few rays are noted."""
    solved = GuideStates(default_curves(), np.zeros(15), elongations(), "stored")
    monkeypatch.setattr("analysis.shadow.model.states.guide_states", lambda model: solved)
    out = call("shadow", "chain", "--rays", "4")
    signal = out["signal"]
    assert isinstance(signal, dict)
    assert signal["inverted"] == all(fit["gain_mv_per_percent"] < 0 for fit in signal["sensors"])
    assert len(signal["light_percent"]) == len(signal["light_sd_percent"]) == 15
    result = CliRunner().invoke(app, ["shadow", "chain", "--rays", "4"])
    assert "published signal of sensor 2: +12.5 %" in result.stdout
    assert "scatters more than it changes" in result.stderr
    assert out["shadow"]["rays"] == signal["rays"] == 4
    assert out["shadow"]["error"]["of_95_percent"] <= out["shadow"]["error"]["greatest"]
