"""Options that several commands share."""

from __future__ import annotations

from typer.testing import CliRunner

from boat_daq.cli import app


def test_unknown_fidelity_is_a_usage_error() -> None:
    """Exit code 2, with the levels."""
    result = CliRunner().invoke(app, ["optics", "trace", "--fidelity", "finest"])
    assert result.exit_code == 2
    assert "draft, normal, reference" in " ".join(result.output.split())
