"""The inverse: exact inside the range, undefined outside, its stated uncertainty true."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis import BoatDaqError, Fusion, Inverse, fit_calibration
from analysis.calibration.adequacy import expanded
from analysis.calibration.fit import fit_by_branch
from analysis.calibration.inverse import NODES, U_NODES, _uncertainty, signal_at
from tests.analysis.boat_builder import PAPER

X = np.tile(np.linspace(-2.7, 3.8, 10), 5)


def fitted(sensor: int = 0, sign: float = 1.0, noise: float = 1.0, seed: int = 0):  # type: ignore[no-untyped-def]
    """A calibration of the paper's cubic with noise."""
    rng = np.random.default_rng(seed)
    return fit_calibration(X, sign * np.polynomial.Polynomial(PAPER[sensor])(X) + noise * rng.standard_normal(X.size))


@settings(max_examples=100)
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
    with pytest.raises(BoatDaqError, match="turns at"):
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


def straight(slope: float = -25.0, *, noise: float = 0.3, shared: float = 0.4, **more: float) -> Inverse:
    """y = 1500 + slope x on -2 to 4 mm, with constant uncertainties: noise and what sensors share, mm."""
    starts, powers = np.array([-1.0, 1.0]), np.array([[1500.0 + slope, 3.0 * slope]])
    nodes = signal_at(np.linspace(-1.0, 1.0, NODES), starts, powers)
    flat = np.ones(U_NODES)
    return Inverse((-2.0, 4.0), starts, powers, nodes, noise * flat, shared * flat, **more)


@pytest.mark.parametrize("slope", [-25.0, 25.0])
def test_straight_line_by_hand(slope: float) -> None:
    """Value, slope at the ends, and u: 0.3 of noise, 0.4 shared, and 1.2 of the reference make 1.3."""
    inverse = straight(slope)
    x = np.array([-2.0, -1.0, 0.0, 3.9, 4.0])
    assert inverse(1500.0 + slope * x) == pytest.approx(x, abs=1e-12)
    assert inverse.end_slopes == pytest.approx((slope, slope))
    assert inverse.standard_uncertainty(x) == pytest.approx(np.full(5, 0.5))
    assert straight(reference=(1.2, 0.0)).standard_uncertainty(-1.0) == pytest.approx(1.3)
    assert straight(reference=(0.0, 0.3)).standard_uncertainty(4.0) == pytest.approx(1.3)


@pytest.mark.parametrize("slope", [-25.0, 25.0])
@pytest.mark.parametrize(("end", "away"), [(-2.0, -1.0), (4.0, 1.0)])
def test_value_is_given_two_u_and_half_a_division_beyond_an_end(slope: float, end: float, away: float) -> None:
    """u = 0.5 and half a division of 0.25 mm: to 1.25 mm along the tangent, and no further; the end where clamped."""
    inverse = straight(slope, half_division_mm=0.25)
    x = end + away * np.array([1.24, 1.26])
    found, clamped = (inverse.evaluate(1500.0 + slope * x, clamp=clamp) for clamp in (False, True))
    assert found.elongation_mm[0] == pytest.approx(x[0])
    assert (found.beyond.tolist(), found.outside.tolist()) == ([True, False], [False, True])
    assert clamped.elongation_mm == pytest.approx([x[0], end])
    assert np.isnan(found.elongation_mm[1])
    assert (found.standard_uncertainty_mm[0], np.isnan(found.standard_uncertainty_mm[1])) == (pytest.approx(0.5), True)
    assert not found.disagreement.any()


