"""Figures out of tolerance: both sides of each limit, and the limits from the published curves."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from analysis import Options, analyse
from analysis.calibration.fit import fit_calibration
from analysis.figures.acceptance import (
    LEAST_R2,
    TOLERANCES,
    conformity_json,
    judge,
    out_of_tolerance,
    r2_statement,
    worst_conformity,
)
from analysis.figures.figure import SENSOR_FIGURES, Figure, Reason
from analysis.published import RANGE_MM, SENSORS
from tests.analysis.boat_builder import Plant, Staircase

PUBLISHED = SENSORS[0].coefficients
X = np.linspace(*RANGE_MM, 37)
Y = np.polynomial.polynomial.polyval(X, PUBLISHED)


def sensor(y, **figures):
    return SimpleNamespace(name="s1", calibration=fit_calibration(X, y), figures=figures)


def scattered(r2):
    """The published curve with residuals that a cubic cannot follow, so large that R2 comes near `r2`."""
    ripple = np.cos(np.pi * np.arange(X.size))
    return Y + ripple * np.sqrt((1 - r2) * np.var(Y))


@pytest.mark.parametrize(
    ("excess", "expected"), [(0.5, "pass"), (0.9, "conditional_pass"), (1.2, "conditional_fail"), (2.5, "fail")]
)
def test_r2_is_judged_with_the_chi_square_interval_of_its_residuals(excess, expected):
    """1 - R2 at 0.5 to 2.5 times the allowed one, with 33 degrees of freedom: only a fail gives a warning.

    The interval is (1 - R2) 33 / chi-square: 0.65 to 1.73 times, so 1 - R2 passes below 1 / 1.73 of the allowed one and
    fails above 1 / 0.65 of it.
    """
    of_curve = sensor(scattered(1.0 - excess * (1.0 - LEAST_R2)))
    stated = r2_statement("s1", of_curve.calibration, 0.0)
    assert stated.conformity == expected
    dof = X.size - 4
    low, high = of_curve.calibration.r2_interval
    assert (1.0 - low) / (1.0 - high) == pytest.approx(stats.chi2.ppf(0.975, dof) / stats.chi2.ppf(0.025, dof))
    found = out_of_tolerance(of_curve, 0.0)
    assert [one.subject for one in found] == (["r2"] if expected == "fail" else [])
    assert all(one.text.startswith("R² 0.") for one in found)


@pytest.mark.parametrize(("r2", "grid_mm", "out"), [(0.99971, 0.0, False), (0.994, 0.5, False), (0.95, 0.5, True)])
def test_r2_is_allowed_what_the_grid_of_the_readings_makes(r2, grid_mm, out):
    """Readings on a half-millimetre grid are allowed what the grid makes, not more."""
    assert bool(out_of_tolerance(sensor(scattered(r2)), grid_mm / math.sqrt(12))) is out


@pytest.mark.parametrize("unit_mv", [1.0, 1e-4])
@pytest.mark.parametrize("grid_mm", [0.0, 0.5])
def test_limit_of_r2_is_twice_the_published_residuals_and_the_grid(unit_mv, grid_mm):
    """1 - R2 four times that of the worse sensor, and twice the variance of a grid's rounding, in any unit of y."""
    residual = 4.0 * max(1.0 - one.r2 for one in SENSORS)
    straight = SimpleNamespace(name="s1", calibration=fit_calibration(X, unit_mv * X, 1))
    rounding = 2.0 * grid_mm**2 / 12.0 / np.var(X)
    tolerance = r2_statement("s1", straight.calibration, grid_mm / math.sqrt(12.0)).tolerance
    assert tolerance.limit == pytest.approx(1.0 - residual - rounding, rel=1e-9)
    assert tolerance.source.removeprefix("twice the published residuals") == (
        " and what a grid of 0.5 mm makes" if grid_mm else ""
    )
    assert tolerance.symbol == "≥"
    assert (TOLERANCES[0].symbol, TOLERANCES[0].limits) == ("≤", (-math.inf, TOLERANCES[0].limit))


