"""What is offered once a run has ended: to calibrate with its readings, or to resume it after an interruption.

An interrupted run resumes at its next whole cycle: after an unplugged board in the session's own recording, or in one
that a crash or a stop has left. It is only armed; pressure waits for Start.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from boat_daq.engine.plan import Plan, resume_point
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.formatting import count
from boat_daq.viewmodels.common.notices import Notice, Severity
from boat_daq.viewmodels.common.services import Page, Services
from boat_daq.viewmodels.live.readings import ReadingsModel
from boat_daq.viewmodels.live.sequence import SequenceModel
from protocol.recording import RunEnd

AT_REST = (SessionState.IDLE, SessionState.ABORTED)
ReadInterrupted = Callable[[Path, Callable[[BrokenRun], None]], None]


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
            self._offer = notices.add(
                Severity.INFORMATION,
                f"the run {'was stopped' if stopped else 'is finished'}, {count(read, 'plateau')} read",
                "Next: fit and look at it.",
                action_text="Calibrate",
                action=self.take,
            )


class ResumeRun:
    """Offers to resume an interrupted run, and arms it.

    Parameters
    ----------
    session : resumes the run.
    sequence : takes the run's plan.
    read : reads an interrupted run from a closed recording in the background, then calls back with it.
    services : of the window.
    """

    def __init__(self, session: Session, sequence: SequenceModel, read: ReadInterrupted, services: Services) -> None:
        self._session, self._sequence, self._read, self._services = session, sequence, read, services
        self._offer: Notice | None = None
        self.first_cycle = 0  # where the interrupted run can resume; 0 without one
        self._broke = False

    def resume(self, path: Path) -> None:
        """Prepare the interrupted run of a closed recording to resume in it.

        Raises
        ------
        OperatorError : no board is connected, a recording is open already, or there is nothing to resume.
        """
        snapshot = self._session.snapshot()
        if snapshot.link is not LinkState.UP:
            raise OperatorError("no board is connected", "Connect the board of this run, then resume it.")
        if snapshot.recording is not None:
            raise OperatorError(f"{snapshot.recording.name} is being recorded", "Close that recording first.")

        def ready(broken: BrokenRun) -> None:
            def arm() -> None:
                self._session.resume_recording(broken, {"operator": ""})
                self._arm(broken.plan)

            done = f"{broken.path.name} resumes at cycle {broken.first_cycle}: press Start"
            self._services.notices.attempt(arm, done=done)

        self._read(path, ready)

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Offer to resume once a run was interrupted and the board is connected again."""
        self._broke = self._broke or snapshot.state is SessionState.FAULT
        if snapshot.state in (SessionState.RUNNING, SessionState.ARMED) or snapshot.recording is None:
            self._broke, self.first_cycle = False, 0
            if self._offer is not None:
                self._services.notices.dismiss(self._offer)
                self._offer = None
        elif self._broke and snapshot.state in AT_REST and snapshot.link is LinkState.UP:
            self._broke = False
            self._offer_resumption(snapshot)

    def _offer_resumption(self, snapshot: SessionSnapshot) -> None:
        plan = snapshot.plan
        if plan is None or snapshot.run_ended is None or not snapshot.run_ended.aborted:
            return
        first, complete = resume_point(plan, list(self._session.steps()))
        if 0 < complete < plan.cycles:
            self._offer = self._services.notices.add(
                Severity.INFORMATION,
                f"the run was interrupted after {count(complete, 'whole cycle')}",
                f"Resume at cycle {first} in its recording, the break stays visible; or start over in another.",
                action_text="Resume",
                action=lambda: self._arm(plan),
            )
            self.first_cycle = first

    def arm(self) -> None:
        """Arm the rest of the interrupted run.

        Raises
        ------
        BoatDaqError : it cannot be armed now.
        """
        if self._offer is not None and self._offer.action is not None:
            self._offer.action()

    def _arm(self, plan: Plan) -> None:
        self._sequence.take(plan)
        self._sequence.arm(resume=True)
        self._services.show(Page.LIVE)
