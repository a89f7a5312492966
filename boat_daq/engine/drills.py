"""Fault drills: a fault is injected into a virtual board, and what the program saw is held against the board's truth.

Strategy: a drill serves a board on a real port, lets a real session record from it, and compares three things: the
recording, what the session said, and the CSV in which the board keeps the truth of each sampling instant. Samples are
matched by board time, to the microsecond, so that what is missing and what is wrong is counted by the board's side and
not by the program's own counters; those are then held against it.

Rules: a drill states each of its criteria with what was seen; an exception in a drill is a failure of it. Everything
here is SIMULATED: it tries program, computer, disk and port, not the lab's board.
"""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from boat_daq.engine.board_server import BoardSettings, ServedBoard, serve
from boat_daq.engine.plan import Plan
from boat_daq.engine.recording_file import RecordingFile, Statement
from boat_daq.engine.recovery import recover
from boat_daq.engine.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.snapshot import LinkState, SessionState
from boat_daq.engine.summary import Summary, summarise
from boat_daq.engine.verify import verify_recording
from boat_daq.errors import DeviceError
from protocol.recording import dtype_from_description, open_recording, read_session

SPEED = 8.0
VENTED_KPA = 2.0
WRONG_MV, WRONG_KPA = 15.0, 3.0  # ten times the noise of a sample: no honest one is so far from the truth
ACKNOWLEDGED_S = 0.2  # of wall time: what a kill may cost
WAIT_S = 40.0
VENTING_S = 5.0
_ENDED = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)

