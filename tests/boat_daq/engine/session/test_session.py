"""The session on a real pseudo-terminal: threads, ports, files and the board's own process."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import sqlite3
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from boat_daq.engine.plan import Plan
from boat_daq.engine.session import link_supervisor
from boat_daq.engine.session.reading_sources import enter_simulated_readings
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, Unit, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import LinkState, MessageKind, RunEnding, SessionState
from protocol.base.errors import DeviceError, RequestError, StorageError
from protocol.recording import RunEnd
from tests.boat_daq.engine.other_devices import Chatter
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

PLAN = Plan("short", "staircase", 1, step_kpa=45.0, ramp_kpa_per_s=20.0)
OVER = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """A session with its own settings and units, closed at the end whatever happened."""
    found = Session(Settings(), UnitLibrary(tmp_path / "units"))
    yield found
    found.close()


def begin(session: Session, url: str, path: Path | None = None, plan: Plan = PLAN, **options: Any) -> None:
    """Connect, record, arm and start."""
    session.connect(url)
    session.wait_connected()
    if path is not None:
        session.start_recording(path, {"operator": "tester"})
    session.arm(plan, **options)
    session.start()
    assert session.wait(lambda s: s.state is SessionState.RUNNING, 5).state is SessionState.RUNNING


def read(path: Path, query: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db, db:
        return db.execute(query).fetchall()


def meta(path: Path) -> dict[str, Any]:
    return {key: json.loads(value) for key, value in read(path, "SELECT key, value FROM session")}


@pytest.mark.fault(54, how="a session on the virtual board", times=1)
def test_a_whole_session_ends_in_one_closed_file(session: Session, tmp_path: Path) -> None:
    """Connect, record, run, read, stop at 50x: every step and reading in the file, one end, marked as simulated."""
    path, truth = tmp_path / "run.boat", tmp_path / "truth.csv"
    with serve(BoardSettings(speed=50.0, truth=str(truth))) as board:
        begin(session, board.url, path)
        seen = reached(session, lambda s: s.state in OVER, 60)
        assert (seen.state, seen.run_ended, seen.simulated) == (SessionState.IDLE, RunEnding(RunEnd.FINISHED), True)
        assert enter_simulated_readings(session, truth) == 5
        first = session.readings()[0]
        session.add_reading(first.step_id, 1.0, "typed", note="corrected")
        assert session.stop_recording() == path
    assert meta(path)["stop_reason"] == "finished"
    assert meta(path)["status"] == "closed"
    assert meta(path)["simulated"] is True
    assert meta(path)["plan"]["name"] == "short"
    assert [row[0] for row in read(path, "SELECT branch FROM step ORDER BY id")] == [
        "start", "unloading", "unloading", "loading", "loading", "end"
    ]  # fmt: skip
    assert read(path, "SELECT DISTINCT status FROM step") == [("reached",)]
    assert read(path, "SELECT count(*) FROM event WHERE kind = 'run_ended'") == [(1,)]
    readings = read(path, f"SELECT elongation_mm, source FROM reading WHERE step = {first.step_id} ORDER BY id")
    assert [source for _, source in readings] == ["simulated", "typed"]
    assert read(path, "SELECT elongation_mm FROM reading WHERE step = 1")[0][0] == pytest.approx(3.8, abs=0.3)


@pytest.mark.fault(24, how="eight threads press buttons over a pseudo-terminal", times=320)
def test_buttons_from_many_threads(session: Session, tmp_path: Path) -> None:
    """Eight threads press what they like for a while: no error but refusals, one end a run, vented at the end."""
    path = tmp_path / "run.boat"
    with serve(BoardSettings(speed=50.0)) as board:
        begin(session, board.url, path)
        failures: list[Exception] = []

        def press(button: Any) -> None:
            for _ in range(40):
                try:
                    with contextlib.suppress(RequestError):  # a refusal is an answer
                        button()
                except Exception as error:  # noqa: BLE001 - what the test looks for
                    failures.append(error)
                time.sleep(0.002)

        buttons = [session.pause, session.resume, session.stop, session.vent, session.clear_fault, session.start]
        buttons += [lambda: session.arm(PLAN), lambda: session.set_pressure(10.0)]
        threads = [threading.Thread(target=press, args=(button,)) for button in buttons]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        session.vent()
        over = (*OVER, SessionState.ARMED)  # where `arm` was the last to be pressed
        seen = reached(session, lambda s: s.last is not None and abs(s.last.pressure_kpa) < 1 and s.state in over, 10)
        session.stop_recording()
    assert failures == []
    assert seen.state in over and seen.last is not None and abs(seen.last.pressure_kpa) < 1
    begun = read(path, "SELECT count(*) FROM event WHERE kind = 'run_started'")[0][0]
    assert read(path, "SELECT count(*) FROM event WHERE kind = 'run_ended'") == [(begun,)]


def test_vent_does_not_wait_for_the_lock(session: Session) -> None:
    """While another thread holds the session's lock the vent leaves all the same."""
    with serve_in_thread(BoardSettings(speed=1.0)) as board:
        session.connect(board.url)
        session.wait_connected()
        session.set_pressure(30.0, 40.0)
        reached(session, lambda s: s.last is not None and s.last.pressure_kpa > 20, 5)
        venting = threading.Thread(target=session.vent)
        with session._lock:
            venting.start()
            time.sleep(0.1)
            sent = session._link.reader.statistics  # type: ignore[union-attr]
            assert sent.samples > 0
            time.sleep(1.2)
        venting.join()
        seen = reached(session, lambda s: s.last is not None and abs(s.last.pressure_kpa) < 1.0, 0.3)
    assert seen.last is not None and abs(seen.last.pressure_kpa) < 1.0


