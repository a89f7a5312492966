"""Lag, margins, Bode points and step figures against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analysis.elongation_control.dynamic_figures import BodePoint
from analysis.elongation_control.dynamics import (
    Lag,
    bandwidth,
    bode_point,
    fit_lag,
    integral_for,
    lag_figures,
    loop_margins,
    step_figures,
)
from protocol.base.errors import DataError


def test_step_test_gives_the_lag_back_within_its_interval():
    t = np.arange(0.0, 3.0, 0.01)
    truth = Lag(0.05, 6.0, 0.8)
    noise = np.random.default_rng(0).normal(0.0, 0.01, t.size)
    found = fit_lag(t, np.minimum(t / 0.3, 1.0), truth.follow(t, np.minimum(t / 0.3, 1.0)) + noise)
    sd = np.sqrt(np.diag(found.covariance))
    assert abs(found.delay_s - 0.05) < 4 * sd[0]
    assert abs(found.omega_rad_per_s - 6.0) < 4 * sd[1]
    assert sd[1] < 0.3


def test_a_step_that_nothing_follows_is_refused():
    t = np.arange(0.0, 3.0, 0.01)
    with pytest.raises(DataError, match="does not follow the step"):
        fit_lag(t, np.minimum(t / 0.3, 1.0), np.random.default_rng(0).normal(0.0, 0.01, t.size))


def test_margins_of_an_integrator_with_a_delay_are_those_of_the_closed_form():
    # a fast lag is none: phase -90 deg - w T, gain k / w; margins pi/2 - k T and pi / (2 k T)
    margins = loop_margins(Lag(0.0, 5000.0, 1.0), 2.0, 0.1)
    assert margins.phase_deg == pytest.approx(90.0 - math.degrees(0.2), abs=0.5)
    assert margins.gain_db == pytest.approx(20 * math.log10(math.pi / 0.4), abs=0.1)
    assert margins.delay_s == pytest.approx((math.pi / 2 - 0.2) / 2.0, rel=0.01)


def test_gain_leaves_both_margins_and_uses_them():
    lag = Lag(0.03, 9.0, 0.6)
    margins = loop_margins(lag, integral_for(lag, 0.04), 0.04)
    assert margins.phase_deg >= 59.9
    assert margins.gain_db >= 9.9
    assert min(margins.phase_deg - 60.0, margins.gain_db - 10.0) < 0.2


def test_bode_point_is_that_of_the_lag():
    lag, f = Lag(0.02, 6.0, 0.7), 0.5
    t = np.arange(0.0, 8.0, 0.01)
    response = lag.response(np.array([2 * math.pi * f]))[0]
    output = abs(response) * np.sin(2 * math.pi * f * t + np.angle(response)) + 0.3 + 0.01 * t
    point = bode_point(t, np.sin(2 * math.pi * f * t), output, f)
    assert point.gain_db == pytest.approx(20 * math.log10(abs(response)), abs=1e-6)
    assert point.phase_deg == pytest.approx(math.degrees(np.angle(response)), abs=1e-6)


def test_bandwidth_is_interpolated_and_unknown_beyond_the_sweep():
    points = [BodePoint(1.0, -1.0, 0.0, 0.5, 0.0), BodePoint(2.0, -5.0, 0.0, 0.5, 0.0)]
    edge = bandwidth(points)
    assert edge.value == pytest.approx(math.sqrt(2.0))
    assert (edge.low, edge.high) == pytest.approx((2.0**0.25, 2.0**0.75))  # every gain 1 dB lower, and higher
    assert math.isnan(bandwidth(points[:1]).value)
    once = bandwidth([replace(point, u_gain_db=math.nan) for point in points])
    assert (once.value, math.isnan(once.low), math.isnan(once.high)) == (edge.value, True, True)


def test_figures_of_a_lag_are_those_of_the_second_order():
    figures = lag_figures(Lag(0.0, 5.0, 0.5), draws=20)
    assert figures.overshoot_percent.value == pytest.approx(100 * math.exp(-math.pi * 0.5 / math.sqrt(0.75)), abs=0.1)
    assert figures.bandwidth_hz.value == pytest.approx(5.0 / (2 * math.pi) * 1.2720, rel=0.01)
    assert figures.time_constant_s.low <= figures.time_constant_s.value <= figures.time_constant_s.high


def test_recorded_steps_of_a_first_order_give_its_time_constant():
    t = np.arange(0.0, 5.0, 0.005)
    found = step_figures([t, t], [1 - np.exp(-t / 0.4), 2 - 2 * np.exp(-t / 0.4)], [1.0, 2.0], 0.02)
    assert found["time_constant_s"].value == pytest.approx(0.4, abs=0.005)
    assert found["rise_s"].value == pytest.approx(0.4 * math.log(9), abs=0.01)
    assert found["overshoot_percent"].value == 0.0
