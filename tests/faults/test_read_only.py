"""Folders, files and homes without permission to write: the message has cause and remedy, everything else works.

Root may write anywhere, so these run without the capability that lets it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from boat_daq.engine.simulator.server import BoardSettings, serve
from protocol.recording import RunEnd
from tests.boat_daq.engine.recording_source import Source, begin
from tests.faults.drill import ROOT
from tests.faults.old_recordings import write_recording

ROOTLESS = (
    ["setpriv", "--bounding-set=-dac_override,-dac_read_search"] if os.name == "posix" and os.geteuid() == 0 else []
)
pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or bool(ROOTLESS and not shutil.which("setpriv")), reason="permissions of Linux"
)
COMMANDS = """
import contextlib, io, json, sys
from boat_daq.cli import main

done = []
for arguments in json.loads(sys.argv[1]):
    out, err, sys.argv = io.StringIO(), io.StringIO(), ["boat-daq", *arguments]
    code = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as leaving:
            code = leaving.code or 0
    done.append((code, out.getvalue(), err.getvalue()))
print(json.dumps(done))
"""


@dataclass(frozen=True)
class Done:
    """Exit code and output of a command."""

    code: int
    out: str
    err: str

    def refused(self) -> str:
        """Return the message after checking that it is a cause and a remedy."""
        assert self.code == 1, self.err
        cause, remedy = self.err.strip().splitlines()[-2:]
        assert cause.startswith("error: ")
        assert "fault of the program" not in cause
        assert remedy.startswith("  try: ")
        return self.err


@contextmanager
def unwritable(folder: Path) -> Iterator[Path]:
    """Make a folder and all below it read-only for the block."""
    places = [folder, *folder.rglob("*")]
    for place in places:
        place.chmod(0o555 if place.is_dir() else 0o444)
    try:
        yield folder
    finally:
        for place in places:
            place.chmod(0o755 if place.is_dir() else 0o644)


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return a read-only folder of recordings, one closed and one interrupted."""
    folder = tmp_path_factory.mktemp("archive")
    write_recording(folder / "closed.boat")
    source = Source()
    recorder = begin(folder / "open.boat", source)
    recorder(source.next(500_000))
    assert recorder.flush()
    for suffix in ("", "-wal"):
        shutil.copy(folder / f"open.boat{suffix}", folder / f"interrupted.boat{suffix}")
    recorder.close(RunEnd.STOPPED)
    (folder / "open.boat").unlink()
    with unwritable(folder):
        yield folder


def results_of(home: Path, commands: dict[str, list[str]]) -> dict[str, Done]:
    """Run commands in one process of a user who may write neither in the archive nor at home; return the results."""
    env = {**os.environ, "BOAT_DAQ_HOME": str(home / "boat-daq"), "COLUMNS": "400", "QT_QPA_PLATFORM": "offscreen"}
    command = [*ROOTLESS, sys.executable, "-c", COMMANDS, json.dumps(list(commands.values()))]
    with unwritable(home):
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=env, timeout=200)
    assert done.returncode == 0, done.stderr
    return {name: Done(*found) for name, found in zip(commands, json.loads(done.stdout), strict=True)}


@pytest.fixture(scope="module")
def done(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Done]:
    """Return the results of the commands of a session."""
    home, place = tmp_path_factory.mktemp("home"), tmp_path_factory.mktemp("place")
    for suffix in ("", "-wal"):
        shutil.copyfile(archive / f"interrupted.boat{suffix}", place / f"copy.boat{suffix}")
    with serve(BoardSettings(speed=50.0)) as board:
        record = ["record", "--port", board.url, "--duration", "1", "--out"]
        commands = {
            "record here": [*record, str(place / "run.boat")],
            "record there": [*record, str(archive / "new.boat")],
            "bugreport": ["bugreport", "--out", str(archive / "a.zip")],
            "info": ["info", str(archive / "closed.boat")],
            "recover": ["recover", str(archive / "closed.boat")],
            "info of the interrupted": ["info", str(archive / "interrupted.boat")],
            "recover of the interrupted": ["recover", str(archive / "interrupted.boat")],
            "recover of its copy": ["recover", str(place / "copy.boat")],
        }
        return results_of(home, commands)


