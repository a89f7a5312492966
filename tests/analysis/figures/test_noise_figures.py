"""Noise and SNR against values worked out by hand, and of whole runs."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from analysis import Options, Recording, analyse
from analysis.calibration_export.verdict import verdict_of
from analysis.figures.figure import Reason
from analysis.figures.noise_figures import continuous_noise, moving_noise, noise_and_snr, noise_course, staircase_noise
from analysis.statistics import bootstrap_interval, resampling_weights
from tests.analysis.boat_builder import Plant, Staircase
from tests.analysis.figures.by_hand import WEIGHTS

QUICK = Options(mcmc=False, x_resolution_mm=0.0)


def noise_parts(*squares: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return parts of three cycles with 50 degrees of freedom each."""
    return np.array(squares), np.full(3, 50.0), np.array([1.0, 2.0, 3.0])


def elongation_file(stairs: Staircase, folder: Path) -> Path:
    """The exact elongations of a staircase as a file."""
    path = folder / "elongation.csv"
    stairs.elongations().to_csv(path, index=False)
    return path


def test_noise_that_agrees_by_chance_has_the_interval_of_its_samples() -> None:
    """Three cycles of the very same noise: 1.96 / sqrt(2 * 150) of it, and 20 log10 of one more that share, in dB."""
    noise, snr = noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), 100.0, WEIGHTS)
    least = 1.96 / math.sqrt(300.0)
    assert (noise.value, noise.low, noise.high) == pytest.approx((1.0, 1.0 - least, 1.0 + least))
    reach = 20.0 * math.log10(1.0 + least)
    assert (snr.value, snr.low, snr.high) == pytest.approx((40.0, 40.0 - reach, 40.0 + reach))
    assert noise_and_snr(noise_parts(0.0, 0.0, 0.0), (1, 2, 3), 100.0, WEIGHTS)[1].reason is Reason.NO_NOISE
    assert noise_and_snr(noise_parts(0.0, 0.0, 0.0), (1, 2, 3), 0.0, WEIGHTS)[1].void == "the signal is flat"
    loud = noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), 0.0, WEIGHTS)[1]
    assert (loud.value, loud.reason, loud.n) == (-math.inf, Reason.NO_FULL_SCALE, 3)
    assert noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), math.nan, WEIGHTS)[1].reason is Reason.NO_CYCLE
    rounding = noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), 100.0, WEIGHTS, 1.0)[1]
    assert (rounding.value, rounding.reason) == (math.inf, Reason.NO_NOISE)
    small = noise_and_snr(noise_parts(2e-15, 2e-15, 2e-15), (1, 2, 3), 100.0, WEIGHTS)[1]  # 6e-9 mV, by rounding
    assert small.reason is Reason.NO_NOISE
    single = (np.array([4.0]), np.array([1.0]), np.array([1.0]))
    assert noise_and_snr(single, (1,), 100.0, np.ones((4, 1)))[0].value == 2.0
    empty = tuple(part[:0] for part in noise_parts(1.0, 1.0, 1.0))
    assert {one.reason for one in noise_and_snr(empty, (), 100.0, WEIGHTS)} == {Reason.NO_SAMPLES}


def test_interval_of_the_noise_is_that_of_the_cycles_drawn() -> None:
    """Cycles of 0.6, 1 and 1.4 mV: each resample has the rms of its cycles; none drawn gives no interval."""
    parts = noise_parts(18.0, 50.0, 98.0)
    noise, _ = noise_and_snr(parts, (1, 2, 3), 100.0, WEIGHTS)
    drawn = np.sqrt(WEIGHTS @ parts[0] / (WEIGHTS @ parts[1]))
    value = math.sqrt(166.0 / 150.0)
    low, high = bootstrap_interval(value, drawn, 3, positive=True)
    assert (noise.value, noise.low, noise.high) == pytest.approx((value, low, high))
    alone, snr = noise_and_snr(parts, (), 100.0, np.ones((4, 0)))
    assert (alone.value, snr.value) == pytest.approx((value, 20.0 * math.log10(100.0 / value)))
    assert math.isnan(alone.low)