def test_curve_in_pieces_is_joined_where_they_meet() -> None:
    """u^3 about the middles of two pieces: the same curve, ends and joint included, and its inverse, level at 0."""
    starts = np.array([-1.0, 0.5, 1.0])
    powers = np.array([[m**3, 3.0 * m**2, 3.0 * m, 1.0] for m in (-0.25, 0.75)])
    u = np.linspace(-1.0, 1.0, 41)
    assert signal_at(u, starts, powers) == pytest.approx(u**3, abs=1e-14)
    nodes = signal_at(np.linspace(-1.0, 1.0, NODES), starts, powers)
    inverse = Inverse((-1.0, 1.0), starts, powers, nodes, np.ones(U_NODES), np.ones(U_NODES))
    assert inverse(u**3)[np.abs(u) > 0.1] == pytest.approx(u[np.abs(u) > 0.1], abs=1e-12)
    assert inverse(0.0) == pytest.approx(0.0, abs=1e-3)
    assert inverse.end_slopes == pytest.approx((3.0, 3.0))


def test_uncertainty_of_an_inverse_by_hand() -> None:
    """2 mV of noise, 3 of the model, 2 and 6 of the curve, over 20 mV/mm; level ends have the width of the range."""
    curve = SimpleNamespace(
        slope=lambda x: np.where(x < 4.0, -20.0, 0.0), curve_parts=lambda x: (2.0 + 0.0 * x, 6.0 + 0.0 * x),
        deviation_in_x=lambda x: 0.0 * x, x_range=(-2.0, 4.0),
    )  # fmt: skip
    x = np.array([-2.0, 0.0, 4.0])
    none = np.zeros(3)
    noise, shared = _uncertainty(curve, x, 2.0, 3.0, none)
    assert noise == pytest.approx([0.1, 0.1, 6.0])
    assert shared == pytest.approx([0.35, 0.35, 6.0])
    curve.slope, curve.deviation_in_x = lambda x: -20.0 + 0.0 * x, lambda x: np.where(x == 0.0, 0.5, 0.0)
    moved = _uncertainty(curve, x, 2.0, 3.0, none)
    assert moved[0] == pytest.approx([0.1, 0.1, 0.1])
    whole = expanded(np.array([0.5]), np.hypot(0.1, 0.35))[0] / 2.0
    assert np.hypot(*moved)[1] == pytest.approx(whole)
    looped = _uncertainty(curve, x, 2.0, 3.0, np.array([0.0, 4.0, 8.0]))
    whole = expanded([0.0, 0.5, 0.0], np.hypot(0.1, 0.35), half_loop=[0.0, 0.2, 0.4]) / 2.0
    assert np.hypot(*looped) == pytest.approx(whole)


@pytest.mark.parametrize("rho", [0.0, 1.0, 0.5])
def test_fusion_by_hand(rho: float) -> None:
    """u of 0.5 and 1: weights 4 and 1; noise adds in squares, the shared by its correlation, the reference whole."""
    one, two = straight(reference=(0.2, 0.0)), straight(noise=0.6, shared=0.8, reference=(0.2, 0.0))
    u = [float(each.standard_uncertainty(0.0)) for each in (one, two)]
    weights = np.array([1.0 / u[0] ** 2, 1.0 / u[1] ** 2]) / (1.0 / u[0] ** 2 + 1.0 / u[1] ** 2)
    fusion = Fusion((one, two), np.array([[1.0, rho], [rho, 1.0]]))
    found = fusion.evaluate([1500.0 - 25.0 * 1.0, 1500.0 - 25.0 * 2.0])
    assert float(found.elongation_mm) == pytest.approx(weights @ [1.0, 2.0])
    noise, shared = weights * [0.3, 0.6], weights * [0.4, 0.8]
    common = (shared**2).sum() + 2.0 * rho * shared.prod()
    assert float(found.standard_uncertainty_mm) == pytest.approx(np.sqrt((noise**2).sum() + common + 0.2**2))
    alone = fusion.evaluate([1500.0 - 25.0, np.nan])
    assert float(alone.elongation_mm) == pytest.approx(1.0)
    assert float(alone.standard_uncertainty_mm) == pytest.approx(u[0])


