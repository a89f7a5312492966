"""The log and the bug report: lines once a second, bounded size, no waiting, no personal data."""

from __future__ import annotations

import getpass
import json
import os
import platform
import re
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from boat_daq.engine import log
from boat_daq.engine.bug_report import collect, contents, write_bug_report
from boat_daq.engine.settings import Settings, save_settings
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.workflows.run_session import SessionRequest, run_session
from protocol.base.errors import RequestError
from tests.boat_daq.engine.served_board import serve_in_thread

OPERATOR = "Ada Lovelace-Byron"
NOTE = "unit of Mrs Somerville, room 12"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A home of its own, no log running before or after."""
    log.stop_log()
    folder = tmp_path / "home of Ada"
    monkeypatch.setenv("BOAT_DAQ_HOME", str(folder))
    yield folder
    log.stop_log()


def logged(folder: Path) -> str:
    return "".join(path.read_text(encoding="utf-8") for path in sorted((folder / "log").iterdir()))


@pytest.mark.skipif(not hasattr(__import__("os"), "openpty"), reason="pseudo-terminals")
def test_a_session_is_logged_and_its_report_has_nothing_personal(place: Path, tmp_path: Path) -> None:
    """A session of about two seconds: a health line each second with its figures; the report holds log, settings,
    versions and summary, none of the names, notes, paths or samples; with `personal` the names are there.
    """
    save_settings(Settings(operator=OPERATOR, recordings=str(tmp_path / "home of Ada" / "runs")))
    run = tmp_path / "home of Ada" / "Ada 1.boat"
    with serve_in_thread(BoardSettings(speed=10.0)) as board:
        request = SessionRequest(board.url, run, duration_s=22.0, metadata={"operator": OPERATOR, "note": NOTE})
        run_session(request)
    log.note("error", f"{OPERATOR.split()[0]} saw that {run} cannot be written on {platform.node()}")
    log.note("info", f"mark: marked: {NOTE}")
    log.stop_log()
    lines = [line for line in logged(place).splitlines() if "health link=up" in line]
    assert len(lines) >= 2
    recording = [line for line in lines if "disk_free_mb=" in line]  # the line after the file is closed has no disk
    for text in ("rate_hz=", "lost=0", "crc=0", "lag_ms=", "queue=", "memory_mb="):
        assert text in recording[-1]

    out = write_bug_report(tmp_path / "bug.zip")
    assert {"versions.json", "settings.toml", "recording.json"} < set(contents(out))
    with zipfile.ZipFile(out) as archive:
        texts = {name: archive.read(name).decode() for name in archive.namelist()}
    whole = "\n".join(texts.values())
    for secret in (OPERATOR, "Lovelace", "Somerville", str(tmp_path), "home of Ada", "Ada 1"):
        assert secret not in whole, secret
    for name in (getpass.getuser(), platform.node()):
        assert not re.search(rf"(?<!\w){re.escape(name)}(?!\w)", whole), name
    assert json.loads(texts["recording.json"])["samples"] > 2_000
    assert json.loads(texts["recording.json"])["unit"] == ""
    assert sum(len(text) for text in texts.values()) < run.stat().st_size
    with pytest.raises(RequestError, match="exists already"):
        write_bug_report(tmp_path / "bug.zip")
    shown = collect()
    assert OPERATOR in shown["settings.toml"] and NOTE in shown["recording.json"]


def test_names_of_recordings_and_of_other_computers_stay_here(place: Path, tmp_path: Path) -> None:
    """A relative name with spaces, of a recording that is not the report's own, and the computer of a TCP board: gone
    from every line that names them; a board on this computer and the rest of the line stay.
    """
    log.start_log()
    for name in ("Mary Somerville 3.boat", "runs of Ada/mary.s@lab.example #1.boat", "x.boat"):
        log.note("info", f"{log.RECORDING}{name}")
        log.note("info", f"recording ended, stopped: {name}")
    log.note("error", "no space on the disk of mary.s@lab.example #1.boat, it ends")
    log.note("error", "Caroline Herschel.boat was recorded with board 7; now it is 8 (try: another)")
    log.note("info", "connecting to socket://mary-laptop.lab.example:4711, profile none")
    log.note("error", "mary-laptop.lab.example is not this machine")
    log.note("info", "connecting to socket://127.0.0.1:40549, profile none")
    log.stop_log()
    out = write_bug_report(tmp_path / "bug.zip")
    with zipfile.ZipFile(out) as archive:
        whole = "\n".join(archive.read(name).decode() for name in archive.namelist())
    for secret in ("Mary", "Somerville", "Ada", "mary", "lab.example", "Herschel", "Caroline"):
        assert secret not in whole, secret
    for kept in (
        "recording: [path].boat\n",
        "recording ended, stopped: [path].boat\n",
        "no space on the disk of [path].boat, it ends",
        "[path].boat was recorded with board 7; now it is 8",
        "connecting to socket://[host]:4711, profile none",
        "[host] is not this machine",
        "connecting to socket://127.0.0.1:40549, profile none",
    ):
        assert kept in whole, kept


def test_a_home_with_a_name_in_it_stays_here(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Spaces in the home's name, in tracebacks and by itself; settings edited by hand, in any of TOML's
    quotes, and so broken that nothing reads them; names of files that are no recordings, at the start of a message.
    """
    home_folder = tmp_path / "Caroline Herschel-Byron"
    monkeypatch.setenv("HOME", str(home_folder))
    monkeypatch.setenv("USERPROFILE", str(home_folder))
    place.mkdir()
    (place / "settings.toml").write_text(
        "operator = 'Mary Somerville'\nrate_hz = = 3\nnote = '''for\nFrau Gr\u00fcnwald'''\n"
        'changes = [\n    { utc = "2026", key = "operator", before = "Ada", after = "Ada King" },\n]\n',
        encoding="utf-8",
    )
    log.start_log()
    log.note_failure("the page failed", OSError(f'File "{home_folder}/venv/lib/x.py", line 7'))
    log.note("error", f"home is {home_folder} of Caroline Herschel-Byron, requested by Mary Somerville")
    log.note("error", "Profil von Mary.toml cannot be read: No such file (try: check the path)")
    log.note("error", "Readings of Mary.CSV: line 3 has no number")
    log.stop_log()
    with zipfile.ZipFile(write_bug_report(tmp_path / "bug.zip")) as archive:
        whole = "\n".join(archive.read(name).decode() for name in archive.namelist())
    for secret in ("Caroline", "Herschel", "Byron", "Mary", "Somerville", "nwald", "Ada", "King"):
        assert secret not in whole, secret
    for kept in (
        "rate_hz = = 3",
        "home is [home] of [user]",
        "[path].toml cannot be read",
        "[path].CSV: line 3",
        "line 7",
    ):
        assert kept in whole, kept


