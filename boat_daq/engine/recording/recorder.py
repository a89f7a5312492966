"""The recorder: a sink that keeps everything, on its own thread, and loses nothing it has acknowledged.

Rules: the reading thread only puts a block into a queue. The writing thread, first in line where the system allows it,
commits what is there every 100 ms, bytes and the samples decoded from them in one transaction: a crash costs that time
and the disk's latency, which is measured (`at_risk_ms`). When the disk fails, the session is notified once, and what is
not yet written is kept in bounded memory and tried again: nothing is lost if disk space is freed in time. When that
memory is full, no later byte is taken, so that a file is always an unbroken beginning of the session."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from boat_daq.engine.link.block import Block
from boat_daq.engine.link.reader import raise_priority
from boat_daq.engine.log import note_failure
from boat_daq.engine.plan import StepMark
from boat_daq.engine.recording.file import RecordingFile, Statement, now_utc, set_meta
from boat_daq.engine.recording.resumption import RESUMED, BrokenRun, break_entry, break_text, reopen
from boat_daq.engine.recording.rows import Counters, RowMaker, camera_row, health_row, reading_row, step_row
from boat_daq.engine.snapshot import CameraReading, HealthSnapshot, Reading, RunEnding
from protocol.base.errors import RequestError, StorageError
from protocol.recording import RunEnd, describe_dtype, sample_dtype

COMMIT_S = 0.1
LATENCIES_KEPT = 100  # commits: ten seconds
RETRY_S = 1.0
MEMORY_BYTES_MAX = 128 * 2**20  # of what is not yet written
_ITEM_BYTES = 400  # a block costs its bytes about twice, and this

_Item: TypeAlias = Block | Callable[[RowMaker], Iterator[Statement]]


class Recorder:
    """Writes one recording, as a sink (`PortReader.add_recorder`). Every method is thread-safe.

    `meta`: values for `session` (keys of `protocol.recording.SESSION_KEYS`; uuid, status, times, version and the sample
    type are filled in here). `n_sensors` and `sample_kind` must be there. `health`: called once a second on the writing
    thread for a row of `health`; such as `LinkHealth.snapshot`. `on_error`: called once for each cause, on the writing
    thread, when the disk fails; the recorder keeps trying. It must not call `close`, which waits for that thread.
    `resumes`: the broken run whose recording is resumed, instead of creating one (`resumption`).
    """

    def __init__(
        self,
        path: Path,
        meta: Mapping[str, Any],
        *,
        health: Callable[[], HealthSnapshot | None] = lambda: None,
        on_error: Callable[[StorageError], None] = lambda _: None,
        resumes: BrokenRun | None = None,
    ) -> None:
        self.path = path
        self.warning = ""  # after `close`: what the reader should know of the file
        self._breaks: list[dict[str, Any]]
        if resumes is None:
            self._file, before, self._breaks = RecordingFile.create(path, meta), Counters(), []
        else:
            self._file, before, self._breaks = reopen(resumes, meta)
        channels = (meta if resumes is None else resumes.meta).get("channels") or ()
        dtype = describe_dtype(sample_dtype(int(meta["n_sensors"]), meta["sample_kind"], len(channels)))
        self._rows = RowMaker({**meta, "sample_dtype": dtype}, before)
        self._health = health
        self._on_error = on_error
        self._queue: list[tuple[int, _Item]] = []  # (host_ns, item)
        self._waiting: list[Statement] = []  # not yet committed
        self._oldest_ns: int | None = None  # of what waits
        self._held_bytes = 0
        self._latencies_ms: deque[float] = deque(maxlen=LATENCIES_KEPT)  # of the disk, newest last
        self._changed = threading.Condition()
        self._taken = self._committed = 0  # items
        self._steps = before.step
        self._break_kept = resumes is not None
        self.acknowledged = Counters()  # what is safely in the file, whatever happens to this process
        self._error: StorageError | None = None  # of the last commit
        self._misplaced: StorageError | None = None  # the file was moved or removed
        self._reported: set[str] = set()
        self._refusing: StorageError | None = None  # why no later byte is taken
        self._stopping = self._closed = False
        self._next_check_s = self._next_try_s = 0.0
        self._thread = threading.Thread(target=self._run, name=f"recorder {path.name}", daemon=True)
        self._thread.start()

    def __call__(self, block: Block) -> None:
        """Take a block; returns at once."""
        size = 2 * len(block.raw) + _ITEM_BYTES
        with self._changed:
            if self._refusing or self._closed:
                return
            if self._held_bytes + size > MEMORY_BYTES_MAX:
                self._refusing = StorageError(f"{self.path} is written too slowly", "What came before this is kept.")
                text = "no later data are recorded"
                self._put(block.host_ns, lambda rows: rows.event(block.host_ns, "host", "recording_full", None, text))
                return
            self._held_bytes += size
            self._put(block.host_ns, block)

    @property
    def queued(self) -> int:
        """Items and statements that wait for a commit."""
        return len(self._queue) + len(self._waiting)

    @property
    def lag_ms(self) -> float:
        """Age of the oldest thing not yet committed."""
        with self._changed:
            oldest = self._oldest_ns if self._oldest_ns or not self._queue else self._queue[0][0]
        return 0.0 if oldest is None else max(0.0, (time.monotonic_ns() - oldest) / 1e6)

    @property
    def failure(self) -> str:
        """Why nothing is saved at present; empty while all is."""
        error = self._failing
        return error.cause if error is not None else ""

    @property
    def _failing(self) -> StorageError | None:
        return self._refusing or self._error or self._misplaced

    def require_saving(self) -> None:
        """Refuse a run that would not be kept. RequestError: nothing is saved at present."""
        if (error := self._failing) is not None:
            raise RequestError(f"cannot arm: {error.cause}", error.remedy)

    @property
    def at_risk_ms(self) -> float:
        """What a crash would cost at most, as measured.

        That is the slowest commit of the last ten seconds and the commit interval, or what waits now if that is more.
        """
        with self._changed:
            slowest_ms = max(self._latencies_ms, default=0.0)
        return max(self.lag_ms, max(1e3 * COMMIT_S, slowest_ms) + slowest_ms)

    def attached(self, decoder_state: Mapping[str, Any]) -> None:
        """Take the decoder's state before the first bytes of a link (`add_recorder`)."""
        self._later(lambda rows, host_ns: rows.attached(decoder_state, host_ns))

    def new_segment(self, reason: str, *, paused: bool = False) -> None:
        """Begin a segment of the sequencer's ("paused", "resumed").

        A link, START and a restarted board begin one without this.
        """
        self._later(lambda rows, host_ns: rows.begin_segment(reason, host_ns, paused=paused))

    def run_resumed(self, cause: str, *, first_cycle: int, complete_cycles: int) -> None:
        """Keep the break of a run that resumes while its recording stayed open.

        A recording that was opened to be resumed has its break already: then nothing is kept.
        """
        if self._break_kept:
            self._break_kept = False
            return
        with self._changed:
            known = {"first_step": self._steps + 1, "first_cycle": first_cycle, "complete_cycles": complete_cycles}
        self._later(lambda rows, host_ns: self._break_here(rows, host_ns, cause, known))

    def _break_here(self, rows: RowMaker, host_ns: int, cause: str, known: dict[str, int]) -> Iterator[Statement]:
        """Give the rows of a break at the newest sample."""
        yield from rows.begin_segment(RESUMED, host_ns)
        here = {"host_ns": host_ns, "first_segment": rows.segment, "first_chunk": rows.chunks + 1, "last_result": 0}
        entry = break_entry(cause=cause, break_s=None, **here, **known)
        self._breaks = [*self._breaks, entry]
        yield from set_meta({"resumptions": self._breaks})
        yield from rows.event(host_ns, "host", "break_s", None, break_text(entry))

    def event(
        self, source: str, kind: str, *, value: float | None = None, text: str = "", time_us: int | None = None
    ) -> None:
        """Keep an event.

        `source`: board, host, user or sequencer. `time_us`: board time; the newest sample's when None.
        """
        self._later(lambda rows, host_ns: rows.event(host_ns, source, kind, value, text, time_us))

    def step(self, mark: StepMark, *, new: bool) -> None:
        """Keep a step of the sequencer as it begins (`new`), and what becomes known of it."""
        with self._changed:
            self._steps = max(self._steps, mark.number)
        self._later(lambda rows, _: iter([step_row(mark, rows.segment, new=new)]))

    def reading(self, reading: Reading) -> None:
        """Keep a reading of elongation. A later one for the same step corrects it and both stay."""
        statement = reading_row(reading)
        self._later(lambda *_: iter([statement]))

    def camera(self, reading: CameraReading) -> None:
        """Keep the reading of a camera's frame."""
        self._later(lambda rows, _: camera_row(reading, rows.here[0]))

    def update_meta(self, **values: Any) -> None:
        statements = set_meta(values)
        self._later(lambda *_: iter(statements))

    def flush(self, timeout_s: float = 5.0) -> bool:
        """Wait until all that was handed over so far is committed. False when it is not in time."""
        with self._changed:
            target = self._taken
            return self._changed.wait_for(lambda: self._committed >= target, timeout_s)

    def taken(self) -> int:
        """Return the number of items handed over so far, for `committed`."""
        with self._changed:
            return self._taken

    def committed(self, taken: int) -> bool:
        """Whether the items up to that number are in the file."""
        with self._changed:
            return self._committed >= taken

    def close(self, end: RunEnd, cause: str = "") -> Path:
        """Commit the rest, close into one file, check it, and return its path. May be called twice."""
        with self._changed:
            if self._closed:
                return self.path
            self._closed = True
        ended = {"status": "closed", "ended_utc": now_utc(), "ended_host_ns": time.monotonic_ns(), "run_end": end}
        ended["stop_reason"] = RunEnding(end, cause).text
        self._later(lambda rows, _: rows.flush(last=True))
        self._later(lambda *_: iter(set_meta(ended)))
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        self._thread.join()
        if self._error is not None:
            self._file.abandon()
            raise self._error
        if not self._file.close():
            self.warning = "another program has the recording open: the -wal file beside it is a part of it"
        return self.path

    def _later(self, make: Callable[[RowMaker, int], Iterator[Statement]]) -> None:
        host_ns = time.monotonic_ns()
        with self._changed:
            self._put(host_ns, lambda rows: make(rows, host_ns))

    def _put(self, host_ns: int, item: _Item) -> None:
        self._queue.append((host_ns, item))
        self._taken += 1

    def _run(self) -> None:
        """Commit every 100 ms and check the file every second, on the writing thread."""
        raise_priority()
        stopping, due_s = False, time.monotonic()
        while not stopping:
            due_s = max(due_s + COMMIT_S, time.monotonic())  # the time that a commit takes does not put off the next
            with self._changed:
                stopping = self._changed.wait_for(lambda: self._stopping, due_s - time.monotonic())
            now_s = time.monotonic()
            if now_s >= self._next_check_s:
                self._next_check_s = now_s + 1.0
                self._guarded(self._check_file)
            if stopping or now_s >= self._next_try_s:
                self._guarded(self._commit)

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do a part of the writing; every error is reported, and the thread continues."""
        try:
            work()
        except StorageError as error:
            self._report(error)
        except Exception as error:  # noqa: BLE001 - a writing thread must never end silently
            note_failure(f"{self.path} is not written properly", error)
            self._refusing = StorageError(f"{self.path} is not written properly: {error!r}", "Report this fault.")
            self._report(self._refusing)

    def _check_file(self) -> None:
        """Keep the link's counters. Detect a file that was removed, a disk nearly full, memory that is full."""
        health = self._health()
        if health is not None:
            self._later(lambda rows, host_ns: health_row(host_ns, health, *rows.here))
        if self._refusing is not None:
            self._report(self._refusing)
        try:
            self._file.check_place()
        except StorageError as error:
            self._misplaced = error
            raise
        if self._misplaced is not None:
            self._reported.discard(self._misplaced.cause)
            self._misplaced = None
        self._file.check_space()

    def _commit(self) -> None:
        """Put all that waits into one transaction; what fails waits for the next try."""
        with self._changed:
            taken, queue, self._queue = self._taken, self._queue, []
            if self._oldest_ns is None and queue:
                self._oldest_ns = queue[0][0]
        for _, item in queue:
            self._waiting.extend(self._rows.block(item) if isinstance(item, Block) else item(self._rows))
        self._waiting.extend(self._rows.flush())
        if self._waiting:
            self._write()
        self.acknowledged = Counters(chunks=self._rows.chunks, bytes=self._rows.bytes, samples=self._rows.samples)
        with self._changed:
            self._oldest_ns = None
            self._committed = taken
            self._held_bytes = sum(2 * len(i.raw) + _ITEM_BYTES for _, i in self._queue if isinstance(i, Block))
            self._changed.notify_all()

    def _write(self) -> None:
        began_s = time.monotonic()
        try:
            self._file.commit(self._waiting)
        except StorageError as error:
            self._error = error
            self._next_try_s = time.monotonic() + RETRY_S
            raise
        if self._error is not None:
            self._reported.discard(self._error.cause)
            self._error = None
        self._waiting = []
        with self._changed:
            self._latencies_ms.append(1e3 * (time.monotonic() - began_s))

    def _report(self, error: StorageError) -> None:
        """Report to the session, once for each cause."""
        if error.cause in self._reported:
            return
        self._reported.add(error.cause)
        self._on_error(error)