PLAN = Plan(
    name="drill", kind="continuous", cycles=2, ramp_kpa_per_s=20.0, settling_s=0.0, window_s=0.5, min_dwell_s=0.5,
)  # fmt: skip
STAIRS = Plan(
    name="drill", kind="staircase", cycles=1, high_kpa=40.0, low_kpa=0.0, min_kpa=-5.0, step_kpa=40.0,
    ramp_kpa_per_s=20.0, min_dwell_s=3.0, max_dwell_s=8.0,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Criterion:
    """What must hold, what was seen, and whether it holds."""

    text: str
    seen: str
    kept: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a drill came to; `lost` says in words what is missing from the recording."""

    name: str
    injected: str
    criteria: tuple[Criterion, ...]
    lost: str
    counts: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether every criterion holds; none stated is none kept."""
        return bool(self.criteria) and all(criterion.kept for criterion in self.criteria)


@dataclass(frozen=True, slots=True)
class Bench:
    """Where a drill works: an empty folder of its own."""

    folder: Path

    @property
    def run(self) -> Path:
        """The recording."""
        return self.folder / "drill.boat"

    @property
    def truth(self) -> Path:
        """The board's truth."""
        return self.folder / "truth.csv"

    @contextmanager
    def board(self, *faults: str, speed: float = SPEED) -> Iterator[ServedBoard]:
        """Serve a board with these faults."""
        port = "pty" if hasattr(os, "openpty") else "127.0.0.1:0"
        settings = BoardSettings(port=port, speed=speed, faults=faults, truth=str(self.truth))
        with serve(settings) as board:
            yield board

    def session(self) -> Session:
        """Return a session with the program's own settings, and no unit of the lab's."""
        return Session(Settings(), UnitLibrary(self.folder / "units"))

    @contextmanager
    def recording(self, board: ServedBoard) -> Iterator[Session]:
        """Connect and record until the end of the block."""
        session = self.session()
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
class Comparison:
    """A recording beside the board's truth, by board time.

    Attributes
    ----------
    samples : recorded.
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
    def vented_kpa(self) -> float:
        """True pressure at the end."""
        return float(self.truth[-1, 1])


def compare(bench: Bench) -> Comparison:
    """Hold the recording against the board's truth."""
    with closing(open_recording(bench.run)) as db:
        meta = read_session(db)
        dtype = dtype_from_description(meta["sample_dtype"])
        blocks = db.execute("SELECT segment, samples FROM block ORDER BY id").fetchall()
        events = dict(db.execute("SELECT kind, count(*) FROM event GROUP BY kind").fetchall())
    parts = [(segment, np.frombuffer(blob, dtype)) for segment, blob in blocks]
    samples = np.concatenate([part for _, part in parts]) if parts else np.empty(0, dtype)
    segments = np.concatenate([np.full(len(part), segment) for segment, part in parts]) if parts else np.empty(0)
    lines = bench.truth.read_text(encoding="utf-8").splitlines()
    rows = [line.split(",")[2:] for line in lines if line[:1].isdigit()]
    truth = np.array([row for row in rows if len(row) == len(rows[0])], dtype=float)
    truth[:, 0] = np.round(truth[:, 0] * 1e6)
    times = truth[:, 0].astype(np.int64)
    missing = 0
    for segment in np.unique(segments):
        own = samples["time_us"][segments == segment]
        inside = (times >= own[0]) & (times <= own[-1])
        missing += int(inside.sum() - np.isin(times[inside], own).sum())
    between = (times >= samples["time_us"][0]) & (times <= samples["time_us"][-1]) if len(samples) else times < 0
    absent = int(between.sum() - np.isin(times[between], samples["time_us"]).sum()) - missing
    return Comparison(summarise(bench.run), samples, truth, missing, absent, _wrong(samples, truth, meta), events)


def _wrong(samples: npt.NDArray[np.void], truth: npt.NDArray[np.float64], meta: dict[str, Any]) -> int:
    """Count samples that the board never took, or whose values no noise explains."""
    at = np.searchsorted(truth[:, 0], samples["time_us"])
    at = np.minimum(at, len(truth) - 1)
    invented = truth[at, 0] != samples["time_us"]
    signal = (samples["lit"].astype(float) - samples["dark"]) * (meta["vref_mv"] / 2 ** meta["adc_bits"])
    off = (np.abs(signal - truth[at, 3:]) > WRONG_MV).any(axis=1)
    off |= np.abs(samples["pressure_pa"] / 1000 - truth[at, 1]) > WRONG_KPA
    return int((invented | off).sum())


# ---- criteria that several drills share ----------------------------------------------------------------------------


def loss_is_exact(found: Comparison) -> Criterion:
    """What the program says is lost is what the board's truth says is missing."""
    said = found.summary.lost_samples
    return Criterion(
        "lost samples are counted exactly", f"{said} said, {found.missing} missing by the board", said == found.missing
    )


def nothing_lost(found: Comparison) -> Criterion:
    """No sample is missing."""
    return Criterion("no sample is lost", f"{found.missing} of {len(found.samples)} missing", found.missing == 0)


def nothing_wrong(found: Comparison) -> Criterion:
    """Every recorded sample is one that the board took."""
    return Criterion("no wrong sample", f"{found.wrong} of {len(found.samples)}", found.wrong == 0)


def vented(found: Comparison) -> Criterion:
    """The unit is without pressure at the end."""
    seen = f"{found.vented_kpa:+.2f} kPa at the end"
    return Criterion(f"the unit is vented, within {VENTED_KPA:g} kPa", seen, abs(found.vented_kpa) <= VENTED_KPA)


def identical(bench: Bench) -> Criterion:
    """The recording comes out the same from its raw bytes."""
    verdict = verify_recording(bench.run)
    return Criterion("the recording is identical to its bytes", verdict.difference or "identical", verdict.identical)


def said(found: Comparison, kinds: Sequence[str], text: str) -> Criterion:
    """One of these events is in the recording."""
    seen = [kind for kind in kinds if found.events.get(kind)]
    return Criterion(text, ", ".join(seen) or "nothing", bool(seen))


def _lost(found: Comparison) -> str:
    lost = f"{found.missing} samples of {found.missing + len(found.samples)}" if found.missing else "nothing"
    return f"{lost}; {found.absent} instants without a link" if found.absent else lost


def _counts(found: Comparison) -> dict[str, float]:
    s = found.summary
    return {
        "samples": s.samples,
        "lost_said": s.lost_samples,
        "missing_by_truth": found.missing,
        "without_a_link": found.absent,
        "wrong": found.wrong,
        "gaps": s.gaps,
        "crc_errors": s.crc_errors,
        "segments": len(s.segments),
    }


# ---- the drills ----------------------------------------------------------------------------------------------------


def loss(bench: Bench) -> Outcome:
    """Frames that never arrive, and samples that the board itself drops."""
    faults = ("index_gap@4:1", "index_gap@6:7", "index_gap@8:255", "dropped@14:10", "drop_byte@16:0.0005")
    with bench.board(*faults) as board, bench.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 30, WAIT_S)
    found = compare(bench)
    criteria = (loss_is_exact(found), nothing_wrong(found), _happened(found.missing >= 273, found), identical(bench))
    injected = "frames lost on the way (1, 7, 255), 10 dropped by the board, one byte in 2,000 lost"
    return Outcome("loss", injected, criteria, _lost(found), _counts(found))


