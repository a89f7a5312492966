"""The end of a run at the uncertainty asked for, without a board."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from analysis.stopping.criterion import StopAssessment, StopCriterion
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.snapshot import SessionState
from boat_daq.viewmodels.live.end_at import uncertainty_text
from boat_daq.workflows import end_at_uncertainty
from boat_daq.workflows.end_at_uncertainty import EndUncertainty, EnoughCycles
from boat_daq.workflows.jobs import JobFailure, JobState
from protocol.base.errors import RequestError


class Done:
    """A job that has ended with a result, or failed."""

    result: Any = None
    failure: JobFailure | None = None

    def __init__(self, *_: object, **__: object) -> None:
        self.state = JobState.DONE if self.failure is None else JobState.FAILED

    def poll(self) -> JobState:
        """Return its state."""
        return self.state

    def cancel(self) -> None:
        """Do nothing: it has ended."""


def snapshot(complete: int, state: SessionState = SessionState.RUNNING) -> Any:
    """Return a snapshot of a run of five cycles of 100 s."""
    progress = SimpleNamespace(complete_cycles=complete, cycles=5, time_left_s=100.0 * (5 - complete))
    plan = SimpleNamespace(kind="staircase", cycles=5, end_percent_fso=0.0)
    return SimpleNamespace(state=state, progress=progress, recording=Path("run.boat"), plan=plan)


def known(
    cycles: int, u_mm: float, least_mm: float, hold: tuple[tuple[str, float], ...] | None = None
) -> StopAssessment:
    """Return U of a run of five cycles that is to end at 0.08 mm."""
    return StopAssessment(cycles, 5, 2, (StopCriterion("U ", "mm", u_mm, 0.08, least_mm),), hold)


@pytest.fixture
def ended() -> list[str]:
    """Return why the session's run was ended."""
    return []


@pytest.fixture
def held() -> list[Any]:
    """Return which plateaus the session's run was to hold."""
    return []


@pytest.fixture
def model(ended: list[str], held: list[Any], monkeypatch: pytest.MonkeyPatch) -> EnoughCycles:
    """Return the model of a run that ends at 0.08 mm; its jobs are done at once."""
    monkeypatch.setattr(end_at_uncertainty, "Job", Done)
    monkeypatch.setattr(Done, "failure", None)
    session = SimpleNamespace(
        finish_early=ended.append, hold_at=held.append, stop_at_cycles=lambda on, first=1: None,
        next_cycle=lambda assessed: None, taken=lambda: 1, written=lambda taken: True,
    )  # fmt: skip
    made = EnoughCycles(cast(Any, session))
    made.ask(0.08, "mm")
    return made


def test_a_run_ends_after_the_cycle_that_leaves_the_u(model: EnoughCycles, ended: list[str], held: list[Any]) -> None:
    """Nothing ends before a cycle is complete, nor by a larger U; the time left follows from the cycles needed."""
    model.follow(snapshot(0))
    assert uncertainty_text(model, snapshot(0)).startswith("U 0.08 mm asked, known after one cycle")
    Done.result = known(1, 0.1, 0.07, (("loading", 50.0), ("unloading", -40.0)))
    assert Done.result.more_cycles == 3
    model.follow(snapshot(1))
    model.follow(snapshot(1))
    assert not ended
    assert held == [Done.result.hold]
    assert uncertainty_text(model, snapshot(1)).startswith("U 0.1 mm of 0.08 mm asked, ends in about 5:00")
    model.known = known(1, 0.05, 0.04)
    assert uncertainty_text(model, snapshot(1)) == "U 0.05 mm of 0.08 mm asked, 2 cycles at least, ends in about 1:40"
    Done.result = known(2, 0.079, 0.05)
    model.follow(snapshot(2))
    model.follow(snapshot(2))
    assert ended == ["ended after cycle 2: U 0.079 mm of 0.08 mm asked"]
    assert len(held) == 1


def test_run_waits_at_the_end_of_each_cycle_for_its_assessment(model: EnoughCycles, held: list[Any]) -> None:
    """Asked once to hold its last level; released by each assessment, by one that fails, and where no U is asked."""
    asked: list[Any] = []
    session = cast(Any, model._session)
    session.stop_at_cycles = lambda *, on, first=1: asked.append(on and first)
    session.next_cycle = asked.append
    Done.result = known(1, 0.1, 0.07)
    model.follow(snapshot(0))
    model.follow(snapshot(1))
    assert asked == [1]  # it is being assessed: the level is held
    model.follow(snapshot(1))
    assert asked == [1, 1]
    model._not_known("the analysis failed")
    assert asked == [1, 1, 1]
    model.ask(None, "mm")
    model.follow(snapshot(1))
    assert asked[3:] == [False]
    model.ask(0.5, "% FSO")
    continuous = snapshot(0)
    continuous.plan.kind = "continuous"
    model.follow(continuous)
    assert asked[4:] == [10]  # it may end after ten cycles