def test_noise_of_a_staircase_takes_the_plateaus_that_count() -> None:
    """Void, outside the cycles, or of one sample: left out; 3 samples of sd 2 are 8 with 2 degrees of freedom."""

    def plateau(n: int, *, void: str = "", branch: str = "loading") -> SimpleNamespace:
        return SimpleNamespace(void=void, branch=branch, n=(n,), signal_sd_mv=(2.0,), cycle=4)

    found = staircase_noise((plateau(3), plateau(2), plateau(1), plateau(9, void="x"), plateau(9, branch="")), 0)
    assert [part.tolist() for part in found] == [[8.0, 4.0], [2.0, 1.0], [4.0, 4.0]]


def test_noise_about_a_local_cubic_leaves_out_turns_gaps_and_damage() -> None:
    """1 mV on ramps of three cycles; what is large near a turn, a gap or an unusable sample counts nothing."""
    rng = np.random.default_rng(8)
    n, period = 6000, 2000
    used = [
        SimpleNamespace(first=k * period, turn=k * period + 1000, last=(k + 1) * period - 1, number=k + 1,
                        rows=slice(k * period, (k + 1) * period))
        for k in range(3)
    ]  # fmt: skip
    y = 0.1 * np.abs(np.arange(n) % period - 1000) + rng.standard_normal(n)
    y[[1003, 2990, 4500]] += 1e3  # near a turn, near a gap, not usable
    usable = np.ones((n, 1), bool)
    usable[4500] = False
    recording = SimpleNamespace(n=n, signal_mv=y[:, None], usable=usable, gaps=(SimpleNamespace(row=2990),))
    squares, dof, cycle = continuous_noise(recording, SimpleNamespace(used=used), 0)
    assert np.sqrt(squares / dof) == pytest.approx(np.ones(3), abs=0.06)
    assert cycle.tolist() == [1.0, 2.0, 3.0]
    assert (dof > 1500).all()
    assert (dof < 2000).all()
    for few in (SimpleNamespace(used=[]), SimpleNamespace(used=used)):
        short = SimpleNamespace(n=10 if few.used else n, signal_mv=y[:, None], usable=usable, gaps=())
        assert [part.size for part in continuous_noise(short, few, 0)] == [0, 0, 0]


