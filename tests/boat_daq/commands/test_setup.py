"""`setup`: compiled once, said in words and as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis import compile_all, compiled
from boat_daq.cli import app


def test_it_compiles_each_step_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The first call takes every step, the second none; a line on standard error names each as it begins."""
    taken: list[str] = []
    steps = {name: (lambda name=name: taken.append(name)) for name in compile_all.COMPILE_STEPS}
    monkeypatch.setattr(compile_all, "CACHE_FOLDER", tmp_path)
    monkeypatch.setattr(compiled, "CACHE_FOLDER", tmp_path)
    monkeypatch.setattr(compile_all, "COMPILE_STEPS", steps)
    first = CliRunner().invoke(app, ["setup", "--json"])
    assert taken == ["calibration", "rays", "shadow"]
    assert first.stderr.splitlines() == [
        "compiling the search for cycles",
        "compiling the ray tracer",
        "compiling the finite elements",
    ]
    assert json.loads(first.stdout)["compiled"] is True
    second = CliRunner().invoke(app, ["setup"])
    assert len(taken) == 3
    assert second.stdout == f"all is compiled, in {tmp_path}\n"


def test_files_of_another_date_are_compiled_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As after a new installation of the same version, whose machine code numba does not load."""
    monkeypatch.setattr(compile_all, "CACHE_FOLDER", tmp_path)
    monkeypatch.setattr(compile_all, "COMPILE_STEPS", {"rays": lambda: None})
    assert compile_all.compile_all()
    assert compile_all.is_complete()
    (tmp_path / "cycles.py").touch()
    monkeypatch.setattr(compile_all, "_ALONE", (str(tmp_path / "cycles.py"),))
    assert not compile_all.is_complete()


def test_without_a_cache_each_call_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no folder can be written nothing is noted as complete."""
    monkeypatch.setattr(compile_all, "CACHE_FOLDER", None)
    monkeypatch.setattr(compile_all, "COMPILE_STEPS", {"rays": lambda: None})
    assert compile_all.compile_all()
    assert not compile_all.is_complete()


def test_sizes_name_what_needs_each_library() -> None:
    """Of this installation: every requirement once, the window's the largest, and the sums by use."""
    found = json.loads(CliRunner().invoke(app, ["setup", "sizes", "--json"]).stdout)
    uses = {row["library"]: row["use"] for row in found["libraries"]}
    assert {"numpy": "calibration", "pyside6-essentials": "window", "typst": "PDF"}.items() <= uses.items()
    assert len(uses) == len(found["libraries"]) > 20
    assert sum(found["uses"].values()) == sum(row["bytes"] for row in found["libraries"])
    assert found["uses"]["window"] > 50e6


def test_completion_is_installed_for_the_shell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A script that calls the program for what is typed."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("shellingham.detect_shell", lambda: ("bash", "/bin/bash"))
    found = json.loads(CliRunner().invoke(app, ["setup", "completion", "--json"]).stdout)
    assert "_BOAT_DAQ_COMPLETE" in Path(found["path"]).read_text(encoding="utf-8")
