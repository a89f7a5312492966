"""The commands that recordings/README.md proposes, on each example recording."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.boat_daq.commands.calls import call

EXAMPLES = Path(__file__).parents[2] / "recordings"
RECORDINGS = sorted(EXAMPLES.glob("*.boat"))


def test_every_example_is_described() -> None:
    """The table of the README lists the files that are there, and the commands below it are those tested here."""
    text = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert RECORDINGS
    assert all(f"| `{file.name}` |" in text for file in RECORDINGS)
    assert "Try `boat-daq info`, `verify`, `analyze` and `report` on them" in text


@pytest.mark.parametrize("example", RECORDINGS, ids=lambda file: file.stem)
def test_an_example_does_what_the_readme_says(example: Path, tmp_path: Path) -> None:
    """Analysis and report of a copy succeed; its stored results, one from elsewhere, are derived again by number."""
    run = Path(shutil.copy(example, tmp_path))
    stored = call("info", run)
    assert stored["simulated"]
    assert call("analyze", run, "--no-mcmc")["sensors"][0]["calibration"] is not None
    assert call("report", run, "--no-mcmc", "--no-shadow", "--out", tmp_path / "report.html")["verdict"]
    verdict = call("verify", run)
    assert (verdict["identical"], verdict["difference"]) == (True, "")
    assert verdict["results"] == stored["results"] + 1 >= 2