@pytest.mark.parametrize(("period", "half", "noise_kpa"), [(2000, 15, 0.01), (2000, 15, 0.1), (400, 4, 0.01)])
def test_samples_near_what_a_cubic_cannot_follow_count_nothing(period: int, half: int, noise_kpa: float) -> None:
    """The rows that count, by fits of numpy in each window; a fit takes the closed form of a cubic's centre weight."""
    n, row = 2 * period, np.arange(2 * period)
    used = [
        SimpleNamespace(first=k * period, turn=k * period + period // 2 - 9, last=(k + 1) * period - 1,
                        number=3 * k + 4, rows=slice(k * period, (k + 1) * period))
        for k in (0, 1)
    ]  # fmt: skip
    pressure = np.where(row % (period // 2) < period // 4, 10.0, 13.0) + 80.0 * row / n
    unusable, gap = int(0.6 * period), int(1.65 * period)
    usable = np.ones((n, 1), bool)
    usable[unusable] = False
    signal = np.random.default_rng(3).standard_normal((n, 1))
    recording = SimpleNamespace(n=n, signal_mv=signal, usable=usable, gaps=(SimpleNamespace(row=gap),))
    at = np.arange(-half, half + 1)
    smooth = {r: np.polyval(np.polyfit(at, pressure[r + at], 3), 0) for r in range(half, n - half)}
    far = {r for r in smooth if abs(pressure[r] - smooth[r]) > max(5.0 * noise_kpa, 0.005 * np.ptp(pressure))}
    turns = [r for c in used for r in (c.first, c.turn, c.last)]
    counted = np.array([
        min(abs(r - t) for t in turns) > 2 * half + 1
        and abs(r - unusable) > half
        and not -half <= r - gap <= half + 1
        and not any(r + d in far for d in at)
        for r in row
    ])  # fmt: skip
    squares, dof, cycle = continuous_noise(recording, SimpleNamespace(used=used, noise_kpa=noise_kpa), 0, pressure)
    centre = 3 * (3 * half**2 + 3 * half - 1) / ((2 * half + 3) * (2 * half + 1) * (2 * half - 1))
    assert dof == pytest.approx([counted[c.rows].sum() * (1.0 - centre) for c in used])
    assert cycle.tolist() == [4.0, 7.0]
    left = [signal[r, 0] - np.polyval(np.polyfit(at, signal[r + at, 0], 3), 0) for r in row[counted]]
    assert squares.sum() == pytest.approx(np.square(left).sum())


def test_noise_of_moving_holds_is_about_a_parabola() -> None:
    """On a parabola lies 3 times (-1, 2, 0, -2, 1), which no parabola follows: 90 with 2 degrees of freedom."""
    at = np.arange(5.0)
    hold = 4.0 - 2.0 * at + 0.7 * at**2 + 3.0 * np.array([-1.0, 2.0, 0.0, -2.0, 1.0])
    signal = np.concatenate([[9.0], hold, [5.0], hold, [8.0, 1e4], hold[:3]])[:, None]
    usable = np.ones(signal.shape, bool)
    usable[13] = False  # the sample of 1e4

    def plateau(first: int, last: int, *, void: str = "", branch: str = "loading") -> SimpleNamespace:
        return SimpleNamespace(settled_first=first, last=last, void=void, branch=branch, cycle=2)

    recording = SimpleNamespace(usable=usable, signal_mv=signal)
    counted = (plateau(1, 5), plateau(7, 11), plateau(13, 16))  # of the third three samples are usable
    found = moving_noise((*counted, plateau(1, 5, void="x"), plateau(1, 5, branch="")), 0, recording)
    assert np.array(found) == pytest.approx(np.array([[90.0, 90.0], [2.0, 2.0], [2.0, 2.0]]))
    usable[13] = True
    signal[13] = hold[0] - 3.0
    assert moving_noise(counted, 0, recording)[1].tolist() == [2.0, 2.0, 1.0]


def test_noise_grows_over_x_where_the_f_test_says_so() -> None:
    """Logarithms on a parabola give it back, relative to the rms; a slope just below the limit of F gives ones."""
    x, grid = np.linspace(2.0, 5.0, 8), np.array([2.0, 3.1, 5.0])
    variance, at_grid = (np.exp(0.3 + 0.8 * v - 0.4 * v**2) for v in (x, grid))
    assert noise_course(x, variance, grid) == pytest.approx(np.sqrt(at_grid / variance.mean()))
    assert noise_course(x[:6], variance[:6], grid) == pytest.approx(np.sqrt(at_grid / variance[:6].mean()))
    assert noise_course(x[:5], variance[:5], grid).tolist() == [1.0, 1.0, 1.0]
    assert noise_course(np.full(8, 3.0), variance, grid).tolist() == [1.0, 1.0, 1.0]
    unknown = noise_course(np.append(x, np.nan), np.append(variance, 1.0), grid)
    assert unknown == pytest.approx(noise_course(np.append(x, 9.0), np.append(variance, 0.0), grid))
    u = np.linspace(-1.0, 1.0, 8)
    other = np.polynomial.legendre.legval(u, [0, 0, 0, 1])
    vander = np.vander(u, 3)
    other -= vander @ np.linalg.lstsq(vander, other, rcond=None)[0]
    limit = math.sqrt(2.0 * stats.f.isf(1e-3, 2, 5) / 5.0 * float(other @ other) / float(u @ u))
    for times, grows in ((0.99, False), (1.01, True)):
        assert bool(np.ptp(noise_course(x, np.exp(times * limit * u + other), grid))) is grows


@pytest.mark.fault(42, how="a signal without noise", times=2)
@pytest.mark.parametrize(("noise", "expected"), [((0.0, 0.0), np.inf), ((1.0, 1.0), 20 * np.log10(255.5837 / 1.0))])
def test_snr_of_no_noise_is_infinite_with_a_reason(tmp_path: Path, noise: tuple[float, float], expected: float) -> None:
    """Fault 42: a noiseless signal gives inf with a reason."""
    stairs = Staircase(Plant(noise_mv=noise), cycles=2)
    figure = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=QUICK).sensors[0].figures["snr_db"]
    assert figure.value == pytest.approx(expected, abs=0.3)
    assert bool(figure.void) == np.isinf(expected)


@pytest.mark.fault(42, how="a signal without span", times=1)
def test_a_flat_signal_is_undefined_not_an_exception(tmp_path: Path) -> None:
    """Fault 42: zero span; every figure in % FSO is void."""
    stairs = Staircase(Plant(cubics=((1000.0,), (1000.0,)), noise_mv=(0.0, 0.0)), cycles=3)
    sensor = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=QUICK).sensors[0]
    assert np.isnan(sensor.figures["snr_db"].value)
    assert sensor.figures["system_hysteresis_percent_fso"].void == "the full-scale output is zero"


