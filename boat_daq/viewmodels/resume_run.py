"""A broken run goes on at its next whole cycle: after an unplugged board in the session's own recording, or in one
that a crash or a stop has left. It is armed only; pressure waits for Start.
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
from boat_daq.viewmodels.common.notices import Level, Notice, Notices
from boat_daq.viewmodels.live.sequence import SequenceModel
from boat_daq.viewmodels.results.runs import RunsModel

AT_REST = (SessionState.IDLE, SessionState.ABORTED)


class GoingOn:
    """Offers to go on, and does it.

    Parameters
    ----------
    session : where the run goes on.
    sequence : whose plan is then the run's.
    runs : reads a closed recording in the background.
    notices : where it is offered.
    show_live : brings the live page.
    """

    def __init__(
        self,
        session: Session,
        sequence: SequenceModel,
        runs: RunsModel,
        notices: Notices,
        show_live: Callable[[], None],
    ) -> None:
        self._session, self._sequence, self._runs, self._notices = session, sequence, runs, notices
        self._show_live = show_live
        self._offer: Notice | None = None
        self.first_cycle = 0  # where the broken run can go on; 0 where there is none
        self._broke = False

    def resume(self, path: Path, snapshot: SessionSnapshot, operator: str = "") -> None:
        """Make the broken run of a closed recording ready to go on in it.

        Raises
        ------
        OperatorError : no board is connected, a recording runs already, or there is nothing to go on with.
        """
        if snapshot.link is not LinkState.UP:
            raise OperatorError("no board is connected", "Connect the board of this run, then resume it.")
        if snapshot.recording is not None:
            raise OperatorError(f"{snapshot.recording.name} is being recorded", "Close that recording first.")

        def ready(broken: BrokenRun) -> None:
            def deed() -> None:
                self._session.resume_recording(broken, {"operator": operator})
                self._arm(broken.plan)

            name, first = broken.path.name, broken.first_cycle
            self._notices.attempt(deed, done=f"{name} goes on at cycle {first}: press Start")

        self._runs.resume(path, ready)

    def watch(self, snapshot: SessionSnapshot) -> None:
        """Offer to go on where a run was broken off and the board is there again."""
        self._broke = self._broke or snapshot.state is SessionState.FAULT
        if snapshot.state in (SessionState.RUNNING, SessionState.ARMED) or snapshot.recording is None:
            self._broke, self.first_cycle = False, 0
            if self._offer is not None:
                self._notices.dismiss(self._offer)
                self._offer = None
        elif self._broke and snapshot.state in AT_REST and snapshot.link is LinkState.UP:
            self._broke = False
            self._offer_to_go_on(snapshot)

    def _offer_to_go_on(self, snapshot: SessionSnapshot) -> None:
        plan = snapshot.plan
        if plan is None or snapshot.run_ended is None or not snapshot.run_ended.aborted:
            return
        first, complete = resume_point(plan, list(self._session.steps()))
        if 0 < complete < plan.cycles:
            self._offer = self._notices.say(
                Level.INFORMATION,
                f"the run was broken off after {count(complete, 'whole cycle')}",
                f"Go on at cycle {first} in its recording, the break stays visible; or begin anew in another.",
                action_text="Go on",
                action=lambda: self._arm(plan),
            )
            self.first_cycle = first

    def go_on(self) -> None:
        """Arm the rest of the run that was broken off, as the offer says.

        Raises
        ------
        BoatDaqError : what stands in the way.
        """
        if self._offer is not None and self._offer.action is not None:
            self._offer.action()

    def _arm(self, plan: Plan) -> None:
        self._sequence.take(plan)
        self._sequence.arm(resume=True)
        self._show_live()
