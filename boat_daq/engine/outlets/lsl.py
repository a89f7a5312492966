"""Lab Streaming Layer: an outlet of samples and one of markers.

Strategy: a thread of its own empties a `SampleQueue` and pushes what it holds; the reading thread only appends. liblsl
keeps a buffer for each inlet, so that one which does not read costs memory for `BUFFER_S`, and nothing else.

Time: the board's clock is related to the host's by least squares over the arrivals (`ClockFit`), the host's monotonic
clock to LSL's by their difference. A stamp contains the mean delay of the link; its scatter is that of the fit, not of
the arrivals. The relation is stated by a marker of kind `clock`, after `FIT_MIN_S` and once a minute.

liblsl listens on every interface and cannot be told otherwise. Unless the network is allowed, its sockets are bound to
the loopback device; where the system cannot do that, the outlet is refused.

Sources: labstreaminglayer.readthedocs.io; liblsl, src/api_config.cpp and src/socket_utils.cpp, for what it listens on.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.link.health import ClockFit
from boat_daq.engine.log import note_failure
from boat_daq.engine.session.measured_blocks import MeasuredBlock, SampleQueue
from boat_daq.engine.session.session import Session
from protocol.base.errors import RequestError
from protocol.recording import ExtraChannel

_EVERY_S = 0.02
BUFFER_S = 60  # kept for an inlet that does not read
CLOCK_EVERY_S = 60.0
STREAM, MARKERS = "boat-daq samples", "boat-daq markers"
LOCAL = "[multicast]\nResolveScope = machine\n[ports]\nIPv6 = disable\n[log]\nlevel = -2\n"
_NETWORK = "[log]\nlevel = -2\n"

Convert = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]


class LslOutlet:
    """Streams a connected session until `close`.

    `convert`: signals [n, sensors] to elongation and its U, mm; None without a calibration.
    """

    def __init__(
        self,
        session: Session,
        pylsl: Any,
        *,
        network: bool = False,
        convert: Convert | None = None,
        calibration_id: str = "",
    ) -> None:
        ring, seen = session.live.ring, session.snapshot()
        if ring is None or seen.last is None:
            raise RequestError("no sample has arrived yet", "connect a board first")
        pylsl.set_config_content(_NETWORK if network else LOCAL)
        self._session, self._lsl, self._convert = session, pylsl, convert
        self.others = session.live.other_channels()
        self._columns = (len(seen.last.signal_mv), [channel.column for channel in self.others])
        self._channels = _channels(len(seen.last.signal_mv), self.others)
        board_id = seen.hello.board_id if seen.hello else str(seen.port)
        # an inlet seeks a lost stream by its source: virtual boards, which have one identity, must not be confused
        self.source_id = f"{board_id} {os.getpid()}" if seen.simulated else board_id
        rate_hz = seen.health.asked_hz if seen.health and seen.health.asked_hz else session.settings.rate_hz
        self.pushed = self.skipped = 0
        self._last_s = 0.0  # stamp of the newest sample
        self._clock, self._offset_s = ClockFit(), _offset_s(pylsl)
        self._clock_told_s = 0.0
        self._calibrations: deque[str] = deque()  # to be marked
        about = {
            "board_id": board_id,
            "unit": seen.unit,
            "calibration_id": calibration_id,
            "simulated": str(seen.simulated).lower(),
            "clock": "board time by least squares on the arrivals; contains the mean delay of the link",
        }
        with _kept_local(not network):
            self._samples = self._open(STREAM, "BOAT", list(self._channels), float(rate_hz), "double64", about)
            self._markers = self._open(MARKERS, "Markers", ["marker"], 0.0, "string", about)
        self._told = _Told(session)
        self._queue = SampleQueue(session.live.target_kpa, lambda: session.mv_per_count, session.live.other_channels)
        self._remove = session.live.add_sink(self._queue)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="LSL outlet", daemon=True)
        self._thread.start()

    @property
    def clock(self) -> dict[str, float | None]:
        """The board's clock against LSL's: drift, scatter of the arrivals, and difference of host and LSL."""
        slope = self._clock.slope
        drift_ppm = None if slope is None else (slope - 1.0) * 1e6
        return {"drift_ppm": drift_ppm, "jitter_ms": self._clock.jitter_ms, "host_offset_s": self._offset_s}

    @property
    def is_read(self) -> bool:
        """Whether an inlet of the samples is open."""
        return bool(self._samples is not None and self._samples.have_consumers())

    def use(self, convert: Convert | None, calibration_id: str) -> None:
        """Convert by another calibration from now on; a marker of kind `calibration` names it."""
        self._convert = convert
        self._calibrations.append(calibration_id)

    def close(self) -> None:
        """Push what waits, and withdraw the streams."""
        self._stop.set()
        self._thread.join()
        self._remove()
        self._push_waiting()
        self._samples = self._markers = None

    def _open(
        self, name: str, kind: str, labels: list[str], rate_hz: float, form: str, about: Mapping[str, str]
    ) -> Any:
        info = self._lsl.StreamInfo(name, kind, len(labels), rate_hz, form, f"{self.source_id} {kind}")
        head = info.desc().append_child("acquisition").append_child_value("manufacturer", "boat-daq")
        for key, value in about.items():
            head.append_child_value(key, value)
        channels = info.desc().append_child("channels")
        for label in labels:
            child = channels.append_child("channel").append_child_value("label", label)
            child.append_child_value("unit", self._channels.get(label, ""))
        return self._lsl.StreamOutlet(info, max_buffered=BUFFER_S)

    def _run(self) -> None:
        while not self._stop.wait(_EVERY_S):
            try:
                self._push_waiting()
                self._push_markers()
            except Exception as error:  # noqa: BLE001 - an outlet's fault must not end the session
                note_failure("LSL outlet", error)

    def _push_waiting(self) -> None:
        block = self._queue.take()
        if block is None or (block.signal_mv.shape[1], list(block.others)) != self._columns:  # another board
            return
        self.skipped += block.skipped
        nan = np.full(len(block), np.nan)
        convert = self._convert
        mm, u_mm = (nan, nan) if convert is None else convert(block.signal_mv)
        usual = [block.signal_mv, block.pressure_kpa, block.target_kpa, mm, u_mm]
        values = np.column_stack([*usual, *block.others.values()])
        self._samples.push_chunk(np.ascontiguousarray(values), self._stamps(block).tolist())
        self.pushed += len(block)

    def _stamps(self, block: MeasuredBlock) -> NDArray[np.float64]:
        """Return LSL's time of each sample."""
        time_us, host_ns = np.round(block.time_s * 1e6).astype(np.int64), block.host_ns
        lasts = np.append(np.flatnonzero(np.diff(host_ns)), len(block) - 1)  # the newest of each read
        for at in lasts.tolist():
            if self._clock.before(int(time_us[at])):  # the board's clock restarted
                self._clock = ClockFit()
            self._clock.add(int(time_us[at]), int(host_ns[at]))
        stamps = np.maximum.accumulate(self._clock.host_s(time_us) + self._offset_s)
        late = stamps <= self._last_s  # where the fit has moved back
        stamps[late] = self._last_s + 1e-6 * np.arange(1, late.sum() + 1)
        self._last_s = float(stamps[-1])
        return stamps

    def _push_markers(self) -> None:
        now_s = time.monotonic()
        if now_s - self._clock_told_s > CLOCK_EVERY_S and self._clock.slope is not None:
            self._clock_told_s = now_s
            self._mark({"kind": "clock", **self.clock}, now_s)
        while self._calibrations:
            self._mark({"kind": "calibration", "calibration_id": self._calibrations.popleft()}, now_s)
        for marker, time_us in self._told.new():
            known = time_us is not None and self.pushed > 0
            at_s = float(self._clock.host_s(np.array([time_us]))[0]) if known else now_s
            self._mark(marker, at_s)

    def _mark(self, marker: Mapping[str, Any], host_s: float) -> None:
        self._markers.push_sample([json.dumps(marker, allow_nan=False, default=str)], host_s + self._offset_s)