@pytest.mark.fault(11, how="virtual board's `unplug` on a pseudo-terminal, under pressure", times=1)
def test_unplugged_and_plugged_again(session: Session, tmp_path: Path) -> None:
    """The port goes under pressure: fault, data kept; the board comes back by its identity, and nothing moves."""
    path, link = tmp_path / "run.boat", tmp_path / "port"
    with serve_in_thread(BoardSettings(speed=5.0, faults=("unplug@15:10",), link=str(link))):
        begin(session, str(link), path, dataclasses.replace(PLAN, cycles=5))
        lost = reached(session, lambda s: s.link is LinkState.LOST, 10)
        assert (lost.link, lost.state) == (LinkState.LOST, SessionState.FAULT)
        back = reached(session, lambda s: s.link is LinkState.UP, 15)
        assert back.link is LinkState.UP
        time.sleep(0.5)
        seen = session.snapshot()
        assert seen.state is SessionState.FAULT and seen.last is not None and abs(seen.last.pressure_kpa) < 1
        session.stop_recording()
    assert meta(path)["stop_reason"].startswith("aborted: ")
    assert [row[0] for row in read(path, "SELECT reason FROM segment ORDER BY id")][:2] == ["opened", "reconnected"]
    assert read(path, "SELECT count(*) FROM event WHERE kind = 'run_ended'") == [(1,)]


@pytest.mark.fault(25, how="pause and resume over a pseudo-terminal", times=1)
def test_pause_makes_segments(session: Session, tmp_path: Path) -> None:
    """Paused and resumed: two more segments, the first of them marked as paused, and a second opening plateau."""
    path = tmp_path / "run.boat"
    with serve(BoardSettings(speed=50.0)) as board:
        begin(session, board.url, path)
        reached(session, lambda s: s.progress is not None and s.progress.cycle == 1, 10)
        session.pause()
        reached(session, lambda _: all(check.ok for check in session.preflight()), 5)
        session.resume()
        assert session.wait(lambda s: s.state in OVER, 30).run_ended == RunEnding(RunEnd.FINISHED)
        session.stop_recording()
    segments = read(path, "SELECT reason, paused FROM segment ORDER BY id")
    assert ("paused", 1) in segments and ("resumed", 0) in segments
    assert read(path, "SELECT count(*) FROM step WHERE branch = 'start'") == [(2,)]
    assert {row[0] for row in read(path, "SELECT DISTINCT cycle FROM step WHERE status = 'reached'")} >= {0, 2}


def test_a_plateau_waits_for_its_reading(session: Session, tmp_path: Path) -> None:
    """The run holds at the plateau until the reading is there; skipped, it continues without."""
    with serve(BoardSettings(speed=50.0)) as board:
        begin(session, board.url, tmp_path / "run.boat", wait_for_reading=True)
        seen = reached(session, lambda s: s.waiting_for_reading is not None, 10)
        assert seen.waiting_for_reading is not None and seen.waiting_for_reading.target_kpa == 50.0
        session.add_reading(seen.waiting_for_reading.step_id, 3.8, "typed")
        seen = reached(session, lambda s: s.waiting_for_reading is not None and s.waiting_for_reading.step_id == 2, 10)
        session.skip_reading()
        seen = reached(session, lambda s: s.progress is not None and s.progress.step == 3, 10)
        assert seen.progress is not None and seen.progress.step == 3
        assert session.steps_on_screen() == session.steps()
        session.stop_recording()
        with pytest.raises(RequestError, match="is closed"):  # it was kept in the table, and in no file
            session.add_reading(2, 3.0, "typed")
        assert [reading.step_id for reading in session.readings()] == [1]
        session.disconnect()
        reached(session, lambda s: s.link is LinkState.CLOSED, 10)
        session.connect(board.url)  # on its clock the earlier steps have no place on the screen
        assert session.steps() and not session.steps_on_screen()


