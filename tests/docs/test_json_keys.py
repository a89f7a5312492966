"""The keys of the reference are the keys that the commands print."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.elongation_control.controller import Tuning
from analysis.elongation_control.dynamic_figures import BodePoint, DynamicCalibration, DynamicFigure
from analysis.elongation_control.dynamics import lag_figures
from analysis.elongation_control.unit_file import TwinFile
from analysis.optics.scene.curves import default_curves
from analysis.shadow.model.states import GuideStates
from analysis.signal_prediction.prediction import published_prediction
from analysis.studies.paper.numbers import shadow_rows
from analysis.studies.paper.reproduction import PaperDrawing, PaperPart, draw_states, write_reproduction
from boat_daq.cli import app
from boat_daq.engine.simulator.server import BoardSettings, serve
from tests.analysis.twin_unit import LAG, identified
from tests.docs.pages import ROOT

PAGE = (ROOT / "docs" / "reference" / "json.md").read_text(encoding="utf-8")
SHARED = dict(re.findall(r"^([A-Z]+) (\{.*?\})$(?=\n[A-Z]|\n```)", PAGE, re.MULTILINE | re.DOTALL))
"""The keys of each shared object, by its name."""
EXAMPLE = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"


def documented(command: str) -> set[str]:
    """Return the dotted names of the keys under a command's heading; lists are left out of the names."""
    found = re.search(rf"^## `{re.escape(command)}`$.*?```text\n(.*?)```", PAGE, re.MULTILINE | re.DOTALL)
    assert found, command
    keys = re.sub(r"(?<=[{,])(\s*)([A-Z]+)\b(?=[,}])", lambda word: SHARED.get(word[2], word[2]).strip("{}"), found[1])
    keys = re.sub(r"\b[A-Z]+\b", lambda word: SHARED.get(word[0], word[0]), keys)
    names: set[str] = set()
    path: list[str] = []
    name = ""
    for token in re.findall(r"[{}\[\],]|[^{}\[\],]+", keys):
        if token == "{":
            path.append(name)
        elif token == "}":
            path.pop()
        elif token.strip() and token not in "[],":
            name = " ".join(token.split())
            names.add(".".join([*path, name]).lstrip("."))
    return names


def printed(value: Any, path: str = "") -> Iterator[str]:
    """Yield the dotted names of the keys of a command's object."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield f"{path}{key}"
            yield from printed(inner, f"{path}{key}.")
    elif isinstance(value, list):
        for inner in value:
            yield from printed(inner, path)
        if not value:
            yield f"{path}*"  # an empty list has no objects whose keys could be seen


CASES = [
    ("info RUN", ["info", "RUN"]),
    ("strokes RUN", ["strokes", "STROKES"]),
    ("fit FILE.csv --x COL --y COL --bands", ["fit", "TABLE", "--x", "x", "--y", "y", "--bands"]),
    ("metadata RUN", ["metadata", "RUN"]),
    ("profile FILE", ["profile", "TABLE"]),
    ("config get", ["config", "get"]),
    pytest.param("certificate RUN --out FILE", ["certificate", "RUN", "--out", "FILE"], marks=pytest.mark.nightly),
    pytest.param("analyze RUN", ["analyze", "RUN", "--no-store"], marks=pytest.mark.nightly),
    pytest.param("verify RUN", ["verify", "RUN"], marks=pytest.mark.nightly),
    pytest.param("optics trace", ["optics", "trace"], marks=pytest.mark.nightly),
    pytest.param("shadow solve --pressure KPA", ["shadow", "solve", "--pressure", "20"], marks=pytest.mark.nightly),
    pytest.param("shadow replay RUN", ["shadow", "replay", "RUN"], marks=pytest.mark.nightly),
]


def of_twin(folder: Path) -> dict[str, Any]:
    """Return objects of the twin's commands by their headings, made without a port."""
    model, _ = identified("SA1")
    tuning = Tuning.of(LAG, 36.0)
    twin = TwinFile("SA1", True, "2026-11-23T00:00:00+00:00", "a.boat", model, tuning).as_json()
    figure = DynamicFigure(1.0, 0.9, 1.1)
    steps = dict.fromkeys(("time_constant_s", "rise_s", "settling_s", "overshoot_percent"), figure)
    bode = (BodePoint(0.1, 0.0, -1.0, 0.1, 1.0),)
    published = [one.as_json() for one in published_prediction()]
    states = GuideStates(default_curves(), np.zeros(15), np.zeros(15), "stored")
    drawing = PaperDrawing("2B", "guides", "states", partial(draw_states, states.curves_mm))
    paper = PaperPart(shadow_rows(states, -43.3, 1.0, 1.0), [drawing])
    return {
        "twin identify RUN": twin,
        "twin tune RUN": twin | {"step_response": asdict(lag_figures(replace(LAG, covariance=np.eye(3).tolist())))},
        "twin dynamics RUN": DynamicCalibration("SA1", True, "a", 0.05, {1.0: steps}, bode, figure).as_json(),
        "twin predict RUN": {
            "unit": "", "simulated": True, "sensors": published, "published": published,
            "disagreement_percent": {"none": 100.0},
        },
        "reproduce": write_reproduction([paper], folder) | {"seconds": 1.0},
    }  # fmt: skip


