"""A window that cannot be opened is refused with cause and remedy before Qt is asked, which would abort."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from boat_daq.engine import screen
from boat_daq.engine.screen import missing_library, require_screen, screen_error
from protocol.base.errors import RequestError
from tests.conftest import ROOT

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere Qt always finds a display")


def start(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the program with no display but what `variables` name."""
    kept = {name: value for name, value in os.environ.items() if name not in {*DISPLAYS}}
    command = [sys.executable, "-m", "boat_daq", *words]
    return subprocess.run(command, cwd=ROOT, env=kept | variables, capture_output=True, text=True, timeout=60)


DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


@pytest.fixture(autouse=True)
def without_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """No display, as over SSH."""
    for name in DISPLAYS:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.fault(64, how="no DISPLAY, and one that does not answer", times=2)
@pytest.mark.parametrize(("variables", "cause"), [({}, "neither DISPLAY"), ({"DISPLAY": ":77"}, ":77 does not answer")])
def test_window_without_a_display_says_so(variables: dict[str, str], cause: str) -> None:
    """Exit code 1, cause and remedy; no abort."""
    ended = start(**variables)
    assert (ended.returncode, ended.stdout) == (1, "")
    assert cause in ended.stderr
    assert "boat-daq demo --headless" in ended.stderr
    assert "einstall" not in ended.stderr


@pytest.mark.fault(64, how="a library of Qt that cannot be loaded", times=1)
def test_missing_library_is_named_with_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that cannot be loaded in place of libxcb-cursor, as on a fresh Debian."""
    (tmp_path / "libxcb-cursor.so.0").touch()
    ended = start("gui", DISPLAY=":77", LD_LIBRARY_PATH=str(tmp_path))
    assert ended.returncode == 1
    assert "the window needs libxcb-cursor.so.0" in ended.stderr
    if shutil.which("apt-get"):
        assert "sudo apt-get install libxcb-cursor0" in ended.stderr


@pytest.mark.parametrize(
    ("manager", "command"),
    [
        ("apt-get", "sudo apt-get install libxcb-cursor0"),
        ("dnf", "sudo dnf install 'libxcb-cursor.so.0()(64bit)'"),
        ("zypper", "sudo zypper install 'libxcb-cursor.so.0()(64bit)'"),
        ("pacman", "sudo pacman -S xcb-util-cursor"),
        ("", ""),
    ],
)
def test_packages_by_distribution(manager: str, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Found by the package manager that is there."""
    monkeypatch.setattr(screen.shutil, "which", lambda name: name if name == manager else None)
    monkeypatch.setattr(screen, "_loads", lambda _: True)
    found = missing_library(OSError("libxcb-cursor.so.0: cannot open shared object file"))
    assert found is not None
    assert found.command == command
    assert missing_library(OSError("undefined symbol")) is None


def test_platform_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """`offscreen` needs no display; a misspelled one is refused with those that exist."""
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    assert screen_error() is None
    monkeypatch.setenv("QT_QPA_PLATFORM", "ofscreen")
    with pytest.raises(RequestError, match="'ofscreen', which Qt does not know") as refused:
        require_screen()
    assert "offscreen" in refused.value.remedy


def test_wayland_display_that_does_not_answer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A socket left by a session that ended is no display."""
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-9")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("QT_QPA_PLATFORM", raising=False)
    assert "display wayland-9 does not answer" in str(screen_error())
