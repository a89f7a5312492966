"""The optics commands: their keys, their files, and what they say when they cannot."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.errors import AnalysisError
from boat_daq.commands.optics import app

LEDGER = {"released", "detected", "escaped", "trapped", "cut", "corner", "dropped"}


def told(*words: str) -> dict[str, object]:
    result = CliRunner().invoke(app, [*words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    return json.loads(result.stdout)


def refused(*words: str) -> AnalysisError:
    result = CliRunner().invoke(app, list(words))
    assert isinstance(result.exception, AnalysisError)
    assert result.exception.remedy
    return result.exception


def test_trace_tells_the_agreed_keys() -> None:
    """Design, state, rays, NDR, power, ledger and hits; the ledger closes."""
    out = told("trace", "--state", "0", "--secondary", "0")
    assert {
        "cavities",
        "width_mm",
        "depth_mm",
        "spacing_mm",
        "state",
        "rays",
        "ndr",
        "power",
        "ledger",
        "hits",
    } <= set(out)
    ledger = out["ledger"]
    assert isinstance(ledger, dict)
    assert set(ledger) == LEDGER
    assert ledger["released"] == 250 == sum(ledger[k] for k in LEDGER - {"released"})


def test_trace_reads_a_curve_file(tmp_path: Path, curves: np.ndarray) -> None:
    """The parametric curves, written to a file and read again, give the same NDR; the default ones give another."""
    path = tmp_path / "curves.csv"
    path.write_text("x,z\n" + "\n".join(f"{x!r},{z!r}" for s in curves.tolist() for g in s for x, z in g))
    written = told("trace", "--state", "14", "--curves", str(path))["power"]
    assert written == told("trace", "--state", "14", "--curves", "parametric")["power"]
    assert written != told("trace", "--state", "14")["power"]


def test_trace_draws(tmp_path: Path) -> None:
    """A picture of the rays is written as PNG and as SVG."""
    for name in ("rays.png", "rays.svg"):
        told("trace", "--out", str(tmp_path / name), "--rays", "40")
        assert (tmp_path / name).stat().st_size > 5000


def test_scene_writes_version_5(tmp_path: Path) -> None:
    """The scene goes to a file, or to standard output with --json."""
    told("scene", "--out", str(tmp_path / "scene.json"))
    assert json.loads((tmp_path / "scene.json").read_text())["version"] == 5
    assert told("scene")["version"] == 5


@pytest.mark.nightly
def test_sweep_tells_all_designs(tmp_path: Path) -> None:
    """216 designs in 15 states, with the best, the ties and the paper's optimum."""
    out = told("sweep", "--cavities", "5", "--rays", "50", "--out", str(tmp_path))
    assert out["simulations"] == 3240
    assert isinstance(out["designs"], list)
    assert len(out["designs"]) == 216
    assert {"best", "tied_with_best", "paper_optimum", "seconds", "hits"} <= set(out)
    assert told("sweep", "--cavities", "5", "--rays", "50", "--out", str(tmp_path))["simulated_now"] == 0


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (("trace", "--state", "15"), "no state 15"),
        (("trace", "--depth", "2"), "cuts through"),
        (("trace", "--spacing", "0"), "overlap"),
        (("trace", "--index", "0.5"), "index"),
        (("trace", "--rays", "0"), "rays"),
        (("trace", "--order", "colour"), "order"),
        (("trace", "--curves", "absent.csv"), "no curve file"),
        (("trace", "--thickness", "40"), "touch"),
        (("sweep", "--cavities", "many"), "list of numbers"),
        (("sweep", "--cavities", "3,0"), "0 cavities"),
        (("trace", "--rays", "10000001"), "rays"),
        (("trace", "--rays", "2", "--out", "absent/rays.png"), "cannot be written"),
        (("trace", "--rays", "2", "--out", "rays.xyz"), "names no picture"),
        (("scene", "--out", "absent/scene.json"), "cannot be written"),
        (("scene", "--rays", "20001", "--emission", "lambertian"), "one by one"),
        (("optimise", "--seconds", "nan"), "nan s"),
        (("optimise", "--out", "/dev/null"), "cannot be made"),
        (("optimise", "--rays", "0"), "rays"),
    ],
)
def test_failures_name_cause_and_remedy(words: tuple[str, ...], cause: str) -> None:
    """Each bad request is refused with words that name it."""
    assert cause in refused(*words).cause
