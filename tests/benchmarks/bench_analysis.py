"""How long the analysis takes, and compared with a plain implementation. Prints; asserts nothing about time."""

from __future__ import annotations

import itertools
import json
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import emcee
import numpy as np
import pytest
from scipy import optimize

from analysis import Fusion, Inverse, analyse, fit_calibration, load_recording, sample_posterior, write_report
from boat_daq.engine.recording.summary import summarise
from protocol.recording import dtype_from_description
from tests.analysis.boat_builder import PAPER, Plant, triangle, write_boat
from tests.benchmarks.lengths import length

CYCLES, BLOCKS = length(100, 3), length(8640, 20)


def timed(function: Callable[[], Any], repeat: int = 1) -> tuple[float, Any]:
    """Shortest time of `repeat` calls, s, and the last result."""
    best, result = float("inf"), None
    for _ in range(length(repeat, 1)):
        start = time.perf_counter()
        result = function()
        best = min(best, time.perf_counter() - start)
    return best, result


@pytest.fixture(scope="module")
def hundred_cycles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 100 cycles, 720,001 samples."""
    path = tmp_path_factory.mktemp("analysis") / "hundred.boat"
    return write_boat(path, Plant(loop_mm=0.25, drift_mv_per_cycle=0.01).run(*triangle(CYCLES, length(72, 20))))


def plain_figures(path: Path) -> list[float]:
    """The plain implementation: numpy, a loop over cycles, scipy's peaks, 200 bootstrap resamples in a loop."""
    from scipy.signal import find_peaks

    with closing(sqlite3.connect(path)) as db, db:
        meta = {k: json.loads(v) for k, v in db.execute("SELECT key, value FROM session")}
        dtype = dtype_from_description(meta["sample_dtype"])
        samples = np.concatenate(
            [np.frombuffer(b, dtype) for (b,) in db.execute("SELECT samples FROM block ORDER BY id")]
        )
    pressure = samples["pressure_pa"] / 1000
    signals = (samples["lit"].astype(float) - samples["dark"]) * meta["vref_mv"] / 2 ** meta["adc_bits"]
    peaks = np.concatenate([[0], find_peaks(pressure, prominence=50, distance=1000)[0], [pressure.size - 1]])
    grid = np.linspace(-39, 49, 45)
    figures = []
    for y in signals.T:
        apart = []
        for a, b in itertools.pairwise(peaks):
            turn = a + int(np.argmin(pressure[a:b]))
            down, up = slice(a, turn), slice(turn, b)
            order = [np.argsort(pressure[s]) for s in (down, up)]
            branches = [np.interp(grid, pressure[s][o], y[s][o]) for s, o in zip((down, up), order, strict=True)]
            apart.append(branches[1] - branches[0])
        rng = np.random.default_rng(0)
        loops = np.asarray(apart)
        draws = (rng.integers(0, len(loops), len(loops)) for _ in range(length(200, 2)))
        figures += [np.abs(loops[drawn].mean(axis=0)).max() for drawn in draws]
    return figures


def test_a_hundred_cycles(hundred_cycles: Path, tmp_path: Path) -> None:
    """Load, segment, every figure with its interval; the PDF; a plain implementation for hysteresis alone."""
    analyse(load_recording(hundred_cycles))  # compiled and warm
    seconds, analysis = timed(lambda: analyse(load_recording(hundred_cycles)), 3)
    plain, _ = timed(lambda: plain_figures(hundred_cycles))
    pdf, _ = timed(lambda: write_report([analysis], tmp_path / "r.pdf"))
    html, _ = timed(lambda: write_report([analysis], tmp_path / "r.html"))
    print(f"\n{CYCLES} cycles, {analysis.recording.n} samples: all figures {seconds:.2f} s (target 3 s)")
    print(f"hysteresis and its interval alone, the plain way: {plain:.2f} s, {plain / seconds:.2f} of that")
    print(f"PDF {pdf:.1f} s (target 10 s), HTML {html:.1f} s")
    assert len(analysis.cycles.used) == CYCLES


