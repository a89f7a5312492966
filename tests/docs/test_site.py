"""The site builds without a warning, and its pages can be followed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, runnable, script


@pytest.mark.nightly  # with every change by `make docs`, beside the linters: it takes 20 s of processor time
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-c", "docs"]
    built = subprocess.run(
        [*command, "-d", str(tmp_path / "doctrees"), ".", str(tmp_path / "site")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    page = (tmp_path / "site" / "docs" / "reference" / "commands.html").read_text(encoding="utf-8")
    assert 'id="boat-daq-shadow-solve"' in page


HOW_TOS = sorted((ROOT / "docs" / "how-to").glob("*.md"))


@pytest.mark.parametrize("page", HOW_TOS, ids=lambda path: path.stem)
def test_every_block_of_a_how_to_is_run(page: Path) -> None:
    """By the nightly test below: none is only to be read, apart from files included from elsewhere."""
    opened = re.findall(r"^```(.+)$|^```$", page.read_text(encoding="utf-8"), re.MULTILINE)[::2]
    kinds = re.compile(r"sh|(python|toml) \S+|\{(note|warning|literalinclude)\}.*")
    assert [kind for kind in opened if not kinds.fullmatch(kind)] == []


@pytest.mark.nightly
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="the pages use pseudo-terminals")
@pytest.mark.parametrize("page", runnable(), ids=str)
def test_commands_of_a_page_succeed(page: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "recordings", tmp_path / "recordings")
    programs = Path(sys.executable).parent
    done = subprocess.run(
        ["bash", "-c", script((ROOT / page).read_text(encoding="utf-8"), page.as_posix())],
        cwd=tmp_path,
        env={
            **os.environ,
            "PATH": f"{programs}:{os.environ['PATH']}",
            "PYTHONPATH": f"{ROOT}:{ROOT / 'tests' / 'docs' / 'stand_ins'}",
            "BOAT_DAQ_HOME": str(tmp_path / "home"),
        },
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
