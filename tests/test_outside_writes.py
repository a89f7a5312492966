"""The plugin that watches what tests write, on small test runs of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.outside_writes import CACHES, differences, listing

ROOT = Path(__file__).resolve().parents[1]


PASSING = """
import os
from pathlib import Path

def test_in_own_folder(tmp_path):
    (tmp_path / "own").touch()

def test_in_temporary_home_folder():
    (Path.home() / ".config").mkdir()
"""
WRITING = """
def test_beside():
    Path("beside.txt").touch()

def test_over():
    Path("kept.txt").write_text("otherwise")

def test_removing():
    Path("gone.txt").unlink()

def test_in_real_home_folder():
    Path(os.environ["REAL_HOME"], "left").mkdir()

def test_in_the_programs_own_folder():
    Path(os.environ["REAL_HOME"], ".config", "boat-daq", "settings.toml").touch()
"""


def outcome_of(folder: Path, tests: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run tests in a checkout of their own, as a user with a home folder of its own."""
    home, checkout = folder / "home", folder / "home" / "checkout"
    (home / ".config" / "boat-daq").mkdir(parents=True)
    checkout.mkdir()
    (checkout / "kept.txt").write_text("as it was")
    (checkout / "gone.txt").touch()
    (checkout / "test_some.py").write_text(tests)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.outside_writes", "--rootdir", str(checkout), *options]
    env = {"HOME": str(home), "REAL_HOME": str(home), "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.run(
        [*command, "--basetemp", str(folder / "temporary")],
        capture_output=True, text=True, cwd=checkout, env=os.environ | env, timeout=100,
    )  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="the home folder is not HOME, nor .config the program's")
@pytest.mark.parametrize("workers", [(), ("-p", "xdist", "-n", "1")])
def test_run_fails_whose_tests_pass_but_write_elsewhere(tmp_path: Path, workers: tuple[str, ...]) -> None:
    """In the checkout and in the user's real home folder, with and without a worker; each path is named."""
    done = outcome_of(tmp_path, PASSING + WRITING, *workers)
    assert done.returncode == pytest.ExitCode.TESTS_FAILED, done.stdout + done.stderr
    assert "7 passed" in done.stdout
    home = tmp_path / "home"
    assert [line.strip() for line in done.stdout.splitlines() if line.startswith(f"  {home}")] == [
        f"{home}/.config/boat-daq/settings.toml appeared",
        f"{home}/checkout/beside.txt appeared",
        f"{home}/checkout/gone.txt is gone",
        f"{home}/checkout/kept.txt changed",
        f"{home}/left appeared",
    ]


def test_run_passes_whose_tests_write_in_their_folders(tmp_path: Path) -> None:
    """What is left in `tmp_path`, or by a program in a home folder that is a temporary one."""
    done = outcome_of(tmp_path, PASSING)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout
    assert [path.name for path in (tmp_path / "home" / ".config").iterdir()] == ["boat-daq"]


def test_listing_leaves_out_caches_and_environments(tmp_path: Path) -> None:
    """What is in them and nothing else: a file of the same folder is listed."""
    for name in (*CACHES, "environment", "package"):
        (tmp_path / name / "sub").mkdir(parents=True)
        (tmp_path / name / "sub" / "file").touch()
    (tmp_path / "environment" / "pyvenv.cfg").touch()
    assert {path.relative_to(tmp_path).as_posix() for path in listing(tmp_path)} == {
        "environment",
        "package",
        "package/sub",
        "package/sub/file",
    }


def test_differences_name_what_appeared_changed_and_went(tmp_path: Path) -> None:
    """Sorted by path; a limited depth sees names only."""
    (tmp_path / "a").write_text("1")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "c").touch()
    before, names = listing(tmp_path), listing(tmp_path, levels=1)
    (tmp_path / "a").write_text("22")
    (tmp_path / "b" / "c").unlink()
    (tmp_path / "d").symlink_to(tmp_path / "nowhere")
    assert differences(before, listing(tmp_path)) == [
        f"{tmp_path / 'a'} changed",
        f"{tmp_path / 'b' / 'c'} is gone",
        f"{tmp_path / 'd'} appeared",
    ]
    assert differences(names, listing(tmp_path, levels=1)) == [f"{tmp_path / 'd'} appeared"]
