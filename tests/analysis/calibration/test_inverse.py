"""The inverse: exact inside the range, undefined outside, its stated uncertainty true."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis import AnalysisError, Fusion, Inverse, fit_calibration
from tests.analysis.boat_builder import PAPER

X = np.tile(np.linspace(-2.7, 3.8, 10), 5)


def fitted(sensor: int = 0, sign: float = 1.0, noise: float = 1.0, seed: int = 0):  # type: ignore[no-untyped-def]
    """A calibration of the paper's cubic with noise."""
    rng = np.random.default_rng(seed)
    return fit_calibration(X, sign * np.polynomial.Polynomial(PAPER[sensor])(X) + noise * rng.standard_normal(X.size))


@settings(deadline=None)
@given(st.floats(0, 1), st.sampled_from([1.0, -1.0]), st.integers(0, 1))
def test_there_and_back_is_exact_inside_the_range(share: float, sign: float, sensor: int) -> None:
    """x -> mV -> x closes to 1e-10 mm at every x of the range, its ends included, rising or falling."""
    calibration = fitted(sensor, sign)
    x = calibration.x_range[0] + share * (calibration.x_range[1] - calibration.x_range[0])
    assert float(Inverse.of(calibration)(calibration.predict(x))) == pytest.approx(x, abs=1e-10)


@pytest.mark.fault(41, how="signals outside the calibrated range, rising and falling", times=2)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_outside_the_range_there_is_no_value(sign: float) -> None:
    """Fault 41: NaN outside, marked as outside; the end of the range where requested; NaN stays NaN."""
    calibration = fitted(sign=sign)
    inverse = Inverse.of(calibration)
    beyond = calibration.predict(np.asarray(calibration.x_range)) + sign * np.asarray([-5.0, 5.0])
    assert np.isnan(inverse(beyond)).all()
    np.testing.assert_allclose(inverse(beyond, clamp=True), calibration.x_range)
    assert np.isnan(inverse([np.nan], clamp=True)).all()
    assert inverse.evaluate([*beyond, np.nan]).outside.tolist() == [True, True, False]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_signal_of_the_last_position_is_read_without_bias(sign: float) -> None:
    """Signals of the range's end with their noise: 97 % are read, half of them marked beyond; the mean is the end.

    The mean of those that are kept is cut at two u on one side: 0.06 sd at most. Beyond two u there is no value.
    """
    calibration = fitted(sign=sign)
    inverse = Inverse.of(calibration, noise_sd=1.5)
    rng = np.random.default_rng(3)
    for end in calibration.x_range:
        found = inverse.evaluate(calibration.predict(end) + 1.5 * rng.standard_normal(20_000))
        assert np.isfinite(found.elongation_mm).mean() > 0.97
        assert found.beyond.mean() == pytest.approx(0.475, abs=0.02)
        assert float(np.nanmean(found.elongation_mm)) == pytest.approx(end, abs=0.06 * float(inverse.parts(end)[0]))
        u = float(inverse.standard_uncertainty(end))
        steps = np.asarray([-1.9, -2.1, 1.9, 2.1]) * u * float(calibration.slope(end))
        edge = inverse.evaluate(calibration.predict(end) + steps)
        assert (edge.beyond.sum(), edge.outside.sum()) == (1, 1)
        np.testing.assert_array_equal(np.isnan(edge.elongation_mm), edge.outside)


@pytest.mark.parametrize(("mm", "known"), [(-2.70, True), (-3.0, False)])
def test_end_that_was_rounded_inwards_is_read(mm: float, known: bool) -> None:
    """-2.70 mm is -2.5 on a grid of 0.5 mm: the plateau that ends the range lies 0.2 mm beyond it, and is read."""
    x = np.linspace(-2.70, 3.80, 37)
    y = np.polynomial.Polynomial(PAPER[0])(x)
    read = np.round(x / 0.5) * 0.5
    inverse = Inverse.of(fit_calibration(read, y, 3), noise_sd=1.5, reading_sd=0.5 / np.sqrt(12.0))
    found = inverse.evaluate(np.polynomial.Polynomial(PAPER[0])(mm))
    assert inverse.calibration.x_range[0] == -2.5
    assert (bool(found.beyond), bool(found.outside)) == (known, not known)
    assert not known or abs(found.elongation_mm - mm) < 2 * found.standard_uncertainty_mm


