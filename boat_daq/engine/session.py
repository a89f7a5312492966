"""The one door between a window or a command and the board.

Every method may be called from any thread and returns at once: what takes time happens on the reading thread, and is
seen in `snapshot()`. What cannot be done as asked raises one of `boat_daq.errors` with its cause and remedy, and
changes nothing. `vent()` works in every state and waits for nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from boat_daq.engine.snapshot import (
    LastSample,
    Limits,
    LinkState,
    Message,
    Phase,
    Progress,
    Reading,
    ReadingRequest,
    SessionSnapshot,
    SessionState,
    StepMark,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    import numpy as np

    from boat_daq.engine.plan import Plan
    from boat_daq.engine.ring_buffer import RingBuffer
    from boat_daq.engine.settings import Settings

__all__ = [
    "LastSample",
    "Limits",
    "LinkState",
    "Message",
    "Phase",
    "Progress",
    "Reading",
    "ReadingRequest",
    "Session",
    "SessionSnapshot",
    "SessionState",
    "StepMark",
]


class Session:
    """A link to one board, its recording and its run.

    Parameters
    ----------
    settings : rate, limits of the units, folders; the stored ones when None.
    """

    ring: RingBuffer | None  # samples for the screen; None until the first connection

    def __init__(self, settings: Settings | None = None) -> None:
        raise NotImplementedError

    def connect(self, port: str, profile: str | None = None, *, rate_hz: int | None = None, unit: str = "") -> None:
        """Open `port` (a path, a name, socket://HOST:PORT, replay:FILE[@SPEED]) and look for a board there.

        Returns at once. `snapshot().link` becomes OPENING and then UP, or FAILED with `link_error`: no such port, busy,
        no permission, silent for 3 s, not a BOAT board, another protocol version.

        Parameters
        ----------
        profile : a text profile's path or TOML for a board that does not speak the BOAT protocol.
        rate_hz : samples per second asked of the board; the setting's when None.
        unit : name of the unit on the bench (SA1 ..), whose limits then hold.
        """
        raise NotImplementedError

    def wait(self, condition: Callable[[SessionSnapshot], bool], timeout_s: float | None = None) -> SessionSnapshot:
        """Block the caller (a command, never a window) until `condition(snapshot)` holds or the time is over."""
        raise NotImplementedError

    def wait_connected(self, timeout_s: float = 5.0) -> SessionSnapshot:
        """Block until the link is UP.

        Raises
        ------
        DeviceError : the link FAILED; cause and remedy are those of `link_error`.
        """
        raise NotImplementedError

    def disconnect(self) -> None:
        """Vent, stop the stream, close the recording and the port."""
        raise NotImplementedError

    def close(self) -> None:
        """Disconnect and end the threads; the session is not used again."""
        raise NotImplementedError

    def start_recording(self, path: Path, metadata: Mapping[str, Any] | None = None) -> None:
        """Record all that comes from now on into `path`; metadata: operator, unit, note.

        Raises
        ------
        StorageError : the folder cannot be written.
        OperatorError : a recording runs already, or nothing is connected.
        """
        raise NotImplementedError

    def stop_recording(self) -> Path | None:
        """Close the recording properly and return its path; a run that still goes is stopped and vented first."""
        raise NotImplementedError

    def arm(self, plan: Plan, *, wait_for_reading: bool = False) -> None:
        """Check `plan` against every limit and make it ready; nothing moves yet.

        Raises
        ------
        OperatorError : outside limits, a fault is latched, a run goes on, the link cannot command.
        """
        raise NotImplementedError

    def disarm(self) -> None:
        """Put an armed plan away."""
        raise NotImplementedError

    def start(self) -> None:
        """Run the armed plan after the pre-flight check.

        Raises
        ------
        OperatorError : what the pre-flight found: link, limits, e-stop, zero of the pressure sensor, disk space.
        """
        raise NotImplementedError

    def pause(self) -> None:
        """Vent and wait; the cycle under way is left out of the figures."""
        raise NotImplementedError

    def resume(self) -> None:
        """Go on at the next whole cycle."""
        raise NotImplementedError

    def stop(self) -> None:
        """End the run: vent, one stop record. A second call changes nothing."""
        raise NotImplementedError

    def vent(self) -> None:
        """Vent now, in any state, from any thread; ends a run. The command leaves within milliseconds."""
        raise NotImplementedError

    def clear_fault(self) -> None:
        """Forget a latched fault whose cause is gone, here and on the board.

        Raises
        ------
        OperatorError : the cause stands.
        """
        raise NotImplementedError

    def set_pressure(self, target_kpa: float, ramp_kpa_per_s: float | None = None) -> None:
        """Command a pressure by hand, within limits, while no run goes on.

        Raises
        ------
        OperatorError : outside limits, latched, a run goes on, or the pre-flight check fails.
        """
        raise NotImplementedError

    def add_reading(
        self,
        step_id: int,
        elongation_mm: float | None,
        source: str,
        *,
        resolution_mm: float = 0.5,
        reader: str = "",
        note: str = "",
    ) -> Reading:
        """Keep a reading for a plateau; a second one for the same step corrects the first, which stays in the file.

        Raises
        ------
        OperatorError : no such plateau, or not a finite length.
        """
        raise NotImplementedError

    def skip_reading(self) -> None:
        """Let the waiting plateau go on without a reading."""
        raise NotImplementedError

    def steps(self) -> tuple[StepMark, ...]:
        """Return the run's steps so far, the current one last."""
        raise NotImplementedError

    def readings(self) -> tuple[Reading, ...]:
        """Return all readings, corrections included, in order of entry; the last one for a step counts."""
        raise NotImplementedError

    def mark(self, note: str) -> None:
        """Put a marker with a note at the newest sample, into the recording."""
        raise NotImplementedError

    def snapshot(self) -> SessionSnapshot:
        """Return what is known now; never waits for I/O."""
        raise NotImplementedError

    def add_sink(self, sink: Callable[[np.ndarray[Any, Any]], None]) -> Callable[[], None]:
        """Hand every block of samples to `sink` on the reading thread; returns the function that takes it away."""
        raise NotImplementedError
