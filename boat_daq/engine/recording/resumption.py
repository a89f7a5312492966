"""Resume a run that was broken, by a crash or an unplugged board, in its own recording, at its next whole cycle.

Rules: nothing that was recorded is altered. What comes is appended: chunks, segments, steps and events with the next
free keys, behind an event `break_s` with its cause, its length and the cycle at which the run resumes.
`session.resumptions` keeps for each break what a reader of the file needs: the first segment behind it, the newest
result before it (which was of less than the whole run), and both clocks. The board, its unit and the plan must be those
of the beginning.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from boat_daq import __version__
from boat_daq.engine.plan import Plan, StepMark, plan_from_table, resume_point
from boat_daq.engine.recording.closed_run import read_readings, read_steps
from boat_daq.engine.recording.file import RecordingFile, now_utc, set_meta
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.rows import INSERT_EVENT, Counters
from boat_daq.engine.recording.upgrade import upgrade
from boat_daq.engine.snapshot import Reading
from protocol.base.errors import RequestError, StorageError
from protocol.recording import schema
from protocol.recording.writer_lock import is_being_written

RESUMED = "resumed after a break"  # reason of the segment behind it
# what must be as it was, and its name in messages; only what a wrong unit, board or firmware changes
_SAME = {
    "unit": "unit",
    "board_id": "board",
    "profile": "profile",
    "n_sensors": "number of sensors",
    "sample_kind": "kind of samples",
    "channels": "extra channels",
    "vref_mv": "reference voltage in mV",
    "adc_bits": "resolution in bits",
    "polarity": "polarity",
    "rate_hz": "rate in Hz",
}


@dataclass(frozen=True, slots=True)
class BrokenRun:
    """A recording whose run can be resumed."""

    path: Path
    meta: dict[str, Any]
    plan: Plan
    marks: tuple[StepMark, ...]
    readings: tuple[Reading, ...]
    first_cycle: int
    complete_cycles: int
    cause: str  # how it ended: "interrupted", "stopped", "aborted: ..."

    @property
    def unit(self) -> str:
        """Name of the unit, empty where none was named."""
        return str(self.meta["unit"] or "")

    def check_same(self, now: Mapping[str, Any], *, can_command: bool = True) -> None:
        """Refuse another unit, board, firmware or rate than the recording's."""
        if not can_command:
            raise RequestError("a run cannot be resumed over a read-only link", "connect the board itself")
        for key, name in _SAME.items():
            was, found = self.meta.get(key), now.get(key)
            if key == "channels" and not was:
                continue  # of an older file: its samples have none, the bytes have
            if (was or None) != (found or None):
                then, today = (str(value or "not named") for value in (was, found))
                cause = f"{self.path.name} was recorded with {name} {then:.60}; now it is {today:.60}"
                raise RequestError(cause, "resume it with the same board, unit and rate, or begin a new recording")

    def check_plan(self, plan: Plan) -> None:
        """Refuse another plan than the recording's. RequestError: names the first key that differs."""
        for key in Plan.__dataclass_fields__:
            was, given = getattr(self.plan, key), getattr(plan, key)
            if was != given:
                cause = f"the plan of {self.path.name} has {key} {was}, not {given}"
                remedy = "an interrupted run resumes with its own plan"
                raise RequestError(cause, remedy, command="omit --plan and its options")


def read_broken_run(path: Path) -> BrokenRun:
    """Return what is known of a run that is not finished; nothing is written."""
    if is_being_written(path):
        raise StorageError(f"{path} is being written by another program", "close it there first")
    schema.refuse_newer(path)
    with closing(schema.open_recording(path)) as db:
        meta = schema.read_session(db)
        if not isinstance(meta["plan"], dict):
            raise RequestError(f"{path.name} was recorded without a plan: it has no run to resume", "begin a new one")
        plan = plan_from_table(meta["plan"], f"the plan of {path.name}")
        marks, readings = read_steps(db), read_readings(db)
    first_cycle, complete = resume_point(plan, list(marks))
    if complete >= plan.cycles:
        raise RequestError(f"{path.name} has all its {plan.cycles} cycles", "begin a new recording")
    if schema.layout_version(path) < schema.SCHEMA_VERSION:
        cause = f"{path.name} has the layout of an older program"
        raise RequestError(cause, "begin a new recording", command=f"boat-daq upgrade {path}")
    ended = schema.RunEnd.INTERRUPTED if meta["status"] == "recording" else meta["stop_reason"] or meta["status"]
    return BrokenRun(path, meta, plan, marks, readings, first_cycle, complete, str(ended))