def test_disagreement_begins_at_four_sigma() -> None:
    """u of 0.3 and 0.4: beyond 2 mm apart, whichever is the larger, of three sensors too."""
    each = (straight(noise=0.3, shared=0.0), straight(noise=0.4, shared=0.0), straight(noise=3.0, shared=0.0))
    fusion = Fusion(each, np.eye(3))
    for apart, expected in ((1.99, False), (2.01, True)):
        for x in ([1.0, 1.0 + apart, 1.0], [1.0, 1.0 - apart, 1.0]):
            assert bool(fusion.evaluate(1500.0 - 25.0 * np.array(x)).disagreement) is expected


def test_fusion_of_nothing_or_of_other_signals_is_refused() -> None:
    """No calibrated sensor; another number of signals. Clamped, all outside: the end of the first sensor's range."""
    with pytest.raises(BoatDaqError, match="no calibrated sensor"):
        Fusion.of([])
    fusion = Fusion.of([straight(), straight()])
    with pytest.raises(BoatDaqError, match=r"shape \(3,\) do not fit 2 sensors"):
        fusion.evaluate([1.0, 2.0, 3.0])
    far = fusion.evaluate([[9e3, 9e3], [-9e3, 9e3], [np.nan, np.nan]], clamp=True)
    assert far.elongation_mm[:2].tolist() == [-2.0, 4.0]
    assert np.isnan(far.elongation_mm[2])
    assert far.outside.tolist() == [True, True, False]
    np.testing.assert_array_equal(fusion.correlation, np.eye(2))


def test_residuals_of_the_same_points_correlate_by_what_raises_x() -> None:
    """A falling sensor's residuals count with the other sign; of other points nothing is assumed."""
    rising, falling = fitted(0, 1.0, seed=3), fitted(0, -1.0, seed=3)
    mirrored = np.corrcoef(rising.residuals, -falling.residuals)[0, 1]
    assert rising.rises is not falling.rises
    assert Fusion.of([rising, falling]).correlation[0, 1] == pytest.approx(mirrored)
    assert Fusion.of([rising, rising]).correlation[0, 1] == pytest.approx(1.0)
    other = fit_calibration(X[:40], rising.y[:40])
    np.testing.assert_array_equal(Fusion.of([rising, other]).correlation, np.eye(2))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_spline_is_kept_piece_by_piece(sign: float) -> None:
    """A monotone spline with knots: the pieces are its very values, and x -> mV -> x closes across every knot."""
    mm = np.linspace(-2.7, 3.8, 37)
    x, y = np.tile(mm, 2), sign * np.tile(1500.0 + 200.0 * np.tanh(mm - 0.4), 2)
    calibration = fit_by_branch(x, y, "spline", positions=np.tile(np.arange(37), 2), branch=np.repeat([0, 1], 37))
    assert calibration.spline is not None and len(calibration.spline.knots) > 2
    inverse = Inverse.of(calibration)
    low, high = calibration.x_range
    u = np.linspace(-1.0, 1.0, 301)
    at = low + 0.5 * (high - low) * (u + 1.0)
    assert signal_at(u, inverse.starts, inverse.powers) == pytest.approx(calibration.predict(at), abs=1e-8)
    assert inverse(calibration.predict(at)) == pytest.approx(at, abs=1e-9)


def test_readings_count_only_where_they_are_stated() -> None:
    """Without `reading_sd` the shared part is that of a reading without error; with 0.1 mm it is larger."""
    calibration = fitted()
    plain, none, some = (Inverse.of(calibration, **given) for given in ({}, {"reading_sd": 0.0}, {"reading_sd": 0.1}))
    np.testing.assert_array_equal(plain.shared_mm, none.shared_mm)
    assert (some.shared_mm > 1.1 * plain.shared_mm).all()


@pytest.mark.parametrize("slope", [-25.0, 25.0])
def test_ends_themselves_are_inside(slope: float) -> None:
    """To the rounding of the signal, clamped or not; a signal that is not known stays so."""
    inverse = straight(slope)
    ends = 1500.0 + slope * np.array([-2.0, 4.0])
    for clamp in (False, True):
        assert inverse(ends, clamp=clamp) == pytest.approx([-2.0, 4.0])
        assert np.isnan(inverse(np.nan, clamp=clamp))
