"""Pytest plugin: tests write in no folder but their own, and find nothing in the user's home folder.

While the tests run the home folder is an empty temporary one, for the programs that they start as well. On Linux the
kernel refuses a process that runs tests, and every program that it starts, to write anywhere but in temporary folders,
caches and devices (Landlock, https://docs.kernel.org/userspace-api/landlock.html): the test that tries fails, and what
other processes write meanwhile does not matter. A kernel without Landlock is named in the first lines of the run.
"""

from __future__ import annotations

import ctypes
import os
import shlex
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

CACHES = (".pytest_cache", ".hypothesis", ".import_linter_cache", "out")  # and __pycache__ of each folder
HOMES = ("HOME", "USERPROFILE", "APPDATA", "LOCALAPPDATA")
OTHER_HOMES = ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "MPLCONFIGDIR", "BOAT_DAQ_HOME")
FIXED_IN_TMP = ("XDG_RUNTIME_DIR", "DASK_TEMPORARY_DIRECTORY")  # without them Qt and Dask use a fixed name in /tmp
KEYMAPS = Path("/var/lib/xkb")  # where Xvfb, started by root, compiles its keymap
SHOTS = "BOAT_DAQ_SHOTS"  # a folder for the screenshots of tests/system

MOUNTER = pytest.StashKey["Mounter"]()

# linux/landlock.h
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION = 1  # flag of _CREATE_RULESET
_PATH_BENEATH = 1
_WRITE_FILE, _TRUNCATE = 1 << 1, 1 << 14
_WRITING = _WRITE_FILE | _TRUNCATE | sum(1 << bit for bit in range(4, 14))  # remove, make and, across folders, rename
_LEAST_VERSION = 3  # with truncation
_NO_NEW_PRIVILEGES = 38


def landlock_version() -> int:
    """Return the kernel's version of Landlock, or 0."""
    if sys.platform != "linux":
        return 0
    return max(0, int(ctypes.CDLL(None).syscall(_CREATE_RULESET, None, 0, _VERSION)))


def write_only_in(folders: Iterable[Path]) -> None:
    """Refuse this process and those that it starts to write anywhere else, for good.

    Raises
    ------
    OSError
        The kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)

    def call(number: int, *arguments: object) -> int:
        result = int(libc.syscall(number, *arguments))
        if result < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        return result

    attributes = struct.pack("Q", _WRITING)
    ruleset = call(_CREATE_RULESET, attributes, len(attributes), 0)
    for folder in folders:
        place = os.open(folder, os.O_PATH | os.O_CLOEXEC)
        call(_ADD_RULE, ruleset, _PATH_BENEATH, struct.pack("=Qi", _WRITING, place), 0)
        os.close(place)
    if libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    call(_RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)


class Mounter:
    """A shell that is started before this process is confined: the kernel refuses mounts to a confined process."""

    def __init__(self) -> None:
        self._shell = subprocess.Popen(["sh"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)

    def run(self, *command: str) -> tuple[int, str]:
        """Run mount or umount; return its exit code and its messages."""
        assert self._shell.stdin is not None
        assert self._shell.stdout is not None
        self._shell.stdin.write(f"{shlex.join(command)} 2>&1; echo exit $?\n")
        text = ""
        while not (line := self._shell.stdout.readline()).startswith("exit "):
            text += line
        return int(line.split()[1]), text.strip()

    def close(self) -> None:
        """End the shell."""
        self._shell.communicate()


def own_folders(config: pytest.Config) -> list[Path]:
    """Return the folders in which this run may write; caches are made."""
    caches = [config.rootpath / name for name in CACHES]
    caches += [folder / "__pycache__" for folder in {path.parent for path in sources(config.rootpath)}]
    for cache in caches:
        cache.mkdir(exist_ok=True)
    given = [config.option.basetemp, config.getoption("xmlpath", None), os.environ.get(SHOTS)]
    parents = [Path(path).absolute().parent for path in given if path]
    parents += [KEYMAPS] if KEYMAPS.is_dir() else []
    return [
        *caches, *parents, *(Path(name) for name in ("/dev", "/proc", sys.prefix, "/tmp")),
        Path(tempfile.gettempdir()),
    ]  # fmt: skip


def sources(root: Path) -> Iterator[Path]:
    """Yield the sources of a checkout."""
    for folder in (root, *(root / name for name in ("analysis", "boat_daq", "protocol", "tests"))):
        yield from folder.glob("*.py" if folder == root else "**/*.py")


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


def pytest_report_header() -> list[str]:
    """Say where tests may write anywhere."""
    if landlock_version() >= _LEAST_VERSION:
        return []
    return ["writes outside the tests' folders are not refused: this kernel has no Landlock"]


def pytest_configure(config: pytest.Config) -> None:
    """Give the whole run a temporary home, and confine the processes that run tests."""
    if config.option.collectonly:
        return
    if not hasattr(config, "workerinput"):
        home = ExitStack()
        home.enter_context(temporary_home())
        config.add_cleanup(home.close)
    if sys.platform == "linux":
        config.stash[MOUNTER] = Mounter()
        config.add_cleanup(config.stash[MOUNTER].close)
    starts_workers = getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput")
    if landlock_version() >= _LEAST_VERSION and not starts_workers:
        write_only_in(own_folders(config))