def test_the_log_is_bounded(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However much is noted, a process keeps three files of the size set, and the folder what fits beside them."""
    monkeypatch.setattr(log, "FILE_BYTES", 20_000)
    monkeypatch.setattr(log, "FOLDER_BYTES", 100_000)
    for number in range(30):
        old = place / "log" / f"2020-01-01_0000{number:02}_1.log"
        old.parent.mkdir(parents=True, exist_ok=True)
        old.write_bytes(b"x" * 9_000)
    path = log.start_log()
    assert path is not None
    for number in range(3_000):
        log.note("info", f"line {number} " + "y" * 40)
    log.stop_log()
    files = list((place / "log").iterdir())
    assert sum(file.stat().st_size for file in files) <= 100_000
    assert len([file for file in files if file.name.startswith(path.stem)]) == 3
    assert "line 2999" in path.read_text()


def test_logging_never_blocks_and_dropped_lines_are_counted(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the writer held up, ten times the queue's length is noted at once; the next line reports their number."""
    monkeypatch.setattr(log, "LINES_MAX", 100)
    released = threading.Event()
    monkeypatch.setattr(log._File, "emit", _held_up(log._File.emit, released))
    log.start_log()
    noting = threading.Thread(target=lambda: [log.note("info", f"line {n}") for n in range(1_000)])
    noting.start()
    noting.join(20)
    assert not noting.is_alive()
    released.set()
    for _ in range(40):
        time.sleep(0.01)
        log.note("info", "after")
    log.stop_log()
    written = logged(place)
    kept = len(re.findall(r"line \d+|after", written))
    dropped = [int(count) for count in re.findall(r"before this, (\d+) lines were dropped", written)]
    assert len(dropped) >= 1
    assert kept + sum(dropped) == 1_000 + 40


def _held_up(emit, released):  # type: ignore[no-untyped-def]
    def wait(self, record):  # type: ignore[no-untyped-def]
        released.wait()
        emit(self, record)

    return wait


def test_a_traceback_is_in_the_log_and_nowhere_else(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An unforeseen error is one line for the user; the log has the traceback."""
    from boat_daq.cli import explain

    try:
        raise ZeroDivisionError("never seen before")
    except ZeroDivisionError as error:
        cause, remedy = explain(error)
    assert "never seen before" in cause
    assert "bugreport" in remedy
    assert "Traceback" not in cause + capsys.readouterr().err
    assert "Traceback (most recent call last)" in logged(place)


def test_without_a_folder_there_is_no_log_and_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program works without one."""
    log.stop_log()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path / "file"))
    assert log.start_log() is None
    log.note("error", "nowhere")


def test_the_command_lists_the_contents(place: Path, tmp_path: Path) -> None:
    """Names of the files inside; a second report of that name is refused, exit 1 by the error's family."""
    from typer.testing import CliRunner

    from boat_daq.cli import app

    run = CliRunner().invoke(app, ["bugreport", "--out", str(tmp_path / "bug.zip"), "--json"])
    assert run.exit_code == 0
    shown = json.loads(run.stdout)
    assert shown["contents"] == list(contents(tmp_path / "bug.zip"))
    assert shown["personal"] is False
    again = CliRunner().invoke(app, ["bugreport", "--out", str(tmp_path / "bug.zip")])
    assert isinstance(again.exception, RequestError)


@pytest.mark.skipif(os.name != "posix", reason="permissions of files")
def test_a_password_in_an_address_reaches_neither_log_nor_report(place: Path, tmp_path: Path) -> None:
    """In messages, names of threads and tracebacks, and in the settings; the log is the user's and the group's."""
    secret = "".join(["tr0", "ub4", "dor"])  # no assignment that the search for secrets finds
    address = f"socket://ada:{secret}@127.0.0.1:5000"
    save_settings(Settings(operator=address))
    path = log.start_log("record")
    thread = threading.Thread(target=log.note, args=("info", f"opening {address}"), name=f"reader {address}")
    thread.start()
    thread.join()
    try:
        raise OSError(f"rtsp://:{secret}@camera/1 is gone")
    except OSError as error:
        log.note_failure("camera", error)
    log.stop_log()
    assert "[password]@" in logged(place)
    assert secret not in logged(place)
    assert path is not None and path.stat().st_mode & 0o777 & ~0o640 == 0
    report = write_bug_report(tmp_path / "report.zip")
    with zipfile.ZipFile(report) as archive:
        assert not any(secret in archive.read(name).decode() for name in archive.namelist())
