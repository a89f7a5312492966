"""The interval to the next calibration, by hand and against simulated drift."""

from __future__ import annotations

import datetime

import numpy as np
import pytest

from analysis.history.calibration_interval import proposed_interval

START = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def at(*days: float) -> list[datetime.datetime | None]:
    """Return times, days after the first."""
    return [START + datetime.timedelta(days=day) for day in days]


def test_interval_of_two_calibrations_by_hand() -> None:
    """0.1 mm in 100 days, u = 0.01 mm each: t where 0.001 t + 2 sqrt(0.01^2 + (1.414e-4 t)^2) is 0.15 mm."""
    found = proposed_interval(at(0, 100), np.asarray([0.0, 0.1]), np.full(2, 0.01), 0.15)
    u_slope = 0.01 * np.sqrt(2) / 100
    assert found.drift_mm_per_year == pytest.approx(0.1 * 3.6525)
    assert found.drift_u == pytest.approx(u_slope * 365.25)
    reached = 0.001 * found.days + 2 * np.hypot(0.01, u_slope * found.days)
    assert reached == pytest.approx(0.15)
    assert found.significant
    assert found.due_utc == (START + datetime.timedelta(days=100 + int(found.days))).isoformat()


def test_interval_is_no_longer_than_twice_the_time_that_is_known() -> None:
    """Without drift and with a wide limit it is cut, and says so."""
    found = proposed_interval(at(0, 30, 60), np.zeros(3), np.full(3, 1e-6), 1.0)
    assert (found.days, found.extrapolated) == (120.0, True)
    assert "twice the time" in found.sentence


def test_scatter_between_calibrations_shortens_the_interval() -> None:
    """The same line with five times its stated scatter about it: a wider slope, an earlier date."""
    days = np.arange(6) * 50.0
    around = np.asarray([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    calm, rough = (
        proposed_interval(at(*days), 1e-4 * days + scatter * around, np.full(6, 0.005), 0.1) for scatter in (0.0, 0.02)
    )
    assert calm.days > rough.days > 0
    assert rough.drift_u > 2 * calm.drift_u


def test_limit_that_the_calibration_itself_does_not_keep_is_due_at_once() -> None:
    """U of the last calibration is 0.2 mm, the permissible drift 0.1 mm."""
    found = proposed_interval(at(0, 10), np.zeros(2), np.full(2, 0.1), 0.1)
    assert found.days == 0.0
    assert "less than a day" in found.sentence


@pytest.mark.parametrize(
    ("days", "u", "limit", "reason"),
    [
        ((0.0,), 0.1, 1.0, "one calibration"),
        ((0.0, 0.0), 0.1, 1.0, "less than a day"),
        ((0.0, 25 / 86_400, 50 / 86_400), 0.1, 1.0, "less than a day"),
        ((0.0, 1.0), 0.0, 1.0, "uncertainty of a calibration"),
        ((0.0, 1.0), 0.1, float("nan"), "uncertainty of an elongation"),
    ],
)
def test_interval_is_void_with_a_reason(days: tuple[float, ...], u: float, limit: float, reason: str) -> None:
    """Nothing is proposed from nothing."""
    found = proposed_interval(at(*days), np.zeros(len(days)), np.full(len(days), u), limit)
    assert reason in found.void
    assert found.sentence.startswith("no recalibration interval is proposed")
    assert found.as_json()["due_utc"] == ""
    assert "not known" in proposed_interval([None, START], np.zeros(2), np.ones(2), 1.0).void


@pytest.mark.nightly
def test_drift_stays_permissible_over_the_interval() -> None:
    """Units of a known drift: at the proposed date 95 % or more are within the limit (k = 2)."""
    rng, kept = np.random.default_rng(0), []
    days = np.asarray([0.0, 90.0, 180.0, 270.0])
    for _ in range(4000):
        drift = rng.normal(0.0, 4e-4)
        seen = drift * days + rng.normal(0.0, 0.01, days.size)
        found = proposed_interval(at(*days), seen, np.full(4, 0.01), 0.1)
        true = drift * (days[-1] + found.days)
        kept.append(abs(true - seen[-1]) <= 0.1)
    assert np.mean(kept) >= 0.95
