"""The link supervisor: opens ports, refuses what is no board, finds a lost one again, disconnects. One thread.

A lost board is sought once a second by the serial number of its USB device, whatever its port is called now; without
one, on its own port. No other port is opened, because other instruments have ports, too. Its HELLO must then have the
same identity. No pressure resumes by itself: the run is in fault, the board vented by its own watchdog, and the
operator decides.

The blocks of the port's reading thread come here first: what they mean is for the controller, under the session's lock.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from boat_daq.engine.control.controller import Controller
from boat_daq.engine.control.watchdog import FAST
from boat_daq.engine.link.block import Block, PortLost, SinkFailed
from boat_daq.engine.link.health import LinkHealth
from boat_daq.engine.link.opening import OpenPort, open_port
from boat_daq.engine.link.ports import PortInfo, find_port, usb_port
from boat_daq.engine.link.reader import PortReader, raise_priority
from boat_daq.engine.log import note_failure
from boat_daq.engine.session.journal import Journal
from boat_daq.engine.settings import Settings
from boat_daq.engine.snapshot import HealthSnapshot, LinkError, LinkState, MessageKind, SessionState
from protocol.base.errors import BoatDaqError, DeviceError, RequestError
from protocol.link.events import HelloReceived, WrongProtocol
from protocol.link.messages import Command, Heartbeat, Hello
from protocol.recording import RunEnd

SUPERVISION_S = 0.03
HELLO_S = 2.5  # for a HELLO, the board's boot after opening the port included; refused within 3 s
SAMPLES_S = 3.0  # then, for samples and their pace
REFUSED_S = 1.0  # for a stream that runs already, where the board refuses to start one
SEEK_S = 1.0
VENT_S = 5.0
_LEAVE_S = 1.0

_BUSY = (LinkState.OPENING, LinkState.UP, LinkState.LOST)


class LinkSupervisor:
    """Supervises one port."""

    def __init__(
        self,
        settings: Callable[[], Settings],
        *,
        acting: Callable[[], AbstractContextManager[Controller]],
        journal: Journal,
        show: Callable[[Block], None],
        connected: Callable[[str], None],
        end_recording: Callable[[RunEnd], object],
    ) -> None:
        self.state = LinkState.CLOSED
        self.url: str | None = None
        self.error: LinkError | None = None
        self.port: OpenPort | None = None
        self.reader: PortReader | None = None
        self.health: LinkHealth | None = None
        self._settings, self._acting, self._journal = settings, acting, journal
        self._show, self._connected, self._end_recording = show, connected, end_recording
        self._clock_s = time.monotonic
        self._profile: str | None = None
        self._greeted: Callable[[], None] | None = None
        self._wanted = self._closing = self._ending = self._seeking = False
        self._since_s = 0.0  # of the present state
        self._lost: DeviceError | None = None  # the port, as the reading thread found it
        self._refused: tuple[str, str] | None = None  # the board: cause and remedy
        self._said: tuple[str, str] | None = None  # of a board that is in place of the lost one
        self._expected_id: str | None = None  # of the board that was lost
        self._usb: PortInfo | None = None  # its USB device
        self._heard = False  # any byte on this port
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="link supervisor", daemon=True)

    def open(self, url: str, profile: str | None, *, greeted: Callable[[], None] | None = None) -> None:
        """Have a port opened, and return at once; the session's lock is held. RequestError: one is open already."""
        if self.state in _BUSY or self._wanted:
            raise RequestError(f"{self.url} is open already", "disconnect it first")
        self.url, self._profile, self._greeted = url, profile, greeted
        self.error = self._expected_id = None
        self.state, self._wanted = LinkState.OPENING, True
        if not self._thread.is_alive() and not self._ending:
            self._thread.start()
        self._wake.set()

    def close(self) -> None:
        """Have the port closed, and return at once."""
        self._closing = True
        self._wake.set()

    def end(self) -> None:
        """Close, and end the thread; waits for both."""
        self._ending = True
        self.close()
        if self._thread.ident is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def send(self, command: Command, *, feeds: bool = False) -> bool:
        """Write a command without the session's lock; return whether the port took it."""
        reader = self.reader
        if reader is None:
            return False
        try:
            if feeds and isinstance(command, Heartbeat):
                reader.feed(command)
            else:
                reader.send(command)
        except BoatDaqError:
            return False  # the reading thread finds the port gone; a link that cannot encode it has reported why
        return True

    def health_now(self) -> HealthSnapshot | None:
        """Return the link's figures; None before the first link."""
        return self.health.snapshot() if self.health is not None else None

    def simulated(self, hello: Hello | None) -> bool:
        """Return whether the samples are those of a virtual board, by its HELLO or its profile."""
        if self.port is not None and self.port.profile is not None:
            return self.port.simulated
        return hello is not None and hello.simulated

    # ---- the supervisor's thread -----------------------------------------------------------------------------------

    def _run(self) -> None:
        raise_priority()
        while not self._ending or self.state in _BUSY:
            self._wake.wait(SUPERVISION_S if self.state in _BUSY else None)
            self._wake.clear()
            self._turn()

    def _turn(self) -> None:
        if self._closing:
            self._closing = self._wanted = False
            self._disconnect()
            return
        if self._wanted:
            self._wanted = False
            self._open()
        elif self.state is LinkState.OPENING:
            self._watch_opening()
        elif self.state is LinkState.UP and self._lost is not None:
            self._lose(self._lost)
        elif self.state is LinkState.LOST:
            self._seek()
        self._tick()

    def _tick(self) -> None:
        """Let time pass for the controller."""
        with self._acting() as control:
            if self.reader is not None:
                control.stream.urgent = self.reader.urgent
                control.tick(time.monotonic_ns(), self.reader.heard_ns)
            if self.health is not None:
                self.health.real_time = control.board.meter.speed <= FAST
            self._journal.watch_disk()

    def _tell(self, kind: MessageKind, level: str, cause: str, remedy: str = "", command: str = "") -> None:
        with self._acting():
            self._journal.tell(kind, level, cause, remedy, command)

    # ---- opening ---------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        assert self.url is not None
        self._since_s = self._clock_s()
        try:
            port = open_port(self.url, self._profile, self._settings())
        except BoatDaqError as error:
            self._fail(error.cause, error.remedy, getattr(error, "command", ""))
            return
        self._usb = usb_port(self.url)
        self._attach(port)

    def _attach(self, port: OpenPort) -> None:
        """Begin to read a port that has just been opened."""
        reader = PortReader(port.transport, port.link)
        with self._acting() as control:
            health = LinkHealth(
                lambda: reader.statistics,
                asked_hz=control.stream.rate_hz,
                lag_ms=lambda: self._journal.lag_ms,
                at_risk_ms=lambda: self._journal.at_risk_ms,
                last_ns=self.health.last_ns if self._seeking and self.health is not None else None,
            )
            reader.add_sink(health)
            reader.add_sink(self._take)
            self.port, self.reader, self.health = port, reader, health
            self._lost = self._refused = None
            self._heard = False
            control.board.can_command = port.link.can_command
            control.board.whole_contract = port.profile is None
            control.preflight.why_read_only = port.link.cannot_command_reason
            reader.start()
            control.link_opened(time.monotonic_ns())

    def _detach(self) -> None:
        """Stop reading and close the port. Waits for the reading thread, so never under the lock."""
        with self._acting():
            reader, self.reader = self.reader, None
        if reader is not None:
            reader.stop()

    def _watch_opening(self) -> None:
        """Wait for the board to identify itself, but not for ever."""
        waited_s = self._clock_s() - self._since_s
        with self._acting() as control:
            up, identifying, no_samples = control.up, control.board.identifying, control.no_samples
        if self._refused is not None:
            self._fail(*self._refused)
        elif self._lost is not None:
            self._fail(self._lost.cause, self._lost.remedy, self._lost.command)
        elif self._greeted is not None and not identifying:
            self._greet()
        elif self._greeted is None and up:
            again, self._seeking = self._seeking, False
            self.state = LinkState.UP
            if again:
                self._tell(MessageKind.BOARD_FOUND, "info", "the board is connected again")
            elif self._usb is not None:
                self._connected(self._usb.usb_serial)
        elif self._greeted is None and no_samples is not None and waited_s > REFUSED_S:
            self._fail(*no_samples)
        elif waited_s > HELLO_S and identifying:
            self._fail(*self._no_board())
        elif waited_s > HELLO_S + SAMPLES_S:
            self._fail(f"the board at {self.url} answers, but sends no samples", "reset it; check its firmware")

    def _greet(self) -> None:
        """Call `greeted` once, and let the samples come."""
        greeted, self._greeted = self._greeted, None
        assert greeted is not None
        try:
            greeted()
        except BoatDaqError as error:
            self._fail(error.cause, error.remedy, getattr(error, "command", ""))
            return
        with self._acting() as control:
            control.release_samples()

    def _no_board(self) -> tuple[str, str]:
        """Return cause and remedy for a port without a BOAT board."""
        if not self._heard:
            return f"no data from {self.url}", "check cable and power, and that it is the right port"
        if self._profile is not None:
            return f"the data from {self.url} do not fit the profile", "check the profile, and the baud rate"
        if self.reader is not None and self.reader.statistics.frames > 0:
            cause = f"the board at {self.url} sends valid frames, but no plausible HELLO"
            return cause, "check the HELLO of its firmware: 1 to 4 sensors, 1 to 16 bits, a rate above 0"
        cause = f"the device at {self.url} is not a BOAT board at this baud rate ({self._settings().baud})"
        return cause, "choose another port or baud rate; firmware that prints text needs its profile"

    def _fail(self, cause: str, remedy: str, command: str = "") -> None:
        """Give up the port. A board that sent its HELLO is left at rest, its watchdog disarmed."""
        with self._acting() as control:
            greeted = control.hello is not None and not control.board.identifying
        if greeted and self._lost is None and self.reader is not None:
            self._leave()
        self._detach()
        if self._seeking:
            self.state, self._since_s = LinkState.LOST, self._clock_s()
            if self._refused not in (None, self._said):
                self._said = self._refused
                self._tell(MessageKind.LINK_FAILED, "error", cause, remedy, command)  # what it names stands
            return
        self.error, self.state = LinkError(cause, remedy, command), LinkState.FAILED
        self._tell(MessageKind.LINK_FAILED, "error", *self.error)

    # ---- lost and found --------------------------------------------------------------------------------------------

    def _lose(self, error: DeviceError) -> None:
        self._detach()
        with self._acting() as control:
            board = control.hello.board_id if control.hello else ""
            control.link_lost(error.cause.replace(self.url or "", board, 1) if board else error.cause)
            self._expected_id = control.hello.board_id if control.hello else None
        self._seeking, self._said = True, None
        self.state, self._since_s = LinkState.LOST, self._clock_s()

    def _seek(self) -> None:
        """Try the port at which the board's USB device is, once a second; without one, its own port."""
        if self._clock_s() - self._since_s < SEEK_S:
            return
        self._since_s = self._clock_s()
        url = self.url if self._usb is None else find_port(self._usb)
        if url is None:
            return
        try:
            port = open_port(url, self._profile, self._settings())
        except BoatDaqError:
            return
        self.url = url
        self._attach(port)
        self._since_s, self.state = self._clock_s(), LinkState.OPENING

    # ---- disconnecting ---------------------------------------------------------------------------------------------

    def _disconnect(self) -> None:
        """Vent, disarm, stop the samples, close the recording and the port."""
        if self.reader is not None:
            with self._acting() as control:
                control.stop()
            self._wait(lambda: control.sequencer.state is not SessionState.FINISHING, VENT_S)
            with self._acting() as control:
                if control.sequencer.state is SessionState.FINISHING:
                    control.abort("disconnected before the unit had vented")
            self._leave()
        self._detach()
        try:
            self._end_recording(RunEnd.STOPPED)
        except BoatDaqError as error:
            self._tell(MessageKind.STORAGE, "error", error.cause, error.remedy, error.command)
        self._expected_id, self._seeking, self._greeted = None, False, None
        self.state = LinkState.CLOSED

    def _leave(self) -> None:
        """Vent, disarm the board's watchdog and stop the samples, as far as it answers."""
        with self._acting() as control:
            control.leave()
        self._wait(lambda: not (control.board.venting or control.board.stopping), _LEAVE_S)

    def _wait(self, condition: Callable[[], bool], timeout_s: float) -> None:
        """Let time pass until the condition holds, the port is gone, or the time is over."""
        end_s = self._clock_s() + timeout_s
        while not condition() and self._lost is None and self._clock_s() < end_s:
            time.sleep(0.005)
            self._tick()

    # ---- on the reading thread -------------------------------------------------------------------------------------

    def _take(self, block: Block) -> None:
        """Take a block: first the controller, then the display."""
        if block.sent:
            return
        with self._acting() as control:
            if not self._noticed(block):
                return
            control.events(block.events, block.host_ns)
            if any(isinstance(event, HelloReceived) for event in block.events):
                self._identified(control)
        self._show(block)

    def _noticed(self, block: Block) -> bool:
        """Note what concerns the link. Return False for a block of a board that is refused."""
        self._heard = self._heard or bool(block.raw)
        for event in block.events:
            match event:
                case HelloReceived(hello) if self._expected_id not in (None, hello.board_id):
                    text = f"another board is on the port: {hello.board_id}"
                    self._refused = (text, f"connect {self._expected_id} again")
                case WrongProtocol(board, program):
                    text = f"the board uses protocol version {board}, this program version {program}"
                    self._refused = (text, "update the board's firmware or this program to the same version")
                case PortLost(error):
                    self._lost = error
                case SinkFailed(name, failure):
                    note_failure(f"{name} failed", failure)
                    cause, remedy = f"{name} failed: {failure!r}", "report this fault"
                    self._journal.tell(MessageKind.SINK_FAILED, "error", cause, remedy)
        return self._refused is None or self.state is LinkState.UP

    def _identified(self, control: Controller) -> None:
        """Continue the recording of a board that is back; take the rate it can give."""
        if self.health is not None:
            self.health.asked_hz = control.stream.rate_hz
        recorder = self._journal.recorder
        if control.hello is not None and self._expected_id == control.hello.board_id and recorder is not None:
            assert self.reader is not None
            self.reader.add_recorder(recorder)
        self._expected_id = None
