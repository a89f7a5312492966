"""Fault drills: a fault is injected into a virtual board, and the program's results are compared with its truth.

Strategy: a drill serves a board on a real port, lets a real session record from it, and compares three things: the
recording, what the session reported, and the CSV in which the board keeps the truth of each sampling instant
(`DrillRig`, `compare`).

Rules: a drill states each of its criteria with what was seen; an exception in a drill is a failure of it. Everything
here is SIMULATED: it tests program, computer, disk and port, not the lab's board.
"""

from __future__ import annotations

import contextlib
import dataclasses
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from boat_daq.engine.control.sequencer import VENTED_KPA
from boat_daq.engine.plan import Plan
from boat_daq.engine.qualification.drill_rig import (
    WAIT_S,
    Criterion,
    DrillResult,
    DrillRig,
    TruthComparison,
    compare,
    last_true,
    recorder_under_pressure,
    slow_commits,
)
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from protocol.base.errors import RecordingError
from protocol.recording import BoardState

_SECOND_KPA = 5.0
_TOKEN = secrets.token_hex(16)
ACKNOWLEDGED_S = 0.2  # of wall time: what a kill may cost
_PLAN = Plan(
    name="drill", kind="continuous", cycles=2, ramp_kpa_per_s=20.0, settling_s=0.0, window_s=0.5, min_dwell_s=0.5,
)  # fmt: skip
STAIRS = Plan(
    name="drill", kind="staircase", cycles=1, high_kpa=40.0, low_kpa=0.0, min_kpa=-5.0, step_kpa=40.0,
    ramp_kpa_per_s=20.0, min_dwell_s=3.0, max_dwell_s=8.0,
)  # fmt: skip


def loss(rig: DrillRig) -> DrillResult:
    """Frames that never arrive, and samples that the board itself drops."""
    faults = ("index_gap@4:1", "index_gap@6:7", "index_gap@8:255", "dropped@14:10", "drop_byte@16:0.0005")
    with rig.board(*faults) as board, rig.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 30, WAIT_S)
    found = compare(rig)
    injected = "1, 7 and 255 frames, one byte in 2,000, 10 dropped by the board"
    happened = _happened(found.missing >= 273, found)
    return found.result("loss", injected, found.loss_exact, found.nothing_wrong, happened)


def flips(rig: DrillRig) -> DrillResult:
    """One byte in a thousand with a flipped bit."""
    with rig.board("bit_flips@3:1e-3") as board, rig.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 50, WAIT_S)
    found = compare(rig)
    happened = _happened(found.summary.crc_errors > 0, found)
    injected = "a bit of one byte in 1,000 flipped"
    return found.result("flips", injected, found.nothing_wrong, found.loss_exact, happened)


def unplug(rig: DrillRig) -> DrillResult:
    """The cable is pulled under pressure and put in again."""
    with rig.board("unplug@14:20") as board, rig.recording(board) as session:
        rig.run_plan(session, dataclasses.replace(_PLAN, cycles=20))
        ended = session.snapshot()
        again = session.wait(lambda s: s.link is LinkState.UP and s.last is not None and s.last.time_s > 38, WAIT_S)
    found = compare(rig)
    back_kpa = found.truth[found.truth[:, 0] > 36e6, 1]
    highest = float(np.abs(back_kpa).max()) if len(back_kpa) else float("nan")
    return found.result(
        "unplug",
        "port gone for 20 s of board time, in a run",
        _ends_in_fault(ended),
        Criterion("the board is found again", str(again.link), again.link is LinkState.UP),
        Criterion("no pressure resumes by itself", f"at most {highest:.2f} kPa once it is back", highest <= VENTED_KPA),
        found.loss_exact,
        found.nothing_wrong,
        found.vented,
    )