def flips(bench: Bench) -> Outcome:
    """One byte in a thousand with a flipped bit."""
    with bench.board("bit_flips@3:1e-3") as board, bench.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 50, WAIT_S)
    found = compare(bench)
    criteria = (
        nothing_wrong(found),
        loss_is_exact(found),
        _happened(found.summary.crc_errors > 0, found),
        identical(bench),
    )
    return Outcome("flips", "a bit of one byte in 1,000 flipped", criteria, _lost(found), _counts(found))


def unplug(bench: Bench) -> Outcome:
    """The cable is pulled under pressure and put in again."""
    with bench.board("unplug@14:20") as board, bench.recording(board) as session:
        bench.run_plan(session, dataclasses.replace(PLAN, cycles=20))
        ended = session.snapshot()
        again = session.wait(lambda s: s.link is LinkState.UP and s.last is not None and s.last.time_s > 38, WAIT_S)
    found = compare(bench)
    back_kpa = found.truth[found.truth[:, 0] > 36e6, 1]
    highest = float(np.abs(back_kpa).max()) if len(back_kpa) else float("nan")
    criteria = (
        Criterion("the run ends in a fault", f"{ended.state}: {ended.latched}", ended.state is SessionState.FAULT),
        Criterion("the board is found again", str(again.link), again.link is LinkState.UP),
        Criterion(
            "no pressure goes on by itself", f"at most {highest:.2f} kPa once it is back", bool(highest <= VENTED_KPA)
        ),
        loss_is_exact(found),
        nothing_wrong(found),
        vented(found),
        identical(bench),
    )
    return Outcome("unplug", "port gone for 20 s of board time, in a run", criteria, _lost(found), _counts(found))


def pump_stall(bench: Bench) -> Outcome:
    """Pumps that get no further than 30 kPa."""
    with bench.board("stall@0:30") as board, bench.recording(board) as session:
        bench.run_plan(session, PLAN)
        ended = session.snapshot()
    found = compare(bench)
    state = ended.state in (SessionState.ABORTED, SessionState.FAULT)
    criteria = (
        Criterion("the run is given up", f"{ended.state}: {ended.run_ended}", state),
        said(found, ("step_timeout", "target_not_reached_pa"), "the recording says that the target was not reached"),
        Criterion("no cycle counts", f"{found.summary.cycles.complete} complete", found.summary.cycles.complete == 0),
        vented(found),
        nothing_lost(found),
        identical(bench),
    )
    return Outcome("stall", "pumps get no further than 30 kPa", criteria, _lost(found), _counts(found))


def leak(bench: Bench) -> Outcome:
    """A bladder that leaks behind the gauge: the pressure holds, the elongation does not."""
    with bench.board("leak@0:150") as board, bench.recording(board) as session:
        bench.run_plan(session, STAIRS)
    found = compare(bench)
    criteria = (
        said(found, ("not_steady",), "a plateau that drifts is said to be not steady"),
        vented(found),
        nothing_lost(found),
        identical(bench),
    )
    return Outcome("leak", "150 % of the bladder lost a minute", criteria, _lost(found), _counts(found))


