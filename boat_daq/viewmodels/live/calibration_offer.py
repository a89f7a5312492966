"""The offer to calibrate, made once a run with readings has ended."""

from __future__ import annotations

from collections.abc import Callable

from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.viewmodels.common.formatting import count
from boat_daq.viewmodels.common.notices import Notice, Severity
from boat_daq.viewmodels.common.services import Page, Services
from boat_daq.viewmodels.live.readings import ReadingsModel
from protocol.recording import RunEnd


class CalibrationOffer:
    """Follows the session and offers to calibrate.

    Parameters
    ----------
    readings : of the run.
    analyse : closes the recording and analyses it.
    services : of the window.
    """

    def __init__(self, readings: ReadingsModel, analyse: Callable[[], None], services: Services) -> None:
        self._readings, self._analyse, self._services = readings, analyse, services
        self._state = SessionState.IDLE
        self._offer: Notice | None = None

    @property
    def open(self) -> bool:
        """Return whether the run that has ended was read and can be calibrated with."""
        return self._offer is not None

    def take(self) -> None:
        """Analyse the run that has ended, on its page."""
        self._services.show(Page.CALIBRATE)
        self._analyse()

    def follow(self, snapshot: SessionSnapshot, *, analysing: bool) -> None:
        """Make the offer when a run has ended; withdraw it when it is taken or the next run begins."""
        before, self._state = self._state, snapshot.state
        notices = self._services.notices
        if before is SessionState.FAULT and snapshot.state is not SessionState.FAULT:
            notices.dismiss_all(Severity.FAULT)  # cleared: they would hide what comes next
        if self._offer is not None and (analysing or snapshot.state is SessionState.RUNNING):
            notices.dismiss(self._offer)
            self._offer = None
        ended = snapshot.state is SessionState.IDLE and before in (SessionState.RUNNING, SessionState.FINISHING)
        read = sum(r.elongation_mm is not None for r in self._readings.latest().values()) if ended else 0
        if read:
            stopped = snapshot.run_ended is not None and snapshot.run_ended.end is RunEnd.STOPPED
            self._offer = notices.say(
                Severity.INFORMATION,
                f"the run {'was stopped' if stopped else 'is finished'}, {count(read, 'plateau')} read",
                "Next: fit and look at it.",
                action_text="Calibrate",
                action=self.take,
            )
