"""The plugin that refuses tests to write elsewhere, seen from this very test run."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.outside_writes import landlock_version

LEFT = "written-by-a-test.txt"


def by_a_program(place: Path) -> None:
    """Create a file by another program."""
    done = subprocess.run([sys.executable, "-c", f"open({str(place)!r}, 'w')"], capture_output=True, text=True)
    if "PermissionError" in done.stderr:
        raise PermissionError(done.stderr)


ATTEMPTS: dict[str, Callable[[], object]] = {
    "create": (ROOT / LEFT).touch,
    "make a folder": (ROOT / "docs" / LEFT).mkdir,
    "open to change": lambda: (ROOT / "README.md").open("r+b").close(),
    "remove": (ROOT / "docs").rmdir,  # not empty: nothing happens where nothing is refused
    "move away": lambda: (ROOT / "README.md").rename(ROOT / "README.md"),
    "create by a program": lambda: by_a_program(ROOT / LEFT),
    "create beside the checkout": (ROOT.parent / LEFT).touch,
    "create in /etc": Path("/etc", LEFT).touch,
    "create at the top": Path("/", LEFT).touch,
}


@pytest.mark.skipif(landlock_version() == 0, reason="this kernel has no Landlock")
@pytest.mark.parametrize("attempt", ATTEMPTS)
def test_write_elsewhere_is_refused(attempt: str) -> None:
    """By this process, a worker or the only one, and by a program that it starts."""
    if ROOT.is_relative_to(tempfile.gettempdir()) and not attempt.endswith(("/etc", "the top")):
        pytest.skip("this checkout lies in a temporary folder, where tests may write")
    try:
        with pytest.raises(PermissionError):
            ATTEMPTS[attempt]()
    finally:
        left = [folder / LEFT for folder in (ROOT, ROOT / "docs", ROOT.parent, Path("/etc"), Path("/"))]
        assert [path for path in left if path.exists()] == []


def test_write_in_own_folders_is_possible(tmp_path: Path) -> None:
    """In the test's folder, from one folder of it to another, and in the home folder, which is a temporary one."""
    (tmp_path / "own").touch()
    (tmp_path / "other").mkdir()
    (tmp_path / "own").rename(tmp_path / "other" / "moved")
    (Path.home() / ".config").mkdir(exist_ok=True)
    assert (tmp_path / "other" / "moved").exists()
    assert Path(os.environ["HOME"]).name.startswith("boat-daq-home-")
