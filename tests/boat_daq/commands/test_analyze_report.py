"""`boat-daq report`: a report with limits."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.boat_daq.commands.calls import call, exit_code


def test_limit_decides_the_verdict(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A run within its limit passes."""
    boat, readings = stairs
    options = ("--elongation", readings, "--no-mcmc", "--no-shadow", "--limit", "snr=40")
    assert "PASSES" in call("report", boat, "--out", tmp_path / "r.html", *options)["verdict"]
    assert (tmp_path / "r.html").stat().st_size > 10_000


@pytest.mark.parametrize(
    "options",
    [("--out", "r.docx"), ("--out", "r.pdf", "--limit", "snr"), ("--out", "r.pdf", *("--elongation", "e") * 2)],
)
def test_wrong_option_is_a_usage_error(options: tuple[str, ...]) -> None:
    """Exit code 2 before any file is read."""
    assert exit_code("report", "a.boat", "b.boat", "c.boat", *options) == 2