def ambient_flash(bench: Bench) -> Outcome:
    """A lamp is switched on beside the sensor."""
    lamp_s = 15.0
    with bench.board(f"ambient_step@{lamp_s:g}:300") as board, bench.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 2 * lamp_s, WAIT_S)
    found = compare(bench)
    behind = found.samples["time_us"] > lamp_s * 1e6 + 1e5
    before = found.samples["time_us"] < lamp_s * 1e6
    dark = found.samples["dark"].astype(float)
    signal = found.samples["lit"].astype(float) - dark
    scale = 3300.0 / 4096.0
    moved = float(scale * np.abs(dark[behind].mean(axis=0) - dark[before].mean(axis=0)).min())
    shift = float(scale * np.abs(signal[behind].mean(axis=0) - signal[before].mean(axis=0)).max())
    n = min(int(behind.sum()), int(before.sum()))
    bound = 5.0 * float(scale * signal[before].std(axis=0).max()) * np.sqrt(2.0 / max(n, 1)) + 0.05
    criteria = (
        Criterion("the lamp is seen by the dark reading", f"{moved:.0f} mV", moved > 200),
        Criterion(f"the signal does not move, to {bound:.2f} mV", f"{shift:.3f} mV", shift <= bound),
        nothing_lost(found),
        identical(bench),
    )
    return Outcome("ambient flash", "a lamp beside the sensors, 300 mV", criteria, _lost(found), _counts(found))


def estop(bench: Bench) -> Outcome:
    """The e-stop is pressed in a run."""
    with bench.board("estop@12:30") as board, bench.recording(board) as session:
        bench.run_plan(session, dataclasses.replace(PLAN, cycles=20))
        ended = session.snapshot()
        session.wait(lambda s: s.last is not None and s.last.time_s > 20, WAIT_S)
    found = compare(bench)
    criteria = (
        Criterion("the run ends in a fault", f"{ended.state}: {ended.latched}", ended.state is SessionState.FAULT),
        vented(found),
        nothing_lost(found),
        identical(bench),
    )
    return Outcome("e-stop", "pressed in a run", criteria, _lost(found), _counts(found))


def kill(bench: Bench) -> Outcome:
    """The program is killed without a warning, under pressure."""
    with bench.board(speed=4.0) as board, _recorder_under_pressure(bench, board) as process:
        process.kill()
        process.wait(10)
        killed_us = last_true_us(bench)
        time.sleep(4.0)  # 16 s of board time: its watchdog of 5 s, and the way to zero
    was = summarise(bench.run).status
    recovery = recover(bench.run)
    found = compare(bench)
    missing_s = (killed_us - float(found.samples["time_us"][-1])) / 4e6
    criteria = (
        Criterion("the file says that it was interrupted", was, was == "interrupted"),
        Criterion("it is recovered in place", recovery.status, recovery.status == "recovered" and not recovery.damaged),
        Criterion(
            f"at most {ACKNOWLEDGED_S:g} s are missing at its end", f"{missing_s:.2f} s", missing_s <= ACKNOWLEDGED_S
        ),
        vented(found),
        nothing_lost(found),
        identical(bench),
    )
    lost = f"the last {max(missing_s, 0.0):.2f} s before the kill"
    return Outcome("kill", "kill -9 of the recording program, under pressure", criteria, lost, _counts(found))


def host_stall(bench: Bench) -> Outcome:
    """The computer stands still for three seconds, under pressure."""
    with bench.board(speed=4.0) as board, _recorder_under_pressure(bench, board) as process:
        process.send_signal(signal.SIGSTOP)
        time.sleep(3.0)
        during_kpa = abs(_last_true(bench)[1])
        process.send_signal(signal.SIGCONT)
        process.wait(WAIT_S)
    found = compare(bench)
    criteria = (
        Criterion(
            f"the board vents by itself, within {VENTED_KPA:g} kPa",
            f"{during_kpa:.2f} kPa while it stood",
            during_kpa <= VENTED_KPA,
        ),
        Criterion("the run is given up", f"exit code {process.returncode}", process.returncode == 1),
        loss_is_exact(found),
        nothing_wrong(found),
        vented(found),
        identical(bench),
    )
    return Outcome("host stall", "the program stopped for 3 s, under pressure", criteria, _lost(found), _counts(found))