def test_readings_that_make_no_sense(session: Session) -> None:
    """No such step, no length: refused, nothing kept."""
    for step, value in ((1, 1.0), (99, 2.0)):
        with pytest.raises(RequestError, match="no step"):
            session.add_reading(step, value, "typed")
    assert session.readings() == ()


def test_the_unit_s_limits_hold(session: Session) -> None:
    """A unit that takes 20 kPa at most: plan and manual pressure are refused, naming the unit."""
    session.units.save(Unit("weak", min_kpa=-10.0, max_kpa=20.0))
    with serve_in_thread(BoardSettings(speed=20.0)) as board:
        session.connect(board.url, unit="weak")
        session.wait_connected()
        for action in (lambda: session.arm(PLAN), lambda: session.set_pressure(21.0)):
            with pytest.raises(RequestError, match="the unit's limit of 20 kPa"):
                action()


@pytest.mark.fault(14, how="another version and silence on a pseudo-terminal", times=2)
@pytest.mark.parametrize(
    ("fault", "text"),
    [("wrong_protocol@0:2", "version 2"), ("silent@0:0", "no data")],
)
def test_what_is_no_board_is_refused(session: Session, fault: str, text: str) -> None:
    """Another version, silence: refused with the reason (how soon: `test_keeper`)."""
    with serve_in_thread(BoardSettings(faults=(fault,))) as board:
        session.connect(board.url)
        with pytest.raises(DeviceError) as refusal:
            session.wait_connected()
        assert text in refusal.value.cause and refusal.value.remedy
        assert session.snapshot().link is LinkState.FAILED


def test_another_device_is_refused(session: Session) -> None:
    """A device that prints something else is distinguished from silence."""
    with contextlib.closing(Chatter()) as device:
        session.connect(device.url)
        with pytest.raises(DeviceError, match="not a BOAT board"):
            session.wait_connected()
        session.close()


PROFILE = """
name = "Printing firmware"
kind = "lines"
[device]
n_sensors = 1
rate_hz = 100
pressure_min_kpa = -60
pressure_max_kpa = 80
[lines]
fields = [{ name = "time", unit = "ms" }, { name = "pressure", unit = "kPa" }, { name = "s1_signal", unit = "mV" }]
"""
COMMANDS = """
[commands]
set_pressure = "P{kpa:.1f}\\n"
vent = "V\\n"
"""


class PrintingDevice:
    """Firmware that prints lines and takes two commands; it never reports whether it holds. 20 times real time."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.received = b""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        pressure = target = 0.0
        time_ms = 0
        while not self._stop.wait(0.005):
            with contextlib.suppress(BlockingIOError):
                self.received += os.read(self.master, 1000)
            lines = self.received.split(b"\n")[:-1]
            target = 0.0 if not lines or lines[-1] == b"V" else float(lines[-1][1:])
            for _ in range(10):
                time_ms += 10
                pressure += max(-0.4, min(0.4, target - pressure))
                os.write(self.master, b"%d,%.3f,%.3f\n" % (time_ms, pressure, 1650 + pressure + time_ms % 7 / 10))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def printing(session: Session) -> Iterator[PrintingDevice]:
    """A device that prints; the session leaves before it does."""
    device = PrintingDevice()
    yield device
    session.close()
    device.close()
    os.close(device.master)
    os.close(device.slave)


def test_firmware_that_prints_runs_a_plan(session: Session, printing: PrintingDevice, tmp_path: Path) -> None:
    """A board without states, limits, watchdog or answers: arrival by measured pressure, and a warning."""
    path = tmp_path / "run.boat"
    session.connect(os.ttyname(printing.slave), PROFILE + COMMANDS)
    assert session.wait_connected().can_command
    session.start_recording(path)
    session.arm(PLAN)
    session.start()
    seen = reached(session, lambda s: s.state in OVER, 30)
    assert (seen.state, seen.run_ended) == (SessionState.IDLE, RunEnding(RunEnd.FINISHED))
    assert any(message.kind is MessageKind.NO_WATCHDOG for message in seen.messages)
    session.stop_recording()
    assert read(path, "SELECT DISTINCT status FROM step") == [("reached",)]
    assert meta(path)["sample_kind"] == "signal" and "Printing firmware" in meta(path)["profile"]
    assert printing.received.split(b"\n")[-2] == b"V"


def test_a_profile_without_commands_only_listens(session: Session, printing: PrintingDevice) -> None:
    """It records and plots; the sequence is off with a reason; nothing is ever sent."""
    session.connect(os.ttyname(printing.slave), PROFILE)
    seen = session.wait_connected()
    assert not seen.can_command and seen.why_read_only and not seen.simulated
    with pytest.raises(RequestError):
        session.arm(PLAN)
    session.vent()
    assert session.snapshot().messages[-1].cause == "VENT was not sent: this link is read only"
    session.disconnect()
    reached(session, lambda s: s.link is LinkState.CLOSED, 5)
    assert printing.received == b""


def test_simulator_of_a_device_is_known_by_its_profile(session: Session, printing: PrintingDevice) -> None:
    """It sends no HELLO: without the profile's word its runs would be taken for those of a real board."""
    session.connect(os.ttyname(printing.slave), PROFILE.replace("n_sensors", "simulated = true\nn_sensors", 1))
    assert session.wait_connected().simulated


