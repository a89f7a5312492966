"""The entry of the U at which runs end, and the report of what a run had reached."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from analysis.stopping.criterion import StopAssessment, StopCriterion
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.snapshot import RunEnding, SessionState
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live import end_at
from boat_daq.viewmodels.live.end_at import WRITTEN_S, EndAt, EndReport
from boat_daq.workflows.end_at_uncertainty import EndUncertainty, EnoughCycles
from boat_daq.workflows.jobs import JobFailure, JobState
from protocol.base.errors import RequestError
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import services_in

PLANS = built_in_plans()
MISSED = EndUncertainty(0.08, "mm", 0.11, 5, reached=False, text="U 0.11 mm of 0.08 mm asked after all 5 cycles: ...")


class Entry:
    """The entry of a window that keeps its values in a folder, and the plan that is chosen."""

    def __init__(self, folder: Path) -> None:
        self.services: Services = services_in(folder)
        self.enough = EnoughCycles(cast(Any, None))
        self.sequence = SimpleNamespace(plan=PLANS["calibration"])
        self.end_at = EndAt(self.enough, cast(Any, self.sequence), self.services)

    def of(self, plan: str) -> tuple[str, str]:
        """Return text and unit for a plan."""
        self.sequence.plan = PLANS[plan]
        return self.end_at.text, self.end_at.unit


def test_each_unit_keeps_its_own_value(tmp_path: Path) -> None:
    """0.08 mm became 0.08 % FSO with the plan; both are kept between starts, and go back with undo."""
    entry = Entry(tmp_path)
    assert entry.of("calibration") == ("", "mm")
    entry.end_at.enter("0,08 mm")
    assert entry.of("repeatability") == ("", "% FSO")
    entry.end_at.enter(" 0.5 % FSO")
    assert entry.of("repeatability") == ("0.5", "% FSO")
    assert entry.of("calibration") == ("0.08", "mm")
    assert entry.of("step-test") == ("", "")
    assert Entry(tmp_path).of("repeatability") == ("0.5", "% FSO")
    entry.services.undo.undo()
    assert (entry.of("calibration"), entry.of("repeatability")) == (("0.08", "mm"), ("", "% FSO"))
    assert entry.of("calibration")[0] == "0.08"
    entry.end_at.enter("")
    assert Entry(tmp_path).of("calibration") == ("", "mm")


def test_a_wrong_value_is_refused_in_its_unit(tmp_path: Path) -> None:
    """The remedy has an example in the unit of the plan; the value before is kept. A stored one that is none is off."""
    entry = Entry(tmp_path)
    entry.of("repeatability")
    entry.end_at.enter("0.5")
    for wrong, error in (("wide", RequestError), ("0", RequestError), ("inf", RequestError)):
        with pytest.raises(error) as refused:
            entry.end_at.enter(wrong)
        assert "% FSO" in refused.value.remedy
        assert "as 0.5" in refused.value.remedy
    assert entry.end_at.text == "0.5"
    entry.services.preferences.set(end_at.KEY, {"mm": "wide", "% FSO": -1.0})
    assert (Entry(tmp_path).of("calibration"), Entry(tmp_path).of("repeatability")) == (("", "mm"), ("", "% FSO"))


class Done:
    """A job that has ended with a result, or failed."""

    failure: JobFailure | None = None

    def __init__(self, *_: object) -> None:
        self.result = MISSED
        self.state = JobState.DONE if self.failure is None else JobState.FAILED

    def poll(self) -> JobState:
        """Return its state."""
        return self.state


class Report:
    """The report of runs that end at 0.08 mm, with a clock that is set by hand."""

    def __init__(self) -> None:
        self.now_s, self.notices = 100.0, Notices()
        self.enough = EnoughCycles(cast(Any, None))
        self.enough.ask(0.08, "mm")
        self.report = EndReport(self.enough, self.notices, lambda: self.now_s)

    def follow(
        self, state: SessionState, complete: int = 5, ended: RunEnd = RunEnd.FINISHED, after_s: float = 0.0
    ) -> str:
        """Take a snapshot some time after the one before; return the text."""
        self.now_s += after_s
        progress = SimpleNamespace(complete_cycles=complete) if state is SessionState.RUNNING else None
        seen = SimpleNamespace(
            state=state,
            plan=PLANS["calibration"],
            recording=Path("run.boat"),
            progress=progress,
            run_ended=RunEnding(ended, "vented"),
        )
        self.report.follow(cast(Any, seen))
        return self.report.text


@pytest.fixture
def report(monkeypatch: pytest.MonkeyPatch) -> Report:
    """Return a report whose jobs are done at once."""
    monkeypatch.setattr(end_at, "Job", Done)
    monkeypatch.setattr(Done, "failure", None)
    return Report()


def messages(report: Report) -> list[str]:
    """Return the causes of all notices."""
    return [notice.cause for notice in report.notices.history]


@pytest.mark.parametrize("ended", [RunEnd.FINISHED, RunEnd.STOPPED])
def test_a_run_that_ends_without_its_u_is_assessed(report: Report, ended: RunEnd) -> None:
    """Once its last samples are written; the report is shown until the next plan is armed."""
    report.follow(SessionState.RUNNING)
    assert report.follow(SessionState.IDLE, ended=ended) == ""
    assert report.follow(SessionState.IDLE, ended=ended, after_s=WRITTEN_S) == MISSED.text
    assert report.follow(SessionState.IDLE, ended=ended, after_s=60.0) == MISSED.text
    assert messages(report) == [MISSED.text]
    assert report.follow(SessionState.ARMED) == ""


def test_a_run_that_ended_at_its_u_states_it_at_once(report: Report) -> None:
    """The session has reported it: there is no second message."""
    report.enough.ended_by = StopAssessment(3, 5, 2, (StopCriterion("U ", "mm", 0.078, 0.08, 0.05),))
    report.follow(SessionState.RUNNING)
    assert report.follow(SessionState.IDLE) == "Ended after cycle 3: U 0.078 mm of 0.08 mm asked."
    assert messages(report) == []


def test_a_run_without_an_end_to_report_is_not_assessed(report: Report) -> None:
    """Vented, before its first cycle, or without a U asked for."""
    report.follow(SessionState.RUNNING)
    assert report.follow(SessionState.ABORTED, ended=RunEnd.ABORTED, after_s=9.0) == ""
    report.follow(SessionState.RUNNING, complete=0)
    assert report.follow(SessionState.IDLE, ended=RunEnd.STOPPED, after_s=9.0) == ""
    report.enough.ask(None, "mm")
    report.follow(SessionState.RUNNING)
    assert report.follow(SessionState.IDLE, after_s=9.0) == ""
    assert messages(report) == []


def test_the_report_beside_the_next_run_names_its_recording(report: Report) -> None:
    """The operator starts the next run before the analysis has ended."""
    report.follow(SessionState.RUNNING)
    report.follow(SessionState.IDLE)
    assert report.follow(SessionState.RUNNING, complete=0, after_s=WRITTEN_S) == ""
    assert messages(report) == [f"run.boat: {MISSED.text}"]


def test_an_assessment_that_fails_has_its_cause(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that was ended."""
    monkeypatch.setattr(Done, "failure", JobFailure("the process ended without a result", "", ""))
    report.follow(SessionState.RUNNING)
    report.follow(SessionState.IDLE)
    shown = report.follow(SessionState.IDLE, after_s=WRITTEN_S)
    assert shown == "The uncertainty is not known at the end of the run: the process ended without a result."