def slow_disk(bench: Bench) -> Outcome:
    """Every commit takes 0.7 s."""
    with bench.board() as board, _slow_commits(0.7), bench.recording(board) as session:
        session.wait(lambda s: s.last is not None and s.last.time_s > 35, WAIT_S)
        health = session.snapshot().health
    found = compare(bench)
    lag_ms = health.lag_ms if health is not None else 0.0
    criteria = (
        Criterion("the lag is shown", f"{lag_ms:.0f} ms", lag_ms > 100),
        nothing_lost(found),
        nothing_wrong(found),
        identical(bench),
    )
    return Outcome("slow disk", "0.7 s for each commit", criteria, _lost(found), _counts(found))


@contextmanager
def _slow_commits(seconds: float) -> Iterator[None]:
    """Have every commit of this program take so much longer."""
    commit = RecordingFile.commit

    def slowly(file: RecordingFile, statements: Iterable[Statement]) -> None:
        time.sleep(seconds)
        commit(file, statements)

    setattr(RecordingFile, "commit", slowly)  # noqa: B010 - the drill stands in for a disk
    try:
        yield
    finally:
        setattr(RecordingFile, "commit", commit)  # noqa: B010


Drill = Callable[[Bench], Outcome]
DRILLS: tuple[Drill, ...] = (loss, flips, unplug, pump_stall, leak, ambient_flash, estop, kill, host_stall, slow_disk)


def available() -> tuple[Drill, ...]:
    """Return the drills that this system can run: Windows cannot stop a program for a while."""
    return tuple(drill for drill in DRILLS if drill is not host_stall or hasattr(signal, "SIGSTOP"))


def run_drill(drill: Drill, folder: Path) -> Outcome:
    """Run one drill in an empty folder; whatever goes wrong in it is its failure."""
    folder.mkdir(parents=True)
    begun = time.monotonic()
    try:
        outcome = drill(Bench(folder))
    except Exception as error:  # noqa: BLE001 - a drill that breaks has failed, and the next one is run
        name = drill.__name__.replace("_", " ")
        broke = Criterion("the drill comes to its end", f"{type(error).__name__}: {error}", False)
        outcome = Outcome(name, (drill.__doc__ or "").strip(), (broke,), "unknown")
    return dataclasses.replace(outcome, seconds=time.monotonic() - begun)


def _happened(seen: bool, found: Comparison) -> Criterion:
    """A drill in which the fault did not strike says nothing."""
    text = f"{found.missing} missing, {found.summary.crc_errors} damaged frames"
    return Criterion("the fault has struck", text, seen)


def _last_true(bench: Bench) -> tuple[float, float]:
    """Return time (us) and pressure (kPa) of the newest whole line of the truth."""
    lines = bench.truth.read_text(encoding="utf-8").splitlines()[2:-1] if bench.truth.exists() else []
    cells = lines[-1].split(",") if lines else ["0"] * 4
    return float(cells[2]) * 1e6, float(cells[3])


def last_true_us(bench: Bench) -> float:
    """Return the newest board time of the truth, us."""
    return _last_true(bench)[0]


@contextmanager
def _recorder_under_pressure(bench: Bench, board: ServedBoard) -> Iterator[subprocess.Popen[bytes]]:
    """Start `boat-daq record` in a process of its own and wait until the unit is under pressure."""
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    command = [sys.executable, "-m", "boat_daq", "record", "--port", board.url, "--plan", "calibration"]
    command += ["--out", str(bench.run)]
    process = subprocess.Popen(
        command, env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        deadline = time.monotonic() + WAIT_S
        while _last_true(bench)[1] < 20.0:
            if time.monotonic() > deadline or process.poll() is not None:
                raise DeviceError("the unit never came under pressure")
            time.sleep(0.02)
        yield process
    finally:
        process.kill()
        process.wait(10)
