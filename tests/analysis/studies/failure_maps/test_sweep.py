"""Outcomes of a study, and its sweep."""

from __future__ import annotations

import math

import pytest

from analysis.studies.failure_maps.sweep import Axis, CellOutcome, Study, StudyResult, outcome_of, sweep
from protocol.base.errors import DataError


@pytest.mark.parametrize(
    ("result", "outcome"),
    [
        (StudyResult(0.5), CellOutcome.WORKS),
        (StudyResult(1.0), CellOutcome.WORKS),
        (StudyResult(1.0001), CellOutcome.WRONG_UNWARNED),
        (StudyResult(0.5, "a flag"), CellOutcome.WARNS),
        (StudyResult(math.inf, "a flag"), CellOutcome.WARNS),
        (StudyResult(math.inf), CellOutcome.WRONG_UNWARNED),
        (StudyResult(math.nan, "no span"), CellOutcome.REFUSES),
        (StudyResult(math.nan), CellOutcome.WRONG_UNWARNED),
    ],
)
def test_outcome_follows_from_error_and_message(result: StudyResult, outcome: CellOutcome) -> None:
    """A wrong number, or none, is accepted only with a message; tolerance 1."""
    assert outcome_of(result, 1.0) is outcome


def ladder(x: float, y: float) -> StudyResult:
    """Right below 2, a warning from 2, refused from 3; wrong without warning where x and y are 1."""
    if x >= 3:
        raise DataError("too far", "Come back.")
    return StudyResult(5.0 if x == y == 1 else 0.0, "far" if x >= 2 else "")


def ladder_study() -> Study:
    return Study(
        "ladder-x", "ladder", "A ladder", "itself", "mm", 1.0, Axis("x", "mm", (0, 1, 2, 3)),
        Axis("y", "", (0, 1), ("none", "one")), ladder,
    )  # fmt: skip


def test_a_sweep_visits_every_point_and_counts_the_outcomes() -> None:
    """Four by two points; the one wrong without warning is found, and the refusal keeps its cause."""
    seen: list[tuple[float, float]] = []
    found = sweep(ladder_study(), lambda done, total: seen.append((done, total)))
    assert seen == [(k, 8) for k in range(1, 9)]
    assert found.counts == {"works": 3, "degraded": 2, "refused": 2, "quiet wrong": 1}
    (wrong,) = found.found(CellOutcome.WRONG_UNWARNED)
    assert (wrong.x, wrong.y) == (1, 1)
    assert found.cells[0][3].message == "too far"
    assert "wrong without warning at 1 of 8" in found.verdict


def test_a_sweep_is_cancelled_from_its_progress() -> None:
    """What the progress raises ends the sweep where it is."""

    def stop(done: float, _: float) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(ladder_study(), stop)


def test_errors_outside_the_family_are_no_refusal() -> None:
    """A crash of the method is not drawn as a refusal: it ends the sweep."""

    def crash(_x: float, _y: float) -> StudyResult:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        Study("n", "m", "t", "", "", 1.0, Axis("x", "", (0,)), Axis("y", "", (0,)), crash).at(0, 0)
