"""Noise and SNR against values worked out by hand, and of whole runs."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from analysis.calibration_export.verdict import verdict_of
from analysis.figures.figure import Reason
from analysis.figures.noise_figures import continuous_noise, noise_and_snr, staircase_noise
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
