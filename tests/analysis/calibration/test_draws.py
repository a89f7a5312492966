"""Means and quantiles as other draws would give them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from analysis.calibration.draws import (
    errors_by_chance,
    greatest_error,
    lower_quantiles_by_chance,
    means_by_chance,
    quantiles_by_chance,
)
from analysis.statistics import resampling_weights


def test_the_error_of_both_limits_is_that_of_other_draws() -> None:
    """Of 300 sets of 1,000 normal draws both limits are within the stated error in 92 to 98 %."""
    rng, inside = np.random.default_rng(1), []
    truth = stats.norm.ppf([0.025, 0.975])
    for _ in range(300):
        values = rng.standard_normal(1_000)
        limits = np.quantile(values, [0.025, 0.975])
        error = greatest_error(quantiles_by_chance(values, 0.025) - limits[:, None])
        inside.append(np.abs(limits - truth).max() <= error)
    assert 0.92 <= np.mean(inside) <= 0.98


def test_a_mean_errs_by_its_standard_error() -> None:
    """Of 400 values with a standard deviation of 2: a tenth."""
    values = np.random.default_rng(2).normal(5.0, 2.0, 400)
    assert means_by_chance(values).std() == pytest.approx(values.std() / 20.0, rel=0.1)


def test_what_rests_on_the_same_rows_errs_together() -> None:
    """Equal marks have equal errors, opposite ones opposite, of other rows unrelated ones; constant marks have none."""
    marks = np.random.default_rng(3).standard_normal((2, 2_000))
    one, other = (errors_by_chance(each) for each in marks)
    np.testing.assert_allclose(errors_by_chance(-2.0 * marks[0]), -one)
    assert one.std() == pytest.approx(1.0, abs=0.1)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.25
    assert not errors_by_chance(np.ones(100)).any()


def test_the_limits_of_few_cycles_jump() -> None:
    """Resamples of two cycles have three means, of which a quarter is the lowest: its 2.5 % quantile has no error."""
    weights = resampling_weights(2, np.random.default_rng(4), 1_000)
    assert np.ptp(lower_quantiles_by_chance(weights @ [0.0, 0.5], 0.025)) == 0.0
    beside = np.sort(np.repeat([0.0, 1.0, 2.0], [26, 400, 574]))
    assert set(lower_quantiles_by_chance(beside, 0.025)) == {0.0, 1.0}