class _Told:
    """What has been marked of a session: steps, readings and messages, each once."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._steps: dict[int, tuple[Any, ...]] = {}
        self._readings = len(session.readings())
        self._message = max((message.number for message in session.snapshot().messages), default=0)

    def new(self) -> Iterator[tuple[dict[str, Any], int | None]]:
        """Yield what is new, with its board time, us, where it has one."""
        for step in self._session.steps():
            times = {"step": step.started_us, "arrived": step.arrived_us}
            times |= {"plateau": step.settled_us, "step_end": step.ended_us}
            before = self._steps.get(step.number, ())
            for kind, time_us in times.items():
                if time_us is not None and (kind, time_us) not in before:
                    at = {
                        "step": step.number,
                        "cycle": step.cycle,
                        "branch": step.branch,
                        "target_kpa": step.target_kpa,
                    }
                    yield {"kind": kind, **at}, time_us
            self._steps[step.number] = tuple(times.items())
        readings = self._session.readings()
        for reading in readings[self._readings :]:
            given = {"step": reading.step_id, "elongation_mm": reading.elongation_mm, "source": reading.source}
            yield {"kind": "reading", **given}, None
        self._readings = len(readings)
        for message in self._session.snapshot().messages:
            if message.number > self._message:
                self._message = message.number
                yield {"kind": "event", "event": str(message.kind), "level": message.level, "text": message.cause}, None


def _channels(sensors: int, others: tuple[ExtraChannel, ...]) -> dict[str, str]:
    """Return label and unit of each channel."""
    signals = {f"s{n}_mv": "mV" for n in range(1, sensors + 1)}
    usual = {"pressure_kpa": "kPa", "target_kpa": "kPa", "elongation_mm": "mm", "u_mm": "mm"}
    return signals | usual | {channel.column: channel.unit for channel in others}


def _offset_s(pylsl: Any) -> float:
    """Return LSL's clock less the host's, of the pair of readings that lay closest together."""
    pairs = []
    for _ in range(20):
        before, there, after = time.monotonic(), pylsl.local_clock(), time.monotonic()
        pairs.append((after - before, there - 0.5 * (before + after)))
    return float(min(pairs)[1])


@contextlib.contextmanager
def _kept_local(wanted: bool) -> Iterator[None]:
    """Bind the sockets that are opened inside to the loopback device."""
    if not wanted:
        yield
        return
    listing, option = Path("/proc/self/fd"), getattr(socket, "SO_BINDTODEVICE", None)
    if option is None or not listing.is_dir():
        cause = "on this system LSL streams can be reached from other computers"
        raise RequestError(cause, "allow it", command="boat-daq serve --lsl-network")
    before = _sockets(listing)
    yield
    for number, inode in _sockets(listing).items():
        if before.get(number) == inode:
            continue
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(number)) as opened:
            if opened.family in (socket.AF_INET, socket.AF_INET6):
                opened.setsockopt(socket.SOL_SOCKET, option, b"lo")


def _sockets(listing: Path) -> dict[int, str]:
    """Return the inode of each socket of this process, by descriptor."""
    found = {}
    for entry in listing.iterdir():
        with contextlib.suppress(OSError):
            target = str(entry.readlink())
            if target.startswith("socket:"):
                found[int(entry.name)] = target
    return found
