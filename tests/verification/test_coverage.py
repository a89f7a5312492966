"""Stated errors are true in random scenes."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from protocol.base.errors import RequestError
from tests.verification import coverage
from tests.verification.coverage import METHODS, Answer, measured, share_within, share_within_three, would_do

SCENES = {"tracer": 60}


def test_answers_and_refusals_are_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A method that errs by a normal number states 2 of it, and refuses every tenth scene or so."""

    def method(rng: np.random.Generator) -> list[Answer]:
        if rng.random() < 0.1:
            raise RequestError("no", "allow more")
        return [Answer(abs(float(rng.standard_normal())), 2.0)]

    outcomes, refused = measured(method, 2_000)
    assert len(outcomes) + refused == 2_000
    assert 150 < refused < 250
    assert 0.94 < share_within(outcomes) < 0.97
    monkeypatch.setitem(METHODS, "tracer", method)
    monkeypatch.setattr("sys.argv", ["coverage", "tracer", "--scenes", "50"])
    coverage.main()
    found = json.loads(capsys.readouterr().out)
    assert found["answers"] + found["refused"] == 50
    assert found["error_over_stated"]["0.5"] < found["error_over_stated"]["0.99"]


def test_a_setting_does_where_95_percent_of_its_errors_are_within() -> None:
    """Normal errors of half the tolerance do, of a third more do not; what was not tried is not counted."""
    errors = np.random.default_rng(0).standard_normal(1_000)
    assert would_do(0.49 * errors, 1.0)
    assert not would_do(0.65 * errors, 1.0)
    outcomes = [Answer(0.0, 1.0, third_does=each) for each in (True, False, False, False, None)]
    assert share_within_three(outcomes) == 0.75
    assert np.isnan(share_within_three([Answer(0.0, 1.0)]))


def test_no_scene_begins_after_the_time() -> None:
    """Nothing is measured in no time."""
    assert measured(lambda _: [Answer(0.0, 1.0)], 10, seconds=-1.0) == ([], 0)


@pytest.mark.nightly
@pytest.mark.parametrize("method", sorted(SCENES))
def test_stated_errors_are_true(method: str) -> None:
    """As many errors are within the statement as 93 to 97 % of all would make in 99 of 100 such samples."""
    outcomes, _ = measured(METHODS[method], SCENES[method], seed=11)
    within, count = round(share_within(outcomes) * len(outcomes)), len(outcomes)
    assert stats.binom.ppf(0.005, count, 0.93) <= within