def test_limit_of_r2_of_a_level_curve_has_no_part_of_the_grid():
    """No variance, and so no share of the grid in it."""
    level = fit_calibration(X, np.full(X.size, 3.0), 1)
    assert r2_statement("s1", level, 0.1).tolerance.limit == LEAST_R2


@pytest.mark.parametrize("tolerance", TOLERANCES, ids=lambda t: t.key)
def test_a_figure_is_out_of_tolerance_beyond_its_limit_with_its_interval(tolerance):
    """Just inside, just beyond, beyond with an interval that reaches back: only what is surely beyond is named."""
    away = -1.0 if tolerance.is_lower else 1.0
    definition = SENSOR_FIGURES[tolerance.key]
    for off, half, out in ((-0.1, 0.01, False), (0.1, 0.01, True), (0.1, 0.2, False), (0.1, math.nan, True)):
        value = tolerance.limit + away * off
        figure = Figure(value, definition.unit, 5, value - half, value + half)
        found = out_of_tolerance(sensor(Y, **{tolerance.key: figure}), 0.0)
        assert [warning.subject for warning in found] == ([tolerance.key] if out else [])
        beyond = (
            f" {value:.1f} {definition.unit} is {'below' if tolerance.is_lower else 'above'} {tolerance.limit:.1f} ("
        )
        assert all(beyond in warning.text for warning in found)


def test_the_limit_of_the_combined_error_is_that_of_the_published_curve():
    """Twice: largest distance of the published cubic of sensor 1 from its straight line, with 4.95 % hysteresis."""
    x = np.linspace(*RANGE_MM, 4001)
    y = np.polynomial.polynomial.polyval(x, PUBLISHED)
    line = np.polynomial.Polynomial.fit(x, y, 1)
    combined = math.hypot(100 * np.abs(y - line(x)).max() / abs(y[-1] - y[0]), SENSORS[0].system_hysteresis_percent_fso)
    (limit,) = (t.limit for t in TOLERANCES if t.key.startswith("combined"))
    assert limit == pytest.approx(2 * combined, abs=0.1)


def test_without_a_calibration_no_verdict_is_given():
    """A run without readings has another obstacle."""
    assert out_of_tolerance(SimpleNamespace(calibration=None, figures={}), 0.1) == ()


@pytest.mark.parametrize("grid_mm", [0.1, 0.5])
def test_a_sound_session_is_within_tolerance(tmp_path, grid_mm):
    """The published sensors with their noise and loop, read on a grid up to half a millimetre."""
    stairs = Staircase(Plant(loop_mm=0.25), cycles=2)
    table = stairs.elongations()
    table["elongation_mm"] = grid_mm * np.round(table["elongation_mm"] / grid_mm)
    table.to_csv(tmp_path / "e.csv", index=False)
    found = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False, x_resolution_mm=grid_mm))
    assert [out_of_tolerance(sensor, found.reading_sd_mm) for sensor in found.sensors] == [(), ()]


def of_sensor(**figures: Figure) -> SimpleNamespace:
    """A sensor with these figures and no calibration."""
    return SimpleNamespace(name="s1", calibration=None, figures=figures)


def test_a_limit_inside_the_interval_is_no_verdict_of_fail_or_pass():
    """4.95 % with 4.893 to 4.987 against 4.9 and 4.97: conditional; against 4.8 and 5.0 not."""
    figure = Figure(4.95, "% FSO", 5, 4.893, 4.987)
    expected = {4.8: "fail", 4.9: "conditional_fail", 4.97: "conditional_pass", 5.0: "pass"}
    for limit, conformity in expected.items():
        (found,) = judge([of_sensor(system_hysteresis_percent_fso=figure)], {"hysteresis": limit})
        assert found.conformity == conformity
        assert f"sensor 1: 4.95 % FSO, limit {limit:g} % FSO, conformity " in found.text  # it was "of s1"


