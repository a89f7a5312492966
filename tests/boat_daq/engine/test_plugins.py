"""Plugins of the lab: called in processes of their own; one that raises, hangs or prints is named and harms nothing."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from boat_daq.engine import plugins
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import MessageKind
from tests.boat_daq.engine.served_board import serve_in_thread

SOURCE = """
import json, pathlib, time

def figures(run, analysis):
    print("a plugin prints")
    return [{"label": "Plateaus", "unit": "", "values": [analysis["plateaus"]]},
            {"label": "Ratio", "unit": "%", "values": [50.0, None]}]

def wrong(run, analysis):
    return [{"label": "no unit"}]

class kept:
    @staticmethod
    def recording_closed(run):
        pathlib.Path(run + ".seen").write_text("closed")

    @staticmethod
    def analysis_done(run, analysis):
        pathlib.Path(run + ".json").write_text(json.dumps(analysis))

class raising:
    @staticmethod
    def recording_closed(run):
        raise ValueError("no space in the archive")

class hanging:
    @staticmethod
    def recording_closed(run):
        time.sleep(60)
"""


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, **groups: str) -> None:
    """Install a package with entry points, as a distribution's metadata names them."""
    packages = folder / "packages"
    about = packages / "lab_boat-1.0.dist-info"
    about.mkdir(parents=True)
    (packages / "lab_boat.py").write_text(SOURCE)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lab-boat\nVersion: 1.0\n")
    points = "".join(f"[boat_daq.{group}]\n{lines}\n" for group, lines in groups.items())
    (about / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(str(packages))
    monkeypatch.setenv("PYTHONPATH", str(packages))


def test_without_plugins_there_is_no_thread_and_no_process() -> None:
    hooks = plugins.Hooks(lambda *_: None)
    hooks.emit("recording_closed", run="x")
    hooks.close()
    assert hooks._thread is None
    assert plugins.lab_figures("x", {}, lambda *_: None) == []


def test_figures_of_the_lab_are_returned_and_wrong_ones_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, figures="bad = lab_boat:wrong\nours = lab_boat:figures\nshy = lab_boat:nothing")
    failures: list[str] = []
    found = plugins.lab_figures("run.boat", {"plateaus": 37}, lambda cause, _: failures.append(cause))
    assert [(f["label"], f["unit"], f["values"][0], f["plugin"]) for f in found] == [
        ("Plateaus", "", 37.0, "ours"),
        ("Ratio", "%", 50.0, "ours"),
    ]
    assert [cause.split(":")[0] for cause in failures] == [
        "the figures of the plugin bad failed", "the figures of the plugin shy failed"
    ]  # fmt: skip
    assert "AttributeError" in failures[1]


def test_hooks_that_fail_are_named_and_harm_no_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One raises, one hangs, one does its work: the recording is whole, closed at once, and each failure a warning."""
    install(tmp_path, monkeypatch, hooks="a = lab_boat:raising\nb = lab_boat:hanging\nc = lab_boat:kept")
    monkeypatch.setattr(plugins, "HOOK_S", 1.0)
    session = Session(Settings(), UnitLibrary(tmp_path / "units"))
    with serve_in_thread(BoardSettings(speed=20.0)) as board:
        session.connect(board.url, record_to=tmp_path / "run.boat")
        session.wait_connected()
        began = time.monotonic()
        session.stop_recording()
        closed_s = time.monotonic() - began
        session.close()
    causes = [m.cause for m in session.snapshot().messages if m.kind is MessageKind.PLUGIN]
    assert len(causes) == 2
    assert "plugin a failed in recording_closed: ValueError: no space in the archive" in causes[0]
    assert "plugin b failed in recording_closed: it did not end within 1 s" in causes[1]
    assert (tmp_path / "run.boat.seen").read_text() == "closed"
    assert closed_s < 60


@pytest.mark.nightly
def test_an_analysis_has_the_figures_of_the_lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the object, the window's table and the report; the hook gets the same object."""
    from analysis import analyse
    from analysis.reports.build import build_report
    from boat_daq.viewmodels.results.figure_tables import lab_rows
    from boat_daq.workflows.run_analysis import with_plugins
    from tests.docs.pages import ROOT

    install(tmp_path, monkeypatch, figures="ours = lab_boat:figures", hooks="kept = lab_boat:kept")
    found = with_plugins(
        analyse(ROOT / "recordings" / "simulated_SA1_two_cycles.boat", mcmc=False), str(tmp_path / "run")
    )
    assert [figure.label for figure in found.lab_figures] == ["Plateaus", "Ratio"]
    assert lab_rows(found)[1][1][0] == "50"
    assert json.loads((tmp_path / "run.json").read_text())["lab_figures"][0]["plugin"] == "ours"
    texts = str(build_report([found]).sections)
    assert "Ratio, %" in texts
    assert "Computed by plugins of the laboratory" in texts