def test_a_days_summary(tmp_path: Path) -> None:
    """A summary of 8.64 million samples, from the overview, against the extremes of a column that is in memory."""
    path = write_boat(tmp_path / "day.boat", Plant().run(*triangle(2, 10)))
    with closing(sqlite3.connect(path)) as db, db:
        (segment,) = db.execute("SELECT min(id) FROM segment").fetchone()
        (itemsize,) = db.execute("SELECT length(samples) / n FROM block").fetchone()
        db.execute("DELETE FROM block")
        db.execute("DELETE FROM overview")
        blocks = [(segment, 10_000_000 * i, 10_000_000 * i + 9_990_000) for i in range(BLOCKS)]
        db.executemany(
            "INSERT INTO block (segment, last_chunk, n, first_time_us, last_time_us, samples)"
            f" VALUES (?, 1, 1000, ?, ?, zeroblob({1000 * itemsize}))",
            blocks,
        )
        db.execute(
            "INSERT INTO overview SELECT id, segment, id, id, n, first_time_us, last_time_us,"
            " -40.0, 50.0, '[1500.0, 1500.0]', '[1770.0, 1700.0]', 0 FROM block"
        )
    seconds, summary = timed(lambda: summarise(path), 3)
    day = np.zeros(1000 * BLOCKS)
    plain, _ = timed(lambda: (np.minimum.reduceat(day, np.arange(0, day.size, 1000)), day.copy()))
    print(f"\nsummary of {summary.samples} samples: {seconds:.3f} s (target 1 s)")
    print(f"extremes of one column that is in memory already: {plain:.3f} s, {plain / seconds:.1f} times as long")
    assert summary.samples == 1000 * BLOCKS


def test_the_posterior() -> None:
    """The vectorised, scaled sampler against emcee on raw monomials with a scalar log-probability."""
    x = np.tile(np.linspace(-2.7, 3.8, 10), 9)
    y = np.polynomial.Polynomial(PAPER[0])(x) + 1.3 * np.random.default_rng(0).standard_normal(x.size)
    seconds, posterior = timed(lambda: sample_posterior(x, y, seed=0), 3)
    reading, _ = timed(lambda: sample_posterior(x, y, seed=0, reading_sd=0.144))

    def scalar(theta: np.ndarray) -> float:
        residual = y - np.polyval(theta[:4], x)
        return float(-0.5 * (residual @ residual) * np.exp(-2 * theta[4]) - x.size * theta[4])

    start = np.append(np.polyfit(x, y, 3), 0.3) + 1e-3 * np.random.default_rng(0).standard_normal((64, 5))
    sampler = emcee.EnsembleSampler(64, 5, scalar)
    plain, _ = timed(lambda: sampler.run_mcmc(start, length(posterior.steps, 5)))
    closed = posterior.calibration.std_errors * np.sqrt(posterior.calibration.dof / (posterior.calibration.dof - 2))
    worst = 100 * np.abs(posterior.sd / closed - 1).max()
    print(f"\nposterior: {seconds:.2f} s (target 1.5 s), {posterior.n_eff:.0f} effective samples")
    print(f"sd within {worst:.1f} % of the closed form; with reading error {reading:.2f} s")
    print(f"plain emcee, as many steps: {plain:.2f} s, {plain / seconds:.1f} times as long")
    assert posterior.converged


def test_the_inverse() -> None:
    """Values a second, one sensor and two fused, against brentq in a loop and interpolation."""
    x = np.tile(np.linspace(-2.7, 3.8, 10), 5)
    rng = np.random.default_rng(0)
    fits = [fit_calibration(x, np.polynomial.Polynomial(c)(x) + rng.standard_normal(x.size)) for c in PAPER]
    inverse, fusion = Inverse.of(fits[0]), Fusion.of(fits)
    true = rng.uniform(-2.6, 3.7, length(1_000_000, 1_000))
    signal = np.stack([fit.predict(true) for fit in fits], axis=1)
    inverse(signal[:10, 0])
    one, found = timed(lambda: inverse(signal[:, 0]), 5)
    two, _ = timed(lambda: fusion.evaluate(signal), 2)
    plain, _ = timed(
        lambda: [optimize.brentq(lambda u, y=y: float(fits[0].predict(u)) - y, -2.7, 3.8) for y in signal[:300, 0]]
    )
    live, _ = timed(lambda: [fusion.evaluate(row) for row in signal[:200]])
    error = np.abs(found - true).max()
    print(f"\ninverse: {1e-6 * true.size / one:.1f} million values/s (target 5), error {error:.0e} mm")
    millions, us = 1e-6 * true.size / two, live / 200 * 1e6
    print(f"two sensors fused, with uncertainty: {millions:.2f} million/s; one value {us:.0f} us")
    print(f"brentq in a loop: {300 / plain:.0f}/s, {plain / 300 * true.size / one:.0f} times as long")
    assert error < 1e-10
