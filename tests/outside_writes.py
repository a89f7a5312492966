"""Pytest plugin: tests write in no folder but their own, and find nothing in the user's home folder.

While the tests run the home folder is an empty temporary one, for the programs that they start as well. Before and
after, /, /etc, the real home folder and the checkout are listed; the run fails where the listings differ. With xdist
the controller does both: its workers inherit the environment. The home folder is listed two levels deep, and whole
where the program keeps its files: deeper down, the other programs of a desktop write at any time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TypeAlias

import platformdirs
import pytest

Listing: TypeAlias = dict[Path, tuple[int, int] | None]

CACHES = {
    ".git": "git's own: an editor that shows its state refreshes the index",
    "__pycache__": "byte code, pytest's rewritten asserts, numba's machine code; compared with the source when loaded",
    ".pytest_cache": "which tests failed, for --last-failed",
    ".hypothesis": "examples that failed, tried again first: they can fail a test, not pass it",
    ".mypy_cache": "the type checker's, also an editor's: no test reads it",
    ".ruff_cache": "the linter's, also an editor's: no test reads it",
    ".import_linter_cache": "the import linter's: no test reads it",
}
HOME_LEVELS = 2
HOMES = ("HOME", "USERPROFILE", "APPDATA", "LOCALAPPDATA")
OTHER_HOMES = ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "MPLCONFIGDIR", "BOAT_DAQ_HOME")
FIXED_IN_TMP = ("XDG_RUNTIME_DIR", "DASK_TEMPORARY_DIRECTORY")  # without them Qt and Dask use a fixed name in /tmp


def listing(folder: Path, *, levels: int | None = None, without: Path | None = None) -> Listing:
    """Return the paths in a folder, files with size and time of the last change; {} where it cannot be read.

    Parameters
    ----------
    folder : what to list, without caches and Python environments.
    levels : how deep; names only then. No limit when None.
    without : a folder in it that is left out.
    """
    found: Listing = {}
    with suppress(OSError):  # not there, or not to be read by this user
        paths = list(folder.iterdir())
        if any(path.name == "pyvenv.cfg" for path in paths):
            return found
        for path in paths:
            if path.name in CACHES or path == without:
                continue
            if path.is_symlink() or not path.is_dir():
                found[path] = _state(path) if levels is None else None
            else:
                found[path] = None
                if levels != 1:
                    found |= listing(path, levels=levels and levels - 1, without=without)
    return found


def _state(path: Path) -> tuple[int, int] | None:
    """Return size and time of the last change; None for a file that went away meanwhile."""
    try:
        status = path.lstat()
    except OSError:
        return None
    return (status.st_size, status.st_mtime_ns)


def differences(before: Listing, after: Listing) -> list[str]:
    """Return a line for each path that appeared, changed or is gone, sorted by path."""
    lines = dict.fromkeys(after.keys() - before.keys(), "appeared")
    lines |= dict.fromkeys(before.keys() - after.keys(), "is gone")
    lines |= {path: "changed" for path in before.keys() & after.keys() if before[path] != after[path]}
    return [f"{path} {what}" for path, what in sorted(lines.items())]


@contextmanager
def temporary_home() -> Iterator[None]:
    """Make an empty folder the home folder, here and for programs started from here."""
    folder = tempfile.TemporaryDirectory(prefix="boat-daq-home-", ignore_cleanup_errors=True)
    with folder, pytest.MonkeyPatch.context() as patch:
        for name in (*HOMES, *FIXED_IN_TMP):
            patch.setenv(name, folder.name)
        for name in OTHER_HOMES:
            patch.delenv(name, raising=False)
        yield


class OutsideWrites:
    """Compares what tests may not change, before and after."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._real_home = Path.home()
        self._own = [
            find("boat-daq", appauthor=False)
            for find in (
                platformdirs.user_config_path,
                platformdirs.user_data_path,
                platformdirs.user_cache_path,
                platformdirs.user_log_path,
                platformdirs.user_state_path,
            )
        ]
        self._before: Listing = {}
        self._found: list[str] = []

    def pytest_sessionstart(self) -> None:
        """List what may not change."""
        self._before = self._listing()

    @pytest.hookimpl(wrapper=True, trylast=True)  # after the workers have ended, before the summary
    def pytest_sessionfinish(self, session: pytest.Session) -> Generator[None, None, None]:
        """Fail the run if anything has changed."""
        yield
        self._found = differences(self._before, self._listing())
        if self._found and session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Name what has changed."""
        if self._found:
            terminalreporter.section("written outside the tests' folders", red=True)
            terminalreporter.write_line(
                "By a test, or by another program meanwhile; a test may write in tmp_path only:"
            )
            for line in self._found:
                terminalreporter.write_line(f"  {line}")

    def _listing(self) -> Listing:
        found = listing(Path("/"), levels=1) | listing(Path("/etc")) | listing(self._root)
        found |= listing(self._real_home, levels=HOME_LEVELS, without=self._root)
        for folder in self._own:
            found |= listing(folder)
        return found


def pytest_configure(config: pytest.Config) -> None:
    """Watch from the process that starts the workers, or that runs the tests itself."""
    if not hasattr(config, "workerinput") and not config.option.collectonly:
        watch = OutsideWrites(config.rootpath)
        config.pluginmanager.register(watch, "outside writes of this run")
        home = ExitStack()
        home.enter_context(temporary_home())
        config.add_cleanup(home.close)
