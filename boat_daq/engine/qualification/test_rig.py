"""The rig of a fault drill: a board, a session, and the board's own truth to compare the recording with.

Samples are matched by board time, to the microsecond, so that what is missing and what is wrong is counted from the
truth and not by the program's own counters, which are then compared with it.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from boat_daq.engine.plan import Plan
from boat_daq.engine.recording.file import RecordingFile, Statement
from boat_daq.engine.recording.summary import Summary, summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, ServedBoard, serve
from boat_daq.engine.snapshot import SessionState
from boat_daq.errors import DeviceError
from boat_daq.own_packages import start_module
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
    counts: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    boards: tuple[BoardSettings, ...] = ()
    rate_hz: float | None = None

    @property
    def passed(self) -> bool:
        """Whether every criterion holds; none stated is none kept."""
        return bool(self.criteria) and all(criterion.kept for criterion in self.criteria)


@dataclass(frozen=True, slots=True)
class DrillRig:
    """The rig of one drill.

    An empty folder of its own; `served` are the boards it had.
    """

    folder: Path
    served: list[BoardSettings] = field(default_factory=list)

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
        settings = BoardSettings(port=PORT, speed=speed, faults=faults, truth=str(self.truth))
        self.served.append(settings)
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
class TruthComparison:
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


def compare(rig: DrillRig) -> TruthComparison:
    """Compare the recording with the board's truth."""
    with closing(open_recording(rig.run)) as db:
        meta = read_session(db)
        dtype = dtype_from_description(meta["sample_dtype"])
        blocks = db.execute("SELECT segment, samples FROM block ORDER BY id").fetchall()
        events = dict(db.execute("SELECT kind, count(*) FROM event GROUP BY kind").fetchall())
    parts = [(segment, np.frombuffer(blob, dtype)) for segment, blob in blocks]
    samples = np.concatenate([part for _, part in parts]) if parts else np.empty(0, dtype)
    segments = np.concatenate([np.full(len(part), segment) for segment, part in parts]) if parts else np.empty(0)
    lines = rig.truth.read_text(encoding="utf-8").splitlines()
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
    return TruthComparison(summarise(rig.run), samples, truth, missing, absent, _wrong(samples, truth, meta), events)


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


def loss_is_exact(found: TruthComparison) -> Criterion:
    """Return whether the program counts as lost what the truth shows as missing."""
    lost = found.summary.lost_samples
    seen = f"{lost} counted, {found.missing} missing by the board"
    return Criterion("lost samples are counted exactly", seen, lost == found.missing)


def nothing_lost(found: TruthComparison) -> Criterion:
    """Return whether no sample is missing."""
    return Criterion("no sample is lost", f"{found.missing} of {len(found.samples)} missing", found.missing == 0)


def nothing_wrong(found: TruthComparison) -> Criterion:
    """Return whether every recorded sample is one that the board took."""
    return Criterion("no wrong sample", f"{found.wrong} of {len(found.samples)}", found.wrong == 0)


def vented(found: TruthComparison) -> Criterion:
    """Return whether the unit is without pressure at the end."""
    seen = f"{found.vented_kpa:+.2f} kPa at the end"
    return Criterion(f"the unit is vented, within {VENTED_KPA:g} kPa", seen, abs(found.vented_kpa) <= VENTED_KPA)


def identical(rig: DrillRig) -> Criterion:
    """Return whether the recording derives identically from its raw bytes."""
    verdict = verify_recording(rig.run)
    return Criterion("the recording is identical to its bytes", verdict.difference or "identical", verdict.identical)


def reported(found: TruthComparison, kinds: Sequence[str], text: str) -> Criterion:
    """Return whether one of these events is in the recording.

    Parameters
    ----------
    found : of the drill.
    kinds : of events, any of which is enough.
    text : of the criterion.
    """
    seen = [kind for kind in kinds if found.events.get(kind)]
    return Criterion(text, ", ".join(seen) or "nothing", bool(seen))


def lost(found: TruthComparison) -> str:
    """Return a text on what the recording lacks."""
    text = f"{found.missing} samples of {found.missing + len(found.samples)}" if found.missing else "nothing"
    return f"{text}; {found.absent} instants without a link" if found.absent else text


def counts(found: TruthComparison) -> dict[str, float]:
    """Return the counts of both sides."""
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


@contextmanager
def slow_commits(seconds: float) -> Iterator[None]:
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
