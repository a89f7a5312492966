"""The command that opens the window."""

from __future__ import annotations

from typer.testing import CliRunner

from boat_daq.cli import app


def test_window_takes_the_profile_of_its_port(monkeypatch, tmp_path):
    """A board with other firmware is connected to from the command line; without a port a profile is refused."""
    seen = []
    monkeypatch.setattr("boat_daq.gui.app.run", lambda port, **options: seen.append((port, options["profile"])) or 0)
    monkeypatch.setattr("boat_daq.engine.log.start_log", lambda _: None)
    profile = tmp_path / "p.toml"
    found = CliRunner().invoke(app, ["gui", "--port", "/dev/x", "--profile", str(profile)])
    assert (found.exit_code, seen) == (0, [("/dev/x", str(profile))])
    assert CliRunner().invoke(app, ["gui", "--profile", str(profile)]).exit_code == 2