def test_interval_of_the_snr_is_that_of_the_noise_in_decibels() -> None:
    """20 log10 of the full scale over the ends of the noise's interval, and the noise divides by what is free."""
    rng = np.random.default_rng(0)
    samples = 0.5 * rng.standard_normal((6, 40, 20)) * np.linspace(0.8, 1.2, 6)[:, None, None]
    apart = samples - samples.mean(axis=2, keepdims=True)
    parts = ((apart**2).sum(axis=2).ravel(), np.full(240, 19.0), np.repeat(np.arange(1.0, 7.0), 40))
    noise, snr = noise_and_snr(parts, tuple(range(1, 7)), 250.0, resampling_weights(6, rng, 2_000))
    assert noise.value == pytest.approx(np.sqrt(samples.var(axis=2, ddof=1).mean()), rel=1e-12)
    assert snr.value == pytest.approx(20 * np.log10(250 / noise.value))
    assert [snr.low, snr.high] == pytest.approx([20 * np.log10(250 / end) for end in (noise.high, noise.low)], abs=0.05)


def test_creep_within_holds_is_no_noise(tmp_path: Path) -> None:
    """Creep of 8 % with a lag of 5 s moves a signal in each hold by several times its noise of 0.5 mV."""
    stairs = Staircase(Plant(noise_mv=(0.0, 0.0), loop_mm=0.25), cycles=3)
    run, level = stairs.recording(), np.zeros((0, 2))
    signal, level = run.signal_mv.copy(), run.signal_mv[0].copy()
    for row in range(run.n):
        level += (run.signal_mv[row] - level) / 500.0
        signal[row] = 0.92 * run.signal_mv[row] + 0.08 * level
    signal += 0.5 * np.random.default_rng(0).standard_normal(signal.shape)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    creeping = Recording.from_arrays(run.time_s, run.pressure_kpa, signal)
    found = analyse(creeping, tmp_path / "e.csv", options=Options(mcmc=False, fidelity="draft", x_resolution_mm=0.0))
    for sensor in found.sensors:
        noise = sensor.figures["noise_mv"]
        assert not sensor.settling.settled
        assert noise.low < 0.5 < noise.high
        assert noise.value == pytest.approx(0.5, rel=0.05)
    verdict = verdict_of(found)
    assert verdict.state == "check"
    assert "the holds of sensor 1 are not settled" in str(verdict.headline)


def test_noise_of_a_plateau_counts_one_degree_of_freedom_less() -> None:
    """Plateaus of three samples: the noise is unbiased, where division by three would find 0.816 of it."""
    rng = np.random.default_rng(1)
    sds = rng.standard_normal((400, 3)).std(axis=1, ddof=1)
    plateaus = tuple(
        SimpleNamespace(void="", branch="loading", n=(3,), signal_sd_mv=(sd,), cycle=1 + k % 4)
        for k, sd in enumerate(sds)
    )
    squares, dof, _ = staircase_noise(plateaus, 0)
    assert np.sqrt(squares.sum() / dof.sum()) == pytest.approx(1.0, abs=0.05)