def test_no_such_port_is_one_line(session: Session) -> None:
    """The port's name and the remedy, at once."""
    session.connect("/dev/ttyNOSUCH")
    with pytest.raises(DeviceError, match="/dev/ttyNOSUCH"):
        session.wait_connected()


@pytest.mark.fault(15, how="virtual board's `reset_on_open` on a pseudo-terminal", times=1)
def test_a_board_that_boots_when_its_port_opens_is_connected(session: Session) -> None:
    """Opening resets it and it boots for a second: connected all the same."""
    with serve_in_thread(BoardSettings(faults=("reset_on_open@0:1",))) as board:
        session.connect(board.url)
        assert session.wait_connected().link is LinkState.UP


def test_a_recording_needs_a_board_and_a_folder(session: Session, tmp_path: Path) -> None:
    """Nothing connected, no such folder, one at a time: refused, each with its reason."""
    with pytest.raises(RequestError, match="nothing to record"):
        session.start_recording(tmp_path / "a.boat")
    with serve_in_thread(BoardSettings(speed=20.0)) as board:
        session.connect(board.url)
        session.wait_connected()
        with pytest.raises(StorageError, match="no folder"):
            session.start_recording(tmp_path / "missing" / "a.boat")
        session.start_recording(tmp_path / "a.boat")
        with pytest.raises(RequestError, match="is being recorded"):
            session.start_recording(tmp_path / "b.boat")


@pytest.mark.fault(28, how="a recorder that cannot write, in a run over a pseudo-terminal", times=1)
def test_a_failing_disk_aborts_the_run(session: Session, tmp_path: Path) -> None:
    """The recorder cannot write: the run is aborted and vented, with the reason."""
    with serve_in_thread(BoardSettings(speed=5.0)) as board:
        begin(session, board.url, tmp_path / "a.boat")
        session.recording._storage_failed(StorageError("the disk is full", "free some space"))
        seen = reached(session, lambda s: s.state is SessionState.ABORTED, 5)
        assert seen.run_ended == RunEnding(RunEnd.ABORTED, "the disk is full")
        assert any(m.cause == "the disk is full" and m.remedy for m in seen.messages)


def test_a_run_that_is_disconnected_before_it_has_vented_is_over(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was "finishing" until the next connection, and the window asked before it closed."""
    monkeypatch.setattr(link_supervisor, "VENT_S", 0.0)
    with serve_in_thread(BoardSettings(speed=20.0)) as board:
        session.connect(board.url)
        session.wait_connected()
        session.arm(PLAN)
        session.start()
        reached(session, lambda s: s.last is not None and s.last.pressure_kpa > 20.0, 10)
        session.disconnect()
        assert reached(session, lambda s: s.link is LinkState.CLOSED, 5).state is SessionState.ABORTED


def test_nothing_is_armed_while_the_disk_saves_nothing(session: Session, tmp_path: Path, monkeypatch) -> None:
    """Armed all the same, the next run would be measured and not kept; with space again it is armed."""
    with serve_in_thread(BoardSettings(speed=5.0)) as board:
        session.connect(board.url)
        session.wait_connected()
        session.start_recording(tmp_path / "a.boat")
        recorder = session._journal.recorder
        assert recorder is not None
        monkeypatch.setattr(recorder, "_refusing", StorageError("the disk is full", "free some space"))
        with pytest.raises(RequestError) as refusal:
            session.arm(PLAN)
        assert (refusal.value.cause, refusal.value.remedy) == ("cannot arm: the disk is full", "free some space")
        assert session.snapshot().state is SessionState.IDLE
        monkeypatch.setattr(recorder, "_refusing", None)
        session.arm(PLAN)
        assert session.snapshot().state is SessionState.ARMED


def test_connect_and_disconnect_many_times(session: Session) -> None:
    """Eight times: always up again, no thread left over."""
    with serve_in_thread(BoardSettings(speed=50.0)) as board:
        for _ in range(8):
            session.connect(board.url)
            assert session.wait_connected().link is LinkState.UP
            session.disconnect()
            assert session.wait(lambda s: s.link is LinkState.CLOSED, 5).link is LinkState.CLOSED
    names = [thread.name for thread in threading.enumerate()]
    assert sum(name.startswith("reader") for name in names) == 0
