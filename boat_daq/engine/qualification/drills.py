"""Fault drills: a fault is injected into a virtual board, and the program's results are compared with its truth.

Strategy: a drill serves a board on a real port, lets a real session record from it, and compares three things: the
recording, what the session reported, and the CSV in which the board keeps the truth of each sampling instant
(`DrillRig`, `compare`).

Rules: a drill states each of its criteria with what was seen; an exception in a drill is a failure of it. Everything
here is SIMULATED: it tests program, computer, disk and port, not the lab's board.

The rig of a fault drill: a board, a session, and the board's own truth to compare the recording with.

Samples are matched by board time, to the microsecond, so that what is missing and what is wrong is counted from the
truth and not by the program's own counters, which are then compared with it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from boat_daq.engine.plan import Plan
from boat_daq.engine.recording.file import RecordingFile, Statement
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.summary import Summary, summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.sample_columns import mv_per_count
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, ServedBoard, serve
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.own_packages import start_module
from protocol.base.errors import DeviceError, RecordingError
from protocol.recording import dtype_from_description, open_recording, read_session

PORT = "pty" if hasattr(os, "openpty") else "127.0.0.1:0"
SPEED = 8.0
VENTED_KPA = 2.0
WRONG_MV, WRONG_KPA = 15.0, 3.0  # ten times the noise of a sample
WAIT_S = 40.0
VENTING_S = 5.0
_ENDED = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)


@dataclass(frozen=True, slots=True)
class Criterion:
    """What must hold, what was seen, and whether it holds."""

    text: str
    seen: str
    kept: bool


@dataclass(frozen=True, slots=True)
class DrillResult:
    """Result of a drill, and on which boards.

    `lost` is a text on what is missing from the recording.
    """

    name: str
    injected: str
    criteria: tuple[Criterion, ...]
    lost: str
    counts: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    boards: tuple[BoardSettings, ...] = ()
    rate_hz: float | None = None

    @property
    def passed(self) -> bool:
        """Whether every criterion holds; none stated is none kept."""
        return bool(self.criteria) and all(criterion.kept for criterion in self.criteria)


class DrillRig:
    """The rig of one drill: an empty folder of its own, its recording `run`, and the board's `truth`.

    `served` are the boards it had.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.run, self.truth = folder, folder / "drill.boat", folder / "truth.csv"
        self.served: list[BoardSettings] = []

    @contextmanager
    def board(self, *faults: str, speed: float = SPEED) -> Iterator[ServedBoard]:
        """Serve a board with these faults."""
        settings = BoardSettings(port=PORT, speed=speed, faults=faults, truth=str(self.truth))
        self.served.append(settings)
        with serve(settings) as board:
            yield board

    @contextmanager
    def recording(self, board: ServedBoard) -> Iterator[Session]:
        """Connect and record until the end of the block, with the program's own settings and no unit of the lab's."""
        session = Session(Settings(), UnitLibrary(self.folder / "units"))
        try:
            session.connect(board.url, record_to=self.run, metadata={"note": "SIMULATED fault drill"})
            session.wait_connected()
            yield session
        finally:
            session.close()

    def run_plan(self, session: Session, plan: Plan) -> None:
        """Run a plan to its end, whatever that is."""
        session.arm(plan)
        session.start()
        seen = session.wait(lambda s: s.state is SessionState.RUNNING or s.state in _ENDED, WAIT_S)
        if seen.state is SessionState.RUNNING:
            seen = session.wait(lambda s: s.state in _ENDED, WAIT_S)
        if seen.state not in _ENDED:
            raise DeviceError(f"the run was still {seen.state} after {WAIT_S:g} s")
        session.wait(lambda s: s.last is not None and abs(s.last.pressure_kpa) < VENTED_KPA / 2, VENTING_S)