@pytest.mark.parametrize(
    "heading", ["twin identify RUN", "twin tune RUN", "twin dynamics RUN", "twin predict RUN", "reproduce"]
)
def test_every_promised_key_of_the_twin_is_given(heading: str, tmp_path: Path) -> None:
    names = set(printed(json.loads(json.dumps(of_twin(tmp_path)[heading]))))
    assert not {name for name in documented(heading) if not any(_same(name, other) for other in names)}


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_the_twin_prints_its_keys_from_calibration_to_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every command in the order of the guide, on a virtual board."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path / "home"))
    run, steps, sweep = (str(tmp_path / f"{name}.boat") for name in ("a", "steps", "sweep"))
    demo = ["demo", "--headless", "--no-mcmc", "--no-report", "--speed", "40", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, demo).exit_code == 0
    Path(run).write_bytes((tmp_path / "demo_SA1_seed0.boat").read_bytes())
    with serve(BoardSettings(speed=4.0)) as board:
        port = ["--port", board.url, "--unit", "SA1"]
        for heading, words in (
            ("twin accept RUN", ["twin", "accept", run, "--json"]),
            ("twin identify RUN", ["twin", "identify", run, "--json"]),
            ("", ["record", *port, "--plan", "step-test", "--out", steps]),
            ("twin tune RUN", ["twin", "tune", steps, "--json"]),
            ("", ["record", *port, "--plan", "sine-sweep-mm", "--out", sweep]),
            ("twin dynamics RUN", ["twin", "dynamics", sweep, "--json"]),
            ("twin hold", ["twin", "hold", *port, "--mm", "1.5", "--out", str(tmp_path / "hold.boat"), "--json"]),
            ("twin predict RUN", ["twin", "predict", run, "--json"]),
        ):
            done = CliRunner().invoke(app, words)
            assert done.exit_code == 0, (words, done.output)
            if heading:
                names = set(printed(json.loads(done.stdout)))
                assert not {n for n in documented(heading) if not any(_same(n, other) for other in names)}, heading


@pytest.mark.parametrize(("heading", "call"), CASES)
def test_every_promised_key_is_printed(heading: str, call: list[str], tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("x,y\n-2,1549\n-1,1603\n0,1652\n1,1695\n2,1731\n3,1757\n", encoding="utf-8")
    strokes = tmp_path / "strokes.csv"
    rows = [f"{0.02 * k:.2f},{50 * (1 - abs(k % 200 / 100 - 1)):.2f},{1600 + k % 200}" for k in range(1000)]
    strokes.write_text("\n".join(["time_s,pressure_kpa,s1_mv", *rows, ""]))
    files = {"RUN": str(EXAMPLE), "STROKES": str(strokes), "TABLE": str(table), "FILE": str(tmp_path / "c.xml")}
    done = CliRunner().invoke(app, [*(files.get(word, word) for word in call), "--json"])
    assert done.exit_code == 0, done.output
    names = set(printed(json.loads(done.stdout)))
    missing = {name for name in documented(heading) if not any(_same(name, other) for other in names)}
    assert not missing


def _same(entry: str, name: str) -> bool:
    """Whether a printed name matches a documented one; NAME matches any name."""
    wanted, found = entry.split("."), name.split(".")
    if found[-1] == "*":
        wanted, found = wanted[: len(found) - 1], found[:-1]
    return len(wanted) == len(found) and all(w in ("NAME", f) for w, f in zip(wanted, found, strict=True))
