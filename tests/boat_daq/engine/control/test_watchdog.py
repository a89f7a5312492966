"""Feeding the watchdog, and the speed of the board's clock."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.engine.control.watchdog import Feeder, SpeedMeter
from protocol.link.messages import Heartbeat, Vent


@given(st.sampled_from([1.0, 5.0, 100.0]), st.lists(st.integers(1, 20), min_size=30, max_size=60))
def test_speed_is_the_ratio_of_the_clocks(speed: float, gaps_ms: list[int]) -> None:
    """Whatever the gaps between arrivals, the ratio comes out once a tenth of a second was seen."""
    meter, host_ms = SpeedMeter(), 0
    for gap in gaps_ms:
        host_ms += gap
        meter.add(host_ms * 1_000_000, round(host_ms * 1000 * speed))
    if meter.known:
        assert meter.speed == pytest.approx(speed, rel=1e-3)
    else:
        assert meter.speed == 1.0


def test_a_clock_that_goes_back_restarts_the_measurement() -> None:
    """After a restart of the board nothing is known, instead of something wrong."""
    meter = SpeedMeter()
    for n in range(100):
        meter.add(n * 10_000_000, n * 10_000)
    meter.add(1_000_000_000, 0)
    assert not meter.known and meter.speed == 1.0


@pytest.mark.parametrize(("speed", "timeout_ms", "stall_share"), [(1.0, 3000, 0.9), (100.0, 5000, 0.85)])
def test_the_board_never_waits_for_its_timeout(speed: float, timeout_ms: int, stall_share: float) -> None:
    """Fed when due, with one stall of the stated share of the timeout: the board's wait stays below its timeout."""
    feeder = Feeder()
    assert feeder.timeout_ms(speed) == timeout_ms
    feeder.sent(Heartbeat(timeout_ms), 0, 0)
    longest_us = fed_us = board_us = 0
    for n in range(4000):
        board_us += round(stall_share * timeout_ms * 1e3) if n == 2000 else round(1000 * speed / 10)
        longest_us = max(longest_us, board_us - fed_us)
        if feeder.due(round(board_us * 1e3 / speed), board_us, speed):
            feeder.sent(Vent(), round(board_us * 1e3 / speed), board_us)
            fed_us = board_us
    assert longest_us < timeout_ms * 1e3
    assert fed_us > 0


def test_a_watchdog_that_is_not_armed_is_not_fed() -> None:
    """Refused or never armed: nothing is due; refusing to disarm leaves it armed."""
    feeder = Feeder()
    assert not feeder.due(10**12, 10**9, 1.0)
    feeder.sent(Heartbeat(1000), 0, 0)
    feeder.refused(Heartbeat(0))
    assert feeder.due(10**12, 10**9, 1.0)
    feeder.refused(Heartbeat(1000))
    assert not feeder.due(10**12, 10**9, 1.0)


def test_silence_of_the_board_does_not_starve_it() -> None:
    """While board time does not advance, host time feeds."""
    feeder = Feeder()
    feeder.sent(Heartbeat(3000), 0, 0)
    assert not feeder.due(200_000_000, 0, 1.0)
    assert feeder.due(260_000_000, 0, 1.0)