def pump_stall(rig: DrillRig) -> DrillResult:
    """Pumps that get no further than 30 kPa."""
    with rig.board("stall@0:30") as board, rig.recording(board) as session:
        rig.run_plan(session, _PLAN)
        ended = session.snapshot()
    found = compare(rig)
    aborted = ended.state in (SessionState.ABORTED, SessionState.FAULT)
    complete = found.summary.cycles.complete
    return found.result(
        "stall",
        "pumps get no further than 30 kPa",
        Criterion("the run is aborted", f"{ended.state}: {ended.run_ended.text if ended.run_ended else ''}", aborted),
        found.reported("the recording reports a target not reached", "step_timeout", "target_not_reached_pa"),
        Criterion("no cycle counts", f"{complete} complete", complete == 0),
        found.vented,
        found.nothing_lost,
    )


def leak(rig: DrillRig) -> DrillResult:
    """A bladder that leaks behind the gauge. The pressure holds, the elongation does not."""
    with rig.board("leak@0:150") as board, rig.recording(board) as session:
        rig.run_plan(session, STAIRS)
    found = compare(rig)
    not_steady = found.reported("a drifting plateau is reported as not steady", "not_steady")
    return found.result("leak", "150 % of the bladder lost a minute", not_steady, found.vented, found.nothing_lost)


def ambient_flash(rig: DrillRig) -> DrillResult:
    """A lamp is switched on beside the sensor."""
    lamp_s = 15.0
    with rig.board(f"ambient_step@{lamp_s:g}:300") as board, rig.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 2 * lamp_s, WAIT_S)
    found = compare(rig)
    behind = found.samples["time_us"] > lamp_s * 1e6 + 1e5
    before = found.samples["time_us"] < lamp_s * 1e6
    dark = found.samples["dark"].astype(float)
    signal = found.samples["lit"].astype(float) - dark
    scale = 3300.0 / 4096.0
    moved = float(scale * np.abs(dark[behind].mean(axis=0) - dark[before].mean(axis=0)).min())
    shift = float(scale * np.abs(signal[behind].mean(axis=0) - signal[before].mean(axis=0)).max())
    n = min(int(behind.sum()), int(before.sum()))
    bound = 5.0 * float(scale * signal[before].std(axis=0).max()) * np.sqrt(2.0 / max(n, 1)) + 0.05
    return found.result(
        "ambient flash",
        "a lamp beside the sensors, 300 mV",
        Criterion("the dark reading shows the lamp", f"{moved:.0f} mV", moved > 200),
        Criterion(f"the signal does not move, to {bound:.2f} mV", f"{shift:.3f} mV", shift <= bound),
        found.nothing_lost,
    )


def estop(rig: DrillRig) -> DrillResult:
    """The e-stop is pressed in a run."""
    with rig.board("estop@12:30") as board, rig.recording(board) as session:
        rig.run_plan(session, dataclasses.replace(_PLAN, cycles=20))
        ended = session.snapshot()
        session.wait(lambda s: s.last is not None and s.last.time_s > 20, WAIT_S)
    found = compare(rig)
    return found.result("e-stop", "pressed in a run", _ends_in_fault(ended), found.vented, found.nothing_lost)


def kill(rig: DrillRig) -> DrillResult:
    """The program is killed without a warning, under pressure."""
    with rig.board(speed=4.0) as board, recorder_under_pressure(rig, board) as process:
        process.kill()
        process.wait(10)
        killed_us = last_true(rig)[0]
        time.sleep(4.0)  # 16 s of board time: its watchdog of 5 s, and the way to zero
    was = summarise(rig.run).status
    recovery = recover(rig.run)
    found = compare(rig)
    missing_s = (killed_us - float(found.samples["time_us"][-1])) / 4e6
    missing = f"at most {ACKNOWLEDGED_S:g} s are missing at its end"
    return found.result(
        "kill",
        "the recording program killed without a warning (SIGKILL), under pressure",
        Criterion("the file is marked as interrupted", was, was == "interrupted"),
        Criterion("it is recovered in place", recovery.status, recovery.status == "recovered" and not recovery.damaged),
        Criterion(missing, f"{missing_s:.2f} s", missing_s <= ACKNOWLEDGED_S),
        found.vented,
        found.nothing_lost,
        lost=f"the last {max(missing_s, 0.0):.2f} s before the kill",
    )