@pytest.fixture(scope="module")
def analysed(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Done]:
    """Return the results of commands that import the analysis."""
    closed, short = str(archive / "closed.boat"), ["--no-mcmc", "--no-shadow"]
    commands = {
        "report": ["report", closed, *short, "--out", str(archive / "a.html")],
        "export": ["export", closed, "--format", "csv", "--out", str(archive / "a.csv")],
        "batch": ["batch", str(archive), "--out", str(archive / "a.csv")],
        "analyze": ["analyze", closed, *short, "--seed", "7"],
    }
    return results_of(tmp_path_factory.mktemp("home"), commands)


def assert_untouched(archive: Path) -> None:
    """Check that the archive holds what it held."""
    assert {path.name for path in archive.iterdir()} == {"closed.boat", "interrupted.boat", "interrupted.boat-wal"}


@pytest.mark.fault(29, how="`record` with a home that may not be written, over a pty", times=1)
def test_recording_needs_no_writable_home(done: dict[str, Done]) -> None:
    """Without log, settings and units it records."""
    assert done["record here"].code == 0, done["record here"].err
    assert "0 lost" in done["record here"].out + done["record here"].err


@pytest.mark.fault(29, how="a folder without permission to write: record and bugreport", times=2)
@pytest.mark.parametrize("command", ["record there", "bugreport"])
def test_unwritable_folder_is_reported(done: dict[str, Done], archive: Path, command: str) -> None:
    """The message names path, reason and remedy; no partial file remains."""
    message = done[command].refused()
    assert str(archive) in message
    assert "Permission denied" in message
    assert_untouched(archive)


@pytest.mark.nightly
@pytest.mark.fault(29, how="a folder without permission to write: report, export and batch", times=3)
@pytest.mark.parametrize("command", ["report", "export", "batch"])
def test_unwritable_folder_of_an_analysis_is_reported(analysed: dict[str, Done], archive: Path, command: str) -> None:
    """The same for files made from a recording."""
    message = analysed[command].refused()
    assert str(archive) in message
    assert "Permission denied" in message
    assert_untouched(archive)


@pytest.mark.fault(29, how="a recording that may not be written: read and recovered", times=2)
def test_read_only_recording_is_read(done: dict[str, Done]) -> None:
    """A closed recording needs no recovery."""
    assert done["info"].code == 0
    assert done["recover"].out.startswith("the recording was closed properly")


@pytest.mark.nightly
@pytest.mark.fault(29, how="a recording that may not be written: analysed", times=1)
def test_result_that_cannot_be_stored_is_shown(analysed: dict[str, Done]) -> None:
    """The message states that it was not stored."""
    assert analysed["analyze"].code == 0, analysed["analyze"].err
    assert "was not stored" in analysed["analyze"].err


@pytest.mark.fault(29, how="an interrupted recording in a folder that may not be written", times=2)
def test_interrupted_recording_names_the_files_to_copy(done: dict[str, Done]) -> None:
    """Its log cannot be read there: the message names both files to copy, and the copy recovers."""
    for command in ("info of the interrupted", "recover of the interrupted"):
        message = done[command].refused()
        assert "was not closed" in message
        assert "interrupted.boat-wal" in message
    assert done["recover of its copy"].out.startswith("recovered")


def test_window_works_without_storing_its_settings(tmp_path: Path) -> None:
    """One message with the remedy; the values last as long as the window."""
    from boat_daq.viewmodels.common.preferences import Preferences

    messages: list[tuple[str, str]] = []
    (tmp_path / "file").touch()
    remembered = Preferences(tmp_path / "file", lambda *message: messages.append(message))
    remembered.set("page", "Runs")
    remembered.set("page", "Optics")
    assert remembered.get("page") == "Optics"
    assert len(messages) == 1
    assert "cannot be saved" in messages[0][0]
    assert messages[0][1]
