"""The command that opens the window."""

from __future__ import annotations

import sys
import types

from typer.testing import CliRunner

from boat_daq.cli import app
from protocol.base.errors import RequestError


def test_window_takes_the_profile_of_its_port(monkeypatch, tmp_path):
    """A board with other firmware is connected to from the command line; without a port a profile is refused."""
    seen = []
    monkeypatch.setattr("boat_daq.gui.app.run", lambda port, **options: seen.append((port, options["profile"])) or 0)
    monkeypatch.setattr("boat_daq.engine.log.start_log", lambda _: None)
    profile = tmp_path / "p.toml"
    found = CliRunner().invoke(app, ["gui", "--port", "/dev/x", "--profile", str(profile)])
    assert (found.exit_code, seen) == (0, [("/dev/x", str(profile))])
    assert CliRunner().invoke(app, ["gui", "--profile", str(profile)]).exit_code == 2


def test_a_window_that_cannot_be_loaded_is_reported_with_a_remedy(monkeypatch):
    """Qt's modules are there and cannot be loaded, as after an interrupted installation."""
    monkeypatch.setattr("boat_daq.engine.log.start_log", lambda _: None)
    monkeypatch.setitem(sys.modules, "boat_daq.gui.app", types.ModuleType("app"))
    ran = CliRunner().invoke(app, ["gui"])
    assert isinstance(ran.exception, RequestError)
    assert ran.exception.cause.startswith("Qt cannot be loaded: ")
    assert "Install" in ran.exception.remedy


def test_a_file_named_on_the_command_line_is_handed_to_the_window(monkeypatch, tmp_path):
    """As a desktop does when a recording is opened there."""
    given = {}
    monkeypatch.setattr("boat_daq.engine.log.start_log", lambda _: None)
    window = types.ModuleType("app")
    window.run = lambda *_, **options: given.update(options) or 0
    monkeypatch.setitem(sys.modules, "boat_daq.gui.app", window)
    assert CliRunner().invoke(app, ["gui", str(tmp_path / "run.boat")]).exit_code == 0
    assert given["file"] == tmp_path / "run.boat"


def test_demo_opens_the_window_at_its_first_steps(monkeypatch):
    """It landed on a bare Arm, past the page that tells a new user what to do."""
    given = {}
    monkeypatch.setattr("boat_daq.engine.log.start_log", lambda _: None)
    monkeypatch.setattr("boat_daq.engine.screen.screen_error", lambda: None)
    monkeypatch.setattr("boat_daq.engine.screen.require_screen", lambda: None)
    window = types.ModuleType("app")
    window.run = lambda *_, **options: given.update(options) or 0
    monkeypatch.setitem(sys.modules, "boat_daq.gui.app", window)
    assert CliRunner().invoke(app, ["demo"]).exit_code == 0
    assert (given["first_steps"], given["board"]) == (True, False)