def host_stall(rig: DrillRig) -> DrillResult:
    """The computer stalls for three seconds, under pressure."""
    with rig.board(speed=4.0) as board, recorder_under_pressure(rig, board) as process:
        process.send_signal(signal.SIGSTOP)
        time.sleep(3.0)
        during_kpa = abs(last_true(rig)[1])
        process.send_signal(signal.SIGCONT)
        process.wait(WAIT_S)
    found = compare(rig)
    vents = f"the board vents by itself, within {VENTED_KPA:g} kPa"
    return found.result(
        "host stall",
        "the program stopped for 3 s, under pressure",
        Criterion(vents, f"{during_kpa:.2f} kPa during the stall", during_kpa <= VENTED_KPA),
        Criterion("the run is aborted", f"exit code {process.returncode}", process.returncode == 1),
        found.loss_exact,
        found.nothing_wrong,
        found.vented,
    )


def slow_disk(rig: DrillRig) -> DrillResult:
    """Every commit takes 0.7 s."""
    with rig.board() as board, slow_commits(0.7), rig.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 35, WAIT_S)
        health = session.snapshot().health
    found = compare(rig)
    lag_ms = health.lag_ms if health is not None else 0.0
    shown = Criterion("the lag is shown", f"{lag_ms:.0f} ms", lag_ms > 100)
    return found.result("slow disk", "0.7 s for each commit", shown, found.nothing_lost, found.nothing_wrong)


def latest_pressure(rig: DrillRig) -> DrillResult:
    """A second pressure is set before the board has answered the first."""
    with rig.board(speed=1.0) as board, rig.recording(board) as session:
        session.set_pressure(30.0, 50.0)
        session.set_pressure(_SECOND_KPA, 50.0)
        session.wait(lambda s: s.last is not None and s.last.state is BoardState.HOLDING, WAIT_S)
        time.sleep(1.0)
        held_kpa = last_true(rig)[1]
        session.vent()
        session.wait(lambda s: s.last is not None and abs(s.last.pressure_kpa) < VENTED_KPA / 2, WAIT_S)
    found = compare(rig)
    there = abs(held_kpa - _SECOND_KPA) <= 1.0
    latest = Criterion("the second one is carried out", f"{held_kpa:.1f} kPa", there)
    return found.result("latest pressure", "30 kPa, and at once 5 kPa", latest, found.vented, found.nothing_lost)


def busy(rig: DrillRig) -> DrillResult:
    """Eight programs compute while a pressure is held."""
    with rig.board(speed=1.0) as board, rig.recording(board) as session, contextlib.ExitStack() as ends:
        session.set_pressure(_SECOND_KPA, 50.0)
        session.wait(lambda s: s.last is not None and s.last.state is BoardState.HOLDING, WAIT_S)
        for _ in range(8):
            ends.callback(subprocess.Popen([sys.executable, "-c", "while True: pass"]).kill)
        time.sleep(6.0)
        seen, held_kpa = session.snapshot(), last_true(rig)[1]
        session.vent()
        session.wait(lambda s: s.last is not None and abs(s.last.pressure_kpa) < VENTED_KPA / 2, WAIT_S)
    found = compare(rig)
    there = not seen.latched and abs(held_kpa - _SECOND_KPA) <= 1.0
    held = Criterion("the pressure is held", f"{held_kpa:.1f} kPa {seen.latched}", there)
    return found.result("busy", "eight programs that compute for 6 s", held, found.vented, found.nothing_lost)