def test_a_drift_is_limited_on_both_sides():
    """-2 % per 100 cycles with 0.1 of uncertainty against 1: a fail; against 3 a pass; a lower limit is one-sided."""
    drift = Figure(-2.0, "% FSO/100 cycles", 5, -2.1, -1.9)
    sensor = of_sensor(drift_percent_fso_per_100_cycles=drift, snr_db=Figure(44.0, "dB", 5, 43.5, 44.5))
    assert [one.conformity for one in judge([sensor], {"drift": 1.0})] == ["fail"]
    assert [one.conformity for one in judge([sensor], {"drift": 3.0})] == ["pass"]
    assert [one.conformity for one in judge([sensor], {"snr": 43.0})] == ["pass"]
    assert [one.conformity for one in judge([sensor], {"snr": 44.2})] == ["conditional_fail"]


def test_a_figure_without_an_interval_has_conditional_statements_only():
    """One cycle gives no interval: neither pass nor fail is certain; a void figure has no statement."""
    sensor = of_sensor(system_hysteresis_percent_fso=Figure(4.0, "% FSO", 1, reason=Reason.ONE_CYCLE))
    stated = judge([sensor], {"hysteresis": 5.0})[0]
    assert stated.conformity == "conditional_pass"
    assert stated.text.endswith("limit 5 % FSO, one cycle gives no uncertainty: run three")
    assert judge([sensor], {"hysteresis": 3.0})[0].conformity == "conditional_fail"
    absent = judge([sensor], {"repeatability": 3.0})[0]
    assert (absent.conformity, absent.figure.n) == ("undetermined", 0)


def test_statements_end_with_r2_of_the_calibrated_sensors():
    """Those that the user set, the published ones, and R2 of every sensor that has a calibration."""
    snr = {"snr_db": Figure(44.0, "dB", 5, 43.5, 44.5)}
    sensors = [sensor(Y, **snr), of_sensor(**snr)]
    found = conformity_json(SimpleNamespace(sensors=sensors, reading_sd_mm=0.0), {"snr": 30.0})
    assert [one["name"] for one in found] == ["snr", "snr", "snr_db", "snr_db", "r2"]
    assert found[-1]["value"] == sensors[0].calibration.r2


def test_the_worst_statement_counts_for_all_limits():
    """A fail before a conditional fail, before what is undetermined, before a conditional pass, before a pass."""
    figures = {"system_hysteresis_percent_fso": Figure(4.95, "% FSO", 5, 4.893, 4.987)}
    sensor = of_sensor(**figures)
    for limit, expected in ((5.5, "pass"), (4.97, "conditional_pass"), (4.9, "conditional_fail"), (4.0, "fail")):
        assert worst_conformity(judge([sensor], {"hysteresis": limit})) == expected
    both = judge([sensor], {"hysteresis": 4.97, "repeatability": 1.0})
    assert worst_conformity(both) == "undetermined"


def test_a_figure_that_is_not_known_is_no_number_in_words():
    """A run of one cycle was said to have a combined error of nan % FSO."""
    unknown = Figure(math.nan, "% FSO", 1, math.nan, math.nan)
    (statement,) = judge([sensor(Y, system_hysteresis_percent_fso=unknown)], {"hysteresis": 5.0})
    assert statement.phrase.endswith("sensor 1: not known, limit 5 % FSO")
    (alone,) = judge([sensor(Y, sensor_hysteresis_percent_fso=unknown)], {"sensor_hysteresis": 5.0})
    assert alone.phrase.startswith("hysteresis, sensor 1 alone: ")
    for value, text in ((5.004, "5.004"), (4.9996, "4.9996"), (5.0, "5.00"), (4.95, "4.95")):  # the side is seen
        (beyond, _) = judge(
            [sensor(Y, system_hysteresis_percent_fso=Figure(value, "% FSO", 5))] * 2, {"hysteresis": 5.0}
        )
        assert f"sensor 1: {text} % FSO, limit 5 % FSO" in beyond.phrase