def test_what_cannot_be_reached_or_assessed_is_reported(model: EnoughCycles, ended: list[str]) -> None:
    """A U below the noise, readings that do not fit, a failed analysis: the run continues, with the cause."""
    said: list[str] = []
    model._report = said.append
    Done.result = known(1, 0.1, 0.09)
    for _ in range(2):
        model.follow(snapshot(1))
    assert (
        uncertainty_text(model, snapshot(1)) == "U 0.1 mm of 0.08 mm asked, the 5 cycles of the plan lead to U 0.092 mm"
    )
    Done.failure = JobFailure("the file is damaged", "", "")
    for _ in range(2):
        model.follow(snapshot(2))
    assert uncertainty_text(model, snapshot(2)) == "U is not known after 2 cycles: the file is damaged"

    def refuse() -> None:
        raise RequestError("9 rows for 19 plateaus")

    model._enter = refuse
    model.follow(snapshot(3))
    assert [text.rsplit(": ", 1)[-1] for text in said[1:]] == ["the file is damaged", "9 rows for 19 plateaus"]
    assert not ended


def test_an_ended_run_and_no_u_leave_nothing(model: EnoughCycles) -> None:
    """The next run begins without an assessment; without a U asked for nothing is shown; a wrong one is refused."""
    model.known = known(2, 0.079, 0.05)
    model.follow(snapshot(2, SessionState.FINISHING))
    assert model.known is not None
    model.follow(snapshot(2, SessionState.IDLE))
    assert model.known is None
    for wrong in (0.0, math.nan):
        with pytest.raises(RequestError):
            model.ask(wrong, "mm")
    model.ask(None, "mm")
    assert uncertainty_text(model, snapshot(2)) == ""


def test_at_its_end_a_run_has_the_u_of_all_its_cycles(model: EnoughCycles, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last cycle of a plan is assessed after the run; one that ended the run is not assessed again."""
    plan, assessed = built_in_plans()["calibration"], known(5, 0.12, 0.1)
    monkeypatch.setattr("analysis.stopping.criterion.assess_run", lambda *_, **__: assessed)
    end = model.at_end(Path("run.boat"), plan)
    text = "U 0.12 mm of 0.08 mm asked after all 5 cycles: not reached, no number of cycles leads to it"
    assert end == EndUncertainty(0.08, "mm", 0.12, 5, reached=False, text=text)
    Done.result = known(2, 0.079, 0.05)
    for _ in range(2):
        model.follow(snapshot(2))
    model.follow(snapshot(2, SessionState.IDLE))
    end = model.at_end(Path("run.boat"), plan)
    assert end is not None
    assert (end.reached, end.value, end.cycles, end.text) == (True, 0.079, 2, Done.result.end)
    model.ask(None, "mm")
    assert model.at_end(Path("run.boat"), plan) is None


def test_a_cycle_beyond_the_end_is_assessed_too(model: EnoughCycles, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that became complete while the assessment was made that ended the run."""
    monkeypatch.setattr("analysis.stopping.criterion.assess_run", lambda *_, **__: known(3, 0.07, 0.05))
    Done.result = known(2, 0.079, 0.05)
    model.follow(snapshot(2))
    model.follow(snapshot(3))
    end = model.at_end(Path("run.boat"), built_in_plans()["calibration"])
    assert end is not None
    assert (end.cycles, end.value) == (3, 0.07)


def test_an_end_without_a_known_u_has_the_reason(model: EnoughCycles, tmp_path: Path) -> None:
    """A recording that cannot be analysed."""
    model.ask(0.5, "% FSO")
    end = model.at_end(tmp_path / "none.boat", built_in_plans()["repeatability"])
    assert end is not None
    assert (end.value, end.cycles, end.reached) == (None, None, False)
    assert end.text.startswith("the uncertainty is not known at the end of the run, 0.5 % FSO asked: ")


def test_a_value_is_of_its_unit_alone(model: EnoughCycles, ended: list[str]) -> None:
    """0.08 mm of a calibration ended a repeatability run at 0.08 % FSO."""
    plans = built_in_plans()
    assert model.asked_of(plans["calibration"]) == (0.08, "mm")
    assert model.asked_of(plans["repeatability"]) is None
    assert model.asked_of(plans["step-test"]) is None
    own = dataclasses.replace(plans["repeatability"], end_percent_fso=0.3)
    assert model.asked_of(own) == (0.3, "% FSO")
    model.ask(0.5, "% FSO")
    assert model.asked_of(own) == (0.5, "% FSO")
    assert model.asked_of(plans["calibration"]) == (0.08, "mm")
    assert model.asked_of(plans["repeatability"]) == (0.5, "% FSO")
    armed = snapshot(0, SessionState.ARMED)
    armed.plan.kind = "continuous"
    assert uncertainty_text(model, armed) == "\u00b10.5 % FSO asked, known after a few cycles"
    assert not ended


def test_the_next_run_does_not_end_as_the_one_before(model: EnoughCycles, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that ends before its first assessment had the U of the run before."""
    monkeypatch.setattr("analysis.stopping.criterion.assess_run", lambda *_, **__: known(5, 0.12, 0.05))
    Done.result = known(2, 0.079, 0.05)
    for complete in (2, 2, 0):
        model.follow(snapshot(complete))
    end = model.at_end(Path("run.boat"), built_in_plans()["calibration"])
    assert end is not None
    assert (end.reached, end.cycles) == (False, 5)