@dataclass(frozen=True, slots=True)
class TruthComparison:
    """A recording beside the board's truth, by board time; its properties are criteria that drills share.

    Attributes
    ----------
    missing : sampling instants of the board between a segment's first and last recorded one that are not recorded.
    absent : those between two segments, when there was no link.
    wrong : recorded ones that the board never took, or whose signal or pressure is beyond any noise.
    events : how many of each kind the recording has.
    """

    summary: Summary
    samples: npt.NDArray[np.void]
    truth: npt.NDArray[np.float64]  # [n, 3 + sensors]: time_us, pressure_kpa, elongation_mm, mV
    missing: int
    absent: int
    wrong: int
    events: dict[str, int]

    @property
    def loss_exact(self) -> Criterion:
        """Whether the program counts as lost what the truth shows as missing."""
        counted = self.summary.lost_samples
        seen = f"{counted} counted, {self.missing} missing by the board"
        return Criterion("lost samples are counted exactly", seen, counted == self.missing)

    @property
    def nothing_lost(self) -> Criterion:
        """Whether no sample is missing."""
        return Criterion("no sample is lost", f"{self.missing} of {len(self.samples)} missing", self.missing == 0)

    @property
    def nothing_wrong(self) -> Criterion:
        """Whether every recorded sample is one that the board took."""
        return Criterion("no wrong sample", f"{self.wrong} of {len(self.samples)}", self.wrong == 0)

    @property
    def vented(self) -> Criterion:
        """Whether the unit is without pressure at the end."""
        end_kpa = float(self.truth[-1, 1])
        text = f"the unit is vented, within {VENTED_KPA:g} kPa"
        return Criterion(text, f"{end_kpa:+.2f} kPa at the end", abs(end_kpa) <= VENTED_KPA)

    def reported(self, text: str, *kinds: str) -> Criterion:
        """Return whether an event of one of these kinds is in the recording."""
        seen = [kind for kind in kinds if self.events.get(kind)]
        return Criterion(text, ", ".join(seen) or "nothing", bool(seen))

    def result(self, name: str, injected: str, *criteria: Criterion, lost: str = "") -> DrillResult:
        """Return a drill's result, with the criterion that the recording derives identically from its bytes.

        Parameters
        ----------
        lost : a text on what the recording lacks, in place of the counted samples.
        """
        verdict, s = verify_recording(self.summary.path), self.summary
        identical = "the recording is identical to its bytes"
        last = Criterion(identical, verdict.difference or "identical", verdict.identical)
        counted = f"{self.missing} samples of {self.missing + len(self.samples)}" if self.missing else "nothing"
        without_link = f"; {self.absent} instants without a link" if self.absent else ""
        counts = {
            "samples": s.samples,
            "lost_said": s.lost_samples,
            "missing_by_truth": self.missing,
            "without_a_link": self.absent,
            "wrong": self.wrong,
            "gaps": s.gaps,
            "crc_errors": s.crc_errors,
            "segments": len(s.segments),
        }
        return DrillResult(name, injected, (*criteria, last), lost or counted + without_link, counts)


