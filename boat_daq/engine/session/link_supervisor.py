"""The keeper of the link: opens ports, gives up on what is no board, looks for a lost one, says goodbye. One thread.

A board that is unplugged is looked for on its own port first and then on every other serial port, once a second, and
known again by the identity in its HELLO, never by the port's name. Nothing under pressure goes on by itself: the run
is in fault, the board vented by its own watchdog, and the operator decides.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from boat_daq.engine.control.controller import Controller
from boat_daq.engine.link.discovery import find_board
from boat_daq.engine.link.opening import open_port
from boat_daq.engine.link.replay import ReplayEnded
from boat_daq.engine.session.core import Core
from boat_daq.engine.settings import Settings
from boat_daq.engine.snapshot import LinkState, MessageKind, SessionState
from boat_daq.errors import BoatDaqError, OperatorError
from protocol.errors import ProtocolError
from protocol.recording import RunEnd

TICK_S = 0.03
HELLO_S = 2.5  # for a board to say who it is, its boot after opening the port included; refused within 3 s
SAMPLES_S = 3.0  # then, for samples and their pace
REFUSED_S = 1.0  # for a stream that runs already, where the board refuses to begin one
AGAIN_S = 1.0
VENT_S = 5.0
GOODBYE_S = 1.0

_BUSY = (LinkState.OPENING, LinkState.UP, LinkState.LOST)


class LinkSupervisor:
    """Keeps one port."""

    def __init__(
        self,
        core: Core,
        settings: Settings,
        *,
        end_recording: Callable[[RunEnd], object],
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.state = LinkState.CLOSED
        self.url: str | None = None
        self.error: tuple[str, str] | None = None
        self._clock_s = clock_s
        self._core, self._settings, self._end_recording = core, settings, end_recording
        self._profile: str | None = None
        self._greeted: Callable[[], None] | None = None
        self._wanted = self._closing = self._ending = self._seeking = False
        self._since_s = 0.0  # of the present state
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="keeper", daemon=True)

    def open(
        self, url: str, profile: str | None, control: Controller, *, greeted: Callable[[], None] | None = None
    ) -> None:
        """Ask for a port to be opened, under `control`.

        Parameters
        ----------
        greeted : called once the board has said who it is; samples are asked for only after it.

        Raises
        ------
        OperatorError : one is open already.
        """
        with self._core.lock:
            if self.state in _BUSY or self._wanted:
                raise OperatorError(f"{self.url} is open already", "disconnect it first")
            self._core.control, self._core.ring, self._core.expected_id = control, None, None
            self.url, self._profile, self.error = url, profile, None
            self._greeted, control.hold_samples = greeted, greeted is not None
            self.state, self._wanted = LinkState.OPENING, True
        if not self._thread.is_alive() and not self._ending:
            self._thread.start()
        self._wake.set()

    def close(self) -> None:
        """Ask for the port to be closed."""
        self._closing = True
        self._wake.set()

    def end(self) -> None:
        """Close, and end the thread; waits for both."""
        self._ending = True
        self.close()
        if self._thread.ident is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        while not self._ending or self.state in _BUSY:
            self._wake.wait(TICK_S if self.state in _BUSY else None)
            self._wake.clear()
            self._turn()

    def _turn(self) -> None:
        core = self._core
        if self._closing:
            self._closing = self._wanted = False
            self._say_goodbye()
            return
        if self._wanted:
            self._wanted = False
            self._open()
        elif self.state is LinkState.OPENING:
            self._watch_opening()
        elif self.state is LinkState.UP and core.lost is not None:
            self._lose()
        elif self.state is LinkState.LOST:
            self._look_again()
        core.tick()

    # ---- opening ---------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        assert self.url is not None
        self._since_s = self._clock_s()
        try:
            port = open_port(self.url, self._profile, self._settings)
        except (BoatDaqError, ProtocolError) as error:
            self._fail(error.cause, error.remedy)
            return
        self._core.attach(port)
        if port.replayed is not None:
            self._play()

    def _play(self) -> None:
        """Let a replay begin: it waits for no START, so what was asked for is done before its first byte."""
        if self._greeted is not None:
            self._greet()
        if self._core.acquisition is not None:  # it is gone where that failed
            self.state = LinkState.UP
            self._core.acquisition.start()

    def _watch_opening(self) -> None:
        """Wait for the board to show itself, but not for ever."""
        core, waited_s = self._core, self._clock_s() - self._since_s
        if core.refused is not None:
            self._fail(*core.refused)
        elif core.lost is not None:
            self._fail(core.lost.cause, core.lost.remedy)
        elif self._greeted is not None:
            self._greet()
        elif core.control.up:
            self.state, self._seeking = LinkState.UP, False
        elif core.control.no_samples is not None and waited_s > REFUSED_S:
            self._fail(*core.control.no_samples)
        elif waited_s > HELLO_S and core.control.dialogue.identifying:
            self._fail(*self._no_board())
        elif waited_s > HELLO_S + SAMPLES_S:
            self._fail(f"the board at {self.url} answers, but sends no samples", "reset it; look at its firmware")

    def _greet(self) -> None:
        """Once the board has said who it is, do what was asked for then, and let the samples come."""
        core = self._core
        if core.control.dialogue.identifying:
            if self._clock_s() - self._since_s > HELLO_S:
                self._fail(*self._no_board())
            return
        greeted, self._greeted = self._greeted, None
        assert greeted is not None
        try:
            greeted()
        except BoatDaqError as error:
            self._fail(error.cause, error.remedy)
            return
        with core.acting() as control:
            control.release_samples()

    def _no_board(self) -> tuple[str, str]:
        if not self._core.heard:
            return f"nothing comes from {self.url}", "check cable and power; is it the right port?"
        if self._profile is None and self._core.good_frames:
            return (
                f"the board at {self.url} answers in good frames, but with no HELLO that could be true",
                "look at the HELLO of its firmware: 1 to 4 sensors, 1 to 16 bits, a rate above 0",
            )
        if self._profile is not None:
            return f"what comes from {self.url} does not fit the profile", "check the profile, and the baud rate"
        return (
            f"what answers at {self.url} is not a BOAT board at this baud rate ({self._settings.baud})",
            "choose another port or baud rate; firmware that prints text needs its profile",
        )

    def _fail(self, cause: str, remedy: str) -> None:
        """Give up on what is on the port; a board that was greeted is left at rest, its watchdog disarmed."""
        if self._core.control.greeted and self._core.lost is None and self._core.acquisition is not None:
            self._leave()
        self._core.detach()
        if self._seeking:
            self.state, self._since_s = LinkState.LOST, self._clock_s()
            return
        self.error, self.state = (cause, remedy), LinkState.FAILED
        self._core.tell(MessageKind.LINK_FAILED, "error", cause, remedy)

    # ---- lost and found --------------------------------------------------------------------------------------------

    def _lose(self) -> None:
        core = self._core
        error = core.lost
        assert error is not None
        core.detach()
        if isinstance(error, ReplayEnded):
            core.tell(MessageKind.REPLAY_ENDED, "info", error.cause)
            self._end_recording(RunEnd.FINISHED)
            self.state = LinkState.CLOSED
            return
        with core.acting() as control:
            control.link_lost(error.cause)
            core.expected_id = control.hello.board_id if control.hello else None
        self._seeking = True
        self.state, self._since_s = LinkState.LOST, self._clock_s()

    def _look_again(self) -> None:
        """Try the port, and then the others, once a second."""
        core = self._core
        if self._clock_s() - self._since_s < AGAIN_S:
            return
        expected, self._since_s = core.expected_id, self._clock_s()
        assert self.url is not None
        try:
            port = open_port(self.url, self._profile, self._settings)
        except (BoatDaqError, ProtocolError):
            elsewhere = find_board(expected) if expected and "://" not in self.url and not self._profile else None
            self.url = elsewhere or self.url
            return
        core.attach(port)
        self._since_s, self.state = self._clock_s(), LinkState.OPENING
        core.tell(MessageKind.BOARD_FOUND, "info", f"{self.url} is there again")

    # ---- goodbye ---------------------------------------------------------------------------------------------------

    def _say_goodbye(self) -> None:
        """Vent, disarm, stop the samples, close the recording and the port."""
        core = self._core
        if core.acquisition is not None:
            with core.acting() as control:
                control.stop()
            self._wait(lambda: core.control.sequencer.state is not SessionState.FINISHING, VENT_S)
            self._leave()
        core.detach()
        try:
            self._end_recording(RunEnd.STOPPED)
        except BoatDaqError as error:
            core.tell(MessageKind.STORAGE, "error", error.cause, error.remedy)
        core.expected_id, self._seeking, self._greeted = None, False, None
        self.state = LinkState.CLOSED

    def _leave(self) -> None:
        """Vent, disarm the board's watchdog and stop the samples, as far as it answers."""
        with self._core.acting() as control:
            control.leave()
        dialogue = self._core.control.dialogue
        self._wait(lambda: not (dialogue.venting or dialogue.stopping), GOODBYE_S)

    def _wait(self, condition: Callable[[], bool], timeout_s: float) -> None:
        """Let time pass until the condition holds, the port is gone, or the time is over."""
        end_s = self._clock_s() + timeout_s
        while not condition() and self._core.lost is None and self._clock_s() < end_s:
            time.sleep(0.005)
            self._core.tick()
