"""The health of the link against streams whose rate, drift and jitter are known."""

from __future__ import annotations

import numpy as np
import pytest

from boat_daq.engine.link.block import Block
from boat_daq.engine.link.health import ClockFit, LinkHealth
from boat_daq.engine.snapshot import LinkWarningCode
from protocol import LinkStatistics, Samples
from protocol.recording import sample_dtype


def feed(
    health: LinkHealth,
    *,
    seconds: float,
    rate_hz: float,
    drift_ppm: float = 0.0,
    jitter_ms: float = 0.0,
    first_us: int = 0,
) -> int:
    """Pass one sample a block; return the host time of the last, ns."""
    rng = np.random.default_rng(1)
    host_ns = 0
    for number in range(int(seconds * rate_hz)):
        time_us = first_us + round(number * 1e6 / rate_hz)
        true_s = (time_us - first_us) * 1e-6 * (1 + drift_ppm * 1e-6)
        host_ns = round(1e9 * (5.0 + true_s + 1e-3 * rng.uniform(0, 2 * jitter_ms)))
        samples = np.zeros(1, sample_dtype(1))
        samples["time_us"] = time_us
        health(Block(host_ns, b"x", events=(Samples(samples),)))
    return host_ns


def health_of(statistics: LinkStatistics | None = None, **more) -> LinkHealth:
    more.setdefault("clock_ns", lambda: 0)
    return LinkHealth(lambda: statistics or LinkStatistics(), **more)


@pytest.mark.fault(8, how="clock off by 0, +-200 ppm and 1 %, reads up to 4 ms late", times=4)
@pytest.mark.parametrize("drift_ppm", [0.0, 200.0, -200.0, 10_000.0])
def test_drift_is_found_under_jitter(drift_ppm):
    """200 ppm and 1 % are distinguished from zero within a minute, with reads up to 4 ms late."""
    health = health_of(asked_hz=100)
    feed(health, seconds=60, rate_hz=100, drift_ppm=drift_ppm, jitter_ms=2.0)
    snapshot = health.snapshot()
    assert snapshot.drift_ppm == pytest.approx(drift_ppm, abs=10.0)
    assert snapshot.jitter_ms == pytest.approx(4.0 / np.sqrt(12), rel=0.05)
    assert snapshot.offset_ms == pytest.approx(0.0, abs=3.0)
    assert bool(snapshot.warnings) == (abs(drift_ppm) > 5_000)


def test_the_fit_is_that_of_a_least_squares_solver():
    """Running products give numpy's polyfit, also far from the origin."""
    rng = np.random.default_rng(0)
    time_us = np.cumsum(rng.integers(5_000, 15_000, 3_000)) + 10**12
    host_ns = time_us * 1000 + rng.integers(0, 3_000_000, 3_000) + 10**15
    fit = ClockFit()
    for t, h in zip(time_us.tolist(), host_ns.tolist(), strict=True):
        fit.add(t, h)
    x, y = (time_us - time_us[0]) * 1e-6, (host_ns - host_ns[0]) * 1e-9
    slope, intercept = np.polyfit(x, y, 1)
    assert fit.slope == pytest.approx(slope, abs=1e-12)
    residuals = y - slope * x - intercept
    assert fit.jitter_ms == pytest.approx(1e3 * np.sqrt((residuals**2).sum() / (len(x) - 2)), rel=1e-6)


@pytest.mark.fault(9, how="62 Hz where 100 were requested", times=1)
def test_the_effective_rate_is_shown_and_warned_of():
    """62 Hz where 100 were requested: found by the board's own clock."""
    health = health_of(asked_hz=100)
    feed(health, seconds=20, rate_hz=62)
    snapshot = health.snapshot()
    assert snapshot.rate_hz == pytest.approx(62.0, rel=1e-3)
    assert [w for w in snapshot.warnings if w.code is LinkWarningCode.RATE and "62.0 samples/s" in w.text]


def test_a_restart_of_the_boards_clock_restarts_the_fit():
    """Two streams are never spliced into one line."""
    health = health_of()
    feed(health, seconds=30, rate_hz=50, first_us=900_000_000)
    feed(health, seconds=30, rate_hz=50, drift_ppm=300.0)
    assert health.snapshot().drift_ppm == pytest.approx(300.0, abs=1.0)


def test_a_board_at_another_speed_has_no_drift():
    """A virtual board at 100x is not a broken clock."""
    health = health_of(asked_hz=100, real_time=False)
    feed(health, seconds=60, rate_hz=100, drift_ppm=-990_000.0)
    snapshot = health.snapshot()
    assert snapshot.drift_ppm is snapshot.jitter_ms is None
    assert snapshot.warnings == ()


def test_silence_losses_and_lag_are_reported():
    """Counters and clock are warnings for the operator."""
    now_ns = 0
    health = health_of(LinkStatistics(lost=7), clock_ns=lambda: now_ns, lag_ms=lambda: 42.0)
    now_ns = feed(health, seconds=1, rate_hz=100) + 3_000_000_000
    snapshot = health.snapshot()
    assert snapshot.silent_s == pytest.approx(3.0)
    assert snapshot.lag_ms == 42.0
    assert [w.code for w in snapshot.warnings] == [LinkWarningCode.SILENT, LinkWarningCode.LOSS]
    assert [w.text for w in snapshot.warnings] == ["no data for 3 s", "7 samples lost"]


def test_another_board_on_the_port_makes_the_last_data_no_newer():
    """It was 0:00 old for as long as the board was sought and another one answered."""
    health = health_of(clock_ns=lambda: 15_000_000_000, last_ns=4_000_000_000)
    health(Block(14_000_000_000, b"HELLO of another board"))
    assert health.snapshot().silent_s == pytest.approx(11.0)


def test_before_the_first_sample_nothing_is_claimed():
    """No rate, no drift, no warning out of nothing; bytes that were sent are no sign of life."""
    health = health_of(asked_hz=100)
    health(Block(10**12, b"x", sent=True))
    snapshot = health.snapshot()
    assert snapshot.rate_hz is snapshot.drift_ppm is snapshot.jitter_ms is snapshot.offset_ms is None
    assert snapshot.silent_s == 0.0
    assert snapshot.warnings == ()