def prepare_resumption(path: Path, *, progress: Callable[[float, float], None] | None = None) -> BrokenRun:
    """Close properly what a killed session left, and return what is known of its run.

    It takes as long as reading the file: a window calls it on a worker.
    """
    broken = read_broken_run(path)
    recovery = recover(path, progress=progress)
    if recovery.damaged or recovery.path != path:
        cause = f"{path.name} is damaged: {recovery.damaged[0] if recovery.damaged else 'not all of it can be read'}"
        remedy = "begin a new recording; recovering this one saves what is readable"
        raise StorageError(cause, remedy, command=f"boat-daq recover {path}")
    upgrade(path)  # rows of the present layout would not fit an older one
    return replace(read_broken_run(path), cause=broken.cause)


def reopen(broken: BrokenRun, metadata: Mapping[str, Any]) -> tuple[RecordingFile, Counters, list[dict[str, Any]]]:
    """Open a recording to resume it, and record the break. Return the file, its counters and its breaks."""
    file = RecordingFile.reopen(broken.path, resume=True)
    try:
        counters = _count(broken.path)
        entry = _break(broken, counters, metadata)
        breaks = [*schema.breaks_of(broken.meta), entry]
        ended = ("ended_utc", "ended_host_ns", "stop_reason", "run_end")
        reopened = {"status": "recording", **dict.fromkeys(ended), "resumptions": breaks}
        event = (
            counters.event + 1, entry["host_ns"], None, None, "host", "break_s", entry["break_s"], break_text(entry)
        )  # fmt: skip
        file.commit([*set_meta(reopened), (INSERT_EVENT, event)])
    except BaseException:
        file.abandon()
        raise
    return file, replace(counters, event=counters.event + 1), breaks


def _count(path: Path) -> Counters:
    """Return the newest key of every table that is appended to."""
    newest = ("segment", "block", "event", "overview", "step", "result")
    counts = [f"(SELECT coalesce(max(id), 0) FROM {table}) AS {table}" for table in newest]  # noqa: S608 - names are ours
    sql = f"""
        SELECT {", ".join(counts)}, (SELECT coalesce(max(id), 0) FROM chunk) AS chunks,
            (SELECT coalesce(sum(length(raw)), 0) FROM chunk) AS bytes,
            (SELECT coalesce(sum(n), 0) FROM block) AS samples"""  # noqa: S608 - names are ours
    with closing(schema.open_recording(path)) as db:
        found = db.execute(sql)
        return Counters(**dict(zip((column[0] for column in found.description), found.fetchone(), strict=True)))


def _break(broken: BrokenRun, counters: Counters, metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entry of the break that ends now."""
    ended = broken.meta["ended_utc"]
    away = (datetime.now().astimezone() - datetime.fromisoformat(ended)).total_seconds() if ended else None
    return break_entry(
        cause=broken.cause,
        break_s=away,
        host_ns=time.monotonic_ns(),
        first_segment=counters.segment + 1,
        first_chunk=counters.chunks + 1,
        first_step=counters.step + 1,
        first_cycle=broken.first_cycle,
        complete_cycles=broken.complete_cycles,
        last_result=counters.result,
        **{key: metadata.get(key) for key in ("operator", "note", "port")},
    )


def break_entry(*, cause: str, break_s: float | None, **keys: Any) -> dict[str, Any]:
    """Return an entry of `session.resumptions` (keys: `protocol.recording`), made now."""
    return {"utc": now_utc(), "cause": cause, "break_s": break_s, "program_version": __version__, **keys}


def break_text(entry: Mapping[str, Any]) -> str:
    """Return the text of the event `break_s`."""
    n = entry["complete_cycles"]
    whole = f"{n} complete cycle{'' if n == 1 else 's'}"
    return f"interrupted ({entry['cause']}) after {whole}; resumes at cycle {entry['first_cycle']}"