def secop(rig: DrillRig) -> DrillResult:
    """A SECoP client reads, is refused, drives, and vents."""
    from boat_daq.engine.outlets.secop_node import SecopNode
    from boat_daq.engine.outlets.secop_server import CLIENTS, SecopServer

    with rig.board() as board, rig.recording(board) as session:
        session.wait(lambda s: s.last is not None, WAIT_S)
        readers = SecopServer(SecopNode(session, rig.folder), ("127.0.0.1", 0))
        drivers = SecopServer(SecopNode(session, rig.folder, allow_control=True), ("127.0.0.1", 0), token=_TOKEN)
        try:
            ident = _answers(drivers.port, "*IDN?")[0]
            refused = _answers(readers.port, "change pressure:target 10")[0]
            unasked = _answers(drivers.port, "change pressure:target 10")[0]
            beyond = _answers(drivers.port, f"_authenticate {_TOKEN}", "change pressure:target 1000")[1]
            _answers(drivers.port, f"_authenticate {_TOKEN}", "change pressure:_ramp 50", "change pressure:target 10")
            held = session.wait(lambda s: s.last is not None and s.last.state is BoardState.HOLDING, WAIT_S)
            with contextlib.ExitStack() as idle:  # they take all places
                for _ in range(CLIENTS):
                    taken = idle.enter_context(socket.create_connection(("127.0.0.1", readers.port), timeout=WAIT_S))
                    taken.sendall(b"ping 1\n")
                    taken.recv(100)
                vented = _answers(readers.port, "do vent:_vent")[0]
            seen = session.wait(lambda s: s.last is not None and s.last.state is BoardState.VENTED, WAIT_S)
            session.wait(lambda s: s.last is not None and abs(s.last.pressure_kpa) < 0.5, WAIT_S)
        finally:
            readers.close()
            drivers.close()
    found = compare(rig)
    reached = held.last is not None and abs(held.last.pressure_kpa - 10) < 1.5
    at_rest = seen.last is not None and seen.last.state is BoardState.VENTED and seen.state is SessionState.IDLE
    return found.result(
        "secop",
        "SECoP clients read, are refused, drive and vent",
        Criterion("the node identifies itself", ident, "SECoP" in ident),
        Criterion("a client without control is refused", refused, '"ReadOnly"' in refused),
        Criterion("a client without the token is refused", unasked, '"Disabled"' in unasked),
        Criterion("a pressure beyond the limits is refused", beyond, '"RangeError"' in beyond),
        Criterion("a client with control drives the pressure", f"{held.last and held.last.pressure_kpa}", reached),
        Criterion(
            "VENT is obeyed without control, where all places are taken", vented, vented.startswith("done") and at_rest
        ),
        found.vented,
        found.nothing_lost,
    )


def _answers(port: int, *requests: str) -> list[str]:
    with socket.create_connection(("127.0.0.1", port), timeout=WAIT_S) as client, client.makefile("rw") as lines:
        found = []
        for request in requests:
            lines.write(request + "\n")
            lines.flush()
            found.append(lines.readline().strip())
        return found


Drill = Callable[[DrillRig], DrillResult]
DRILLS: tuple[Drill, ...] = (
    loss, flips, unplug, pump_stall, leak, ambient_flash, estop, kill, host_stall, slow_disk, latest_pressure, busy,
    secop,
)  # fmt: skip


def available() -> tuple[Drill, ...]:
    """Return the drills that this system can run. Windows cannot stop a program for a while."""
    return tuple(drill for drill in DRILLS if drill is not host_stall or hasattr(signal, "SIGSTOP"))


def run_drill(drill: Drill, folder: Path) -> DrillResult:
    """Run one drill in an empty folder; whatever goes wrong in it is its failure."""
    folder.mkdir(parents=True)
    begun = time.monotonic()
    rig = DrillRig(folder)
    try:
        outcome = drill(rig)
    except Exception as error:  # noqa: BLE001 - a drill that breaks has failed, and the next one is run
        name = drill.__name__.replace("_", " ")
        broke = Criterion("the drill completes", f"{type(error).__name__}: {error}", False)
        outcome = DrillResult(name, (drill.__doc__ or "").partition("\n")[0], (broke,), "unknown")
    with contextlib.suppress(RecordingError):  # nothing was recorded
        outcome = dataclasses.replace(outcome, rate_hz=summarise(rig.run).rate_asked_hz)
    return dataclasses.replace(outcome, seconds=time.monotonic() - begun, boards=tuple(rig.served))


def _ends_in_fault(ended: SessionSnapshot) -> Criterion:
    """Return whether a run ended in a latched fault."""
    return Criterion("the run ends in a fault", f"{ended.state}: {ended.latched}", ended.state is SessionState.FAULT)


def _happened(seen: bool, found: TruthComparison) -> Criterion:
    """Return whether the fault occurred: a drill without it shows nothing."""
    text = f"{found.missing} missing, {found.summary.damaged_frames} damaged frames"
    return Criterion("the fault has occurred", text, seen)
