"""`boat-daq report`: a report with limits."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.boat_daq.commands.calls import call, exit_code


def test_limit_decides_the_verdict(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A run within its limit passes; the curve is the one of the option."""
    boat, readings = stairs
    options = ("--elongation", readings, "--no-mcmc", "--no-shadow", "--limit", "snr=40")
    assert (
        "The limit is kept" in call("report", boat, "--out", tmp_path / "r.html", *options, "--degree", "2")["verdict"]
    )
    written = (tmp_path / "r.html").read_text()
    assert len(written) > 10_000
    assert ">2</td>" in written.partition("Degree or curve")[2][:200]


@pytest.mark.parametrize(
    "options",
    [("--out", "r.docx"), ("--out", "r.pdf", "--limit", "snr"), ("--out", "r.pdf", *("--elongation", "e") * 2)],
)
def test_wrong_option_is_a_usage_error(options: tuple[str, ...]) -> None:
    """Exit code 2 before any file is read."""
    assert exit_code("report", "a.boat", "b.boat", "c.boat", *options) == 2


def test_limit_within_the_uncertainty_is_conditional(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A limit at the value itself is neither passed nor failed; the JSON has guard band, probability and rule."""
    boat, readings = shutil.copy(stairs[0], tmp_path), stairs[1]  # analyze stores its results in the recording
    options = ("--elongation", readings, "--no-mcmc", "--no-shadow")
    value = call("analyze", boat, *options, "--limit", "snr=0")["conformity"][0]["value"]
    found = call("report", boat, *options, "--out", tmp_path / "r.html", "--limit", f"snr={value - 0.001}")
    first = found["conformity"][0]
    assert first["conformity"] == "conditional_pass"
    assert first["probability"] == pytest.approx(0.5, abs=0.02)
    assert first["guard_band"] > 0
    assert "ILAC-G8" in first["rule"]
    assert ", conditional pass" in found["verdict"] or ", fail" in found["verdict"]