def test_fused_value_beyond_the_end_is_marked() -> None:
    """Both sensors one u past the upper end: a value, marked; both far past it: none."""
    sensors = [Inverse.of(fitted(0), noise_sd=1.5), Inverse.of(fitted(1), noise_sd=1.5)]
    end = [s.calibration.x_range[1] for s in sensors]
    ends = np.asarray([float(s.calibration.predict(x)) for s, x in zip(sensors, end, strict=True)])
    found = Fusion.of(sensors).evaluate(np.stack([ends + 1.0, ends + 60.0]))
    assert found.beyond.tolist() == [True, False]
    assert found.outside.tolist() == [False, True]
    assert found.elongation_mm[0] > min(end)
    assert np.isfinite(found.standard_uncertainty_mm[0])


@pytest.mark.fault(41, how="a calibration that turns inside its range", times=1)
def test_a_curve_that_turns_has_no_inverse() -> None:
    """The refusal names the turning point."""
    x = np.linspace(-1, 2, 30)
    with pytest.raises(AnalysisError, match="turns at"):
        Inverse.of(fit_calibration(x, x**2 + 1e-3 * np.sin(9 * x), 2))


def test_stated_uncertainty_is_the_scatter_of_readings() -> None:
    """Noise of 1 mV through the local slope: the sd of many readings of one x is u(x), within 3 %."""
    calibration = fitted()
    inverse = Inverse.of(calibration, noise_sd=1.0)
    rng = np.random.default_rng(5)
    readings = inverse(calibration.predict(1.0) + rng.standard_normal(40_000))
    noise, _ = inverse.parts(1.0)
    assert readings.std() == pytest.approx(float(noise), rel=0.03)


def test_two_sensors_weigh_by_their_variances() -> None:
    """Two equal, independent sensors halve the variance of the noise; the value is their mean."""
    one, two = fitted(seed=1), fitted(seed=2)
    fusion = Fusion.of([Inverse.of(one, noise_sd=2.0), Inverse.of(two, noise_sd=2.0)])
    signal = np.asarray([float(one.predict(1.0)), float(two.predict(1.0))])
    both = fusion.evaluate(signal)
    single = fusion.inverses[0].evaluate(signal[0])
    assert float(both.elongation_mm) == pytest.approx(1.0, abs=1e-6)
    assert float(both.standard_uncertainty_mm) == pytest.approx(
        float(single.standard_uncertainty_mm) / 2**0.5, rel=0.05
    )


def test_sensors_that_disagree_are_flagged() -> None:
    """A shift of 1 mm in one sensor is beyond 4 sigma; none is not."""
    one, two = fitted(0, seed=1), fitted(1, seed=2)
    fusion = Fusion.of([one, two])
    agree = [float(one.predict(1.0)), float(two.predict(1.0))]
    apart = [float(one.predict(1.0)), float(two.predict(2.0))]
    assert fusion.evaluate([agree, apart]).disagreement.tolist() == [False, True]


def test_a_sensor_outside_its_range_leaves_the_other_alone() -> None:
    """The value then is that of the sensor that still sees it; with none left it is NaN and flagged."""
    one, two = fitted(0), fitted(1)
    fusion = Fusion.of([one, two])
    found = fusion.evaluate([[float(one.predict(1.0)), 9e3], [9e3, 9e3]])
    assert found.elongation_mm[0] == pytest.approx(1.0, abs=1e-9)
    assert np.isnan(found.elongation_mm[1])
    assert found.outside.tolist() == [False, True]
