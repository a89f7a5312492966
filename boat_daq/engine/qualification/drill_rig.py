"""The rig of a fault drill: a board, a session, and the board's own truth to compare the recording with.

Samples are matched by board time, to the microsecond, so that what is missing and what is wrong is counted from the
truth and not by the program's own counters, which are then compared with it.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from boat_daq.engine.control.sequencer import VENTED_KPA
from boat_daq.engine.plan import Plan
from boat_daq.engine.recording.file import RecordingFile, Statement
from boat_daq.engine.recording.summary import Summary, summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.sample_columns import mv_per_count
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, ServedBoard, serve
from boat_daq.engine.snapshot import SessionState
from boat_daq.own_packages import start_module
from protocol.base.errors import DeviceError
from protocol.recording import dtype_from_description, open_recording, read_session

_PORT = "pty" if hasattr(os, "openpty") else "127.0.0.1:0"
SPEED = 8.0
WRONG_MV, WRONG_KPA = 15.0, 3.0  # ten times the noise of a sample
WAIT_S = 40.0
_VENTING_S = 5.0
_ENDED = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)


@dataclass(frozen=True, slots=True)
class Criterion:
    """What must hold, what was seen, and whether it holds."""

    text: str
    seen: str
    kept: bool


@dataclass(frozen=True, slots=True)
class DrillResult:
    """Result of a drill, and on which boards. `lost` is a text on what is missing from the recording."""

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
        # a name of its own: while it is unplugged, another program's board may take its number
        link = str(self.folder / "port") if _PORT == "pty" else None
        settings = BoardSettings(port=_PORT, speed=speed, faults=faults, truth=str(self.truth), link=link)
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
        session.wait(lambda s: s.last is not None and abs(s.last.pressure_kpa) < VENTED_KPA / 2, _VENTING_S)


@dataclass(frozen=True, slots=True)
class TruthComparison:
    """A recording beside the board's truth, by board time; its properties are criteria that drills share."""

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
        return Criterion(text, f"{end_kpa:+z.2f} kPa at the end", abs(end_kpa) <= VENTED_KPA)

    def reported(self, text: str, *kinds: str) -> Criterion:
        """Return whether an event of one of these kinds is in the recording."""
        seen = [kind for kind in kinds if self.events.get(kind)]
        return Criterion(text, ", ".join(seen) or "nothing", bool(seen))

    def result(self, name: str, injected: str, *criteria: Criterion, lost: str = "") -> DrillResult:
        """Return a drill's result, with the criterion that the recording derives identically from its bytes."""
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
