"""Feed the board's watchdog, measure how fast its clock runs, and notice when its samples stop.

The watchdog counts board time. A virtual board at 100 times real time gives a host 100 times less of its own: so the
watchdog is fed by the board's clock, as the samples show it, and a board that runs faster than the host has the longest
timeout of the protocol, fed at every tenth: at 100x 50 ms here. Where the computer is too busy for that, the board
vents, and the message proposes a lower speed."""

from __future__ import annotations

from collections import deque

from protocol.link.messages import Command, Heartbeat

LONGEST_MS = 5000
REAL_TIME_MS = 3000  # 1.4 s was the longest between two feedings beside eight busy processes, 1.96 s beside ten more
FAST = 1.5  # board time over host time above which a board is a virtual one
SPEED_SPAN_S = 2.0
SPEED_KNOWN_S = 0.1
FEEDS_PER_TIMEOUT = 12
REPEAT_MS = 250  # a command without an answer goes out again
REPEATS_WITHIN = 0.6  # of a timeout they feed well enough: up to 12x
FEEDS_OF_A_FAST_BOARD = 10


class SpeedMeter:
    """Board time per host time, over the last two seconds."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, int]] = deque()

    def add(self, host_ns: int, board_us: int) -> None:
        """Take the arrival of a sample; a clock that went back restarts the measurement."""
        if self._points and (board_us < self._points[-1][1] or host_ns < self._points[-1][0]):
            self._points.clear()
        if self._points and host_ns - self._points[-1][0] < 5_000_000:
            return
        self._points.append((host_ns, board_us))
        while host_ns - self._points[0][0] > SPEED_SPAN_S * 1e9:
            self._points.popleft()

    @property
    def known(self) -> bool:
        """Whether the measurement is long enough."""
        return bool(self._points) and self._points[-1][0] - self._points[0][0] >= SPEED_KNOWN_S * 1e9

    @property
    def speed(self) -> float:
        """Board time per host time; 1 until it is known."""
        if not self.known:
            return 1.0
        (host_0, board_0), (host_1, board_1) = self._points[0], self._points[-1]
        return (board_1 - board_0) * 1e3 / (host_1 - host_0)


class Feeder:
    """Decides when the next frame is due; any frame feeds."""

    def __init__(self) -> None:
        self.armed_ms = 0  # as the board has acknowledged it
        self._fed_host_ns = self._fed_board_us = 0

    def timeout_ms(self, speed: float) -> int:
        """Return the timeout to arm for a board of this speed."""
        return LONGEST_MS if speed > FAST else REAL_TIME_MS

    def sent(self, command: Command, host_ns: int, board_us: int) -> None:
        """Note a frame that was sent."""
        self._fed_host_ns, self._fed_board_us = host_ns, board_us
        if isinstance(command, Heartbeat) and command.timeout_ms:
            self.armed_ms = command.timeout_ms

    def refused(self, command: Heartbeat) -> None:
        """Note a refusal: of arming, then it is not armed; of disarming, then it stays."""
        if command.timeout_ms:
            self.armed_ms = 0

    def due(self, host_ns: int, board_us: int, speed: float) -> bool:
        """Return whether a frame must be sent now."""
        if not self.armed_ms:
            return False
        share_ms = self.armed_ms / (FEEDS_OF_A_FAST_BOARD if speed > FAST else FEEDS_PER_TIMEOUT)
        board_ms = (board_us - self._fed_board_us) / 1e3
        host_ms = (host_ns - self._fed_host_ns) / 1e6 * max(speed, 1.0)
        return not -share_ms < board_ms < share_ms or host_ms >= share_ms


SILENCE_S = 1.0
UNREAD_S = 3.0  # that the port may stay unread by a busy computer


class StreamWatch:
    """Watches the arrival of one link's samples.

    `begun`: whether any arrived on this link. `silent`: whether none has arrived for `silence_s`, until the next one.
    `urgent`: whether the system runs the reading thread before others.
    """

    def __init__(self, rate_hz: int) -> None:
        self.rate_hz, self.urgent = rate_hz, True
        self.begun = self.silent = False
        self._last_ns = self._pause_ended_ns = 0

    @property
    def silence_s(self) -> float:
        """Time without samples that is allowed."""
        return max(SILENCE_S, 3.0 / self.rate_hz)

    def opened(self, now_ns: int) -> None:
        """Wait for samples on a new link."""
        self.begun = self.silent = False
        self._last_ns = now_ns

    def came(self, now_ns: int) -> None:
        """Take the arrival of samples."""
        if self._pausing(now_ns):
            self._pause_ended_ns = now_ns
        self._last_ns, self.begun, self.silent = now_ns, True, False

    def age_s(self, now_ns: int) -> float:
        """Return the time since samples last arrived, s."""
        return (now_ns - self._last_ns) / 1e9

    def falls_silent(self, heard_ns: int) -> bool:
        """Return whether silence begins; true once for each silence. All that had arrived by `heard_ns` was read."""
        if not self.begun or self.silent or heard_ns - self._last_ns <= self.silence_s * 1e9:
            return False
        self.silent = True
        return True

    def paused_lately(self, now_ns: int) -> bool:
        """Whether half a silence overlaps the three sendings of a command lost now."""
        return self._pausing(now_ns) or now_ns - self._pause_ended_ns < SILENCE_S * 1e9

    def _pausing(self, now_ns: int) -> bool:
        return now_ns - self._last_ns > self.silence_s / 2 * 1e9