def compare(rig: DrillRig) -> TruthComparison:
    """Compare the recording with the board's truth."""
    with closing(open_recording(rig.run)) as db:
        meta = read_session(db)
        dtype = dtype_from_description(meta["sample_dtype"])
        blocks = db.execute("SELECT segment, samples FROM block ORDER BY id").fetchall()
        events = dict(db.execute("SELECT kind, count(*) FROM event GROUP BY kind").fetchall())
    samples = np.frombuffer(b"".join(blob for _, blob in blocks), dtype)
    segments = np.repeat([segment for segment, _ in blocks], [len(blob) // dtype.itemsize for _, blob in blocks])
    rows = [line.split(",")[2:] for line in _lines(rig.truth)]
    truth = np.array([row for row in rows if len(row) == len(rows[0])], dtype=float)
    truth[:, 0] = np.round(truth[:, 0] * 1e6)
    times = truth[:, 0].astype(np.int64)
    unrecorded = times[~np.isin(times, samples["time_us"])]
    missing = 0
    for segment in np.unique(segments):
        own = samples["time_us"][segments == segment]
        missing += int(((unrecorded >= own[0]) & (unrecorded <= own[-1])).sum())
    first_us, last_us = (samples["time_us"][[0, -1]]) if len(samples) else (0, -1)
    absent = int(((unrecorded >= first_us) & (unrecorded <= last_us)).sum()) - missing
    return TruthComparison(summarise(rig.run), samples, truth, missing, absent, _wrong(samples, truth, meta), events)


def _lines(truth: Path) -> list[str]:
    """Return the rows of a truth file."""
    return [line for line in truth.read_text(encoding="utf-8").splitlines() if line[:1].isdigit()]


def _wrong(samples: npt.NDArray[np.void], truth: npt.NDArray[np.float64], meta: dict[str, Any]) -> int:
    """Count samples that the board never took, or whose values no noise explains."""
    at = np.minimum(np.searchsorted(truth[:, 0], samples["time_us"]), len(truth) - 1)
    invented = truth[at, 0] != samples["time_us"]
    signal = (samples["lit"].astype(float) - samples["dark"]) * mv_per_count(meta)
    off = (np.abs(signal - truth[at, 3:]) > WRONG_MV).any(axis=1)
    off |= np.abs(samples["pressure_pa"] / 1000 - truth[at, 1]) > WRONG_KPA
    return int((invented | off).sum())


@contextmanager
def slow_commits(seconds: float) -> Iterator[None]:
    """Have every commit of this program take so much longer."""
    commit = RecordingFile.commit

    def slowly(file: RecordingFile, statements: Iterable[Statement]) -> None:
        time.sleep(seconds)
        commit(file, statements)

    setattr(RecordingFile, "commit", slowly)  # noqa: B010 - the drill replaces a slow disk
    try:
        yield
    finally:
        setattr(RecordingFile, "commit", commit)  # noqa: B010


def last_true(rig: DrillRig) -> tuple[float, float]:
    """Return time (us) and pressure (kPa) of the newest whole line of the truth."""
    lines = rig.truth.read_text(encoding="utf-8").splitlines()[2:-1] if rig.truth.exists() else []
    cells = lines[-1].split(",") if lines else ["0"] * 4
    return float(cells[2]) * 1e6, float(cells[3])


@contextmanager
def recorder_under_pressure(rig: DrillRig, board: ServedBoard) -> Iterator[subprocess.Popen[bytes]]:
    """Start `boat-daq record` in a process and wait until the unit is under pressure."""
    options = ["--port", board.url, "--plan", "calibration", "--out", str(rig.run)]
    nowhere = subprocess.DEVNULL
    process = start_module("boat_daq", "record", *options, stdout=nowhere, stderr=nowhere)
    try:
        deadline = time.monotonic() + WAIT_S
        while last_true(rig)[1] < 20.0:
            if time.monotonic() > deadline or process.poll() is not None:
                raise DeviceError("the unit never came under pressure")
            time.sleep(0.02)
        yield process
    finally:
        process.kill()
        process.wait(10)


ACKNOWLEDGED_S = 0.2  # of wall time: what a kill may cost

PLAN = Plan(
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
        rig.run_plan(session, dataclasses.replace(PLAN, cycles=20))
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
        rig.run_plan(session, PLAN)
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
    """A bladder that leaks behind the gauge.

    The pressure holds, the elongation does not.
    """
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
        rig.run_plan(session, dataclasses.replace(PLAN, cycles=20))
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


Drill = Callable[[DrillRig], DrillResult]
DRILLS: tuple[Drill, ...] = (loss, flips, unplug, pump_stall, leak, ambient_flash, estop, kill, host_stall, slow_disk)


def available() -> tuple[Drill, ...]:
    """Return the drills that this system can run.

    Windows cannot stop a program for a while.
    """
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
