"""Samples for a script: whole blocks, in order, counted where they are lost."""

from __future__ import annotations

import threading

import numpy as np
import pandas as pd

from boat_daq.engine.session.measured_blocks import SampleQueue, blocks
from protocol.recording import channels_of, sample_dtype


def samples(first: int, n: int, sensors: int = 2) -> np.ndarray:
    """Return n samples at 100 Hz whose signal of sensor 1 is their index, in counts."""
    array = np.zeros(n, sample_dtype(sensors))
    array["index"] = np.arange(first, first + n)
    array["time_us"] = array["index"].astype(np.int64) * 10_000
    array["pressure_pa"] = array["index"] * 10.0
    array["lit"][:, 0] = array["index"] + 100
    array["dark"][:, 0] = 100
    return array


def queue(capacity: int = 1000) -> SampleQueue:
    return SampleQueue(lambda: 5.0, lambda: 0.5, capacity=capacity)


def test_take_joins_what_waits_in_order() -> None:
    waiting = queue()
    waiting(samples(0, 3))
    waiting(samples(3, 2))
    block = waiting.take()
    assert block is not None
    np.testing.assert_array_equal(block.index, np.arange(5))
    np.testing.assert_array_equal(block.signal_mv[:, 0], 0.5 * np.arange(5))
    np.testing.assert_array_equal(block.target_kpa, np.full(5, 5.0))
    np.testing.assert_allclose(block.time_s, 0.01 * np.arange(5), rtol=0, atol=1e-12)
    assert waiting.take() is None


def test_a_full_queue_discards_the_oldest_and_counts_them() -> None:
    waiting = queue(capacity=10)
    for first in range(0, 20, 4):
        waiting(samples(first, 4))
    block = waiting.take()
    assert block is not None
    assert (block.skipped, block.index[0], len(block)) == (12, 12, 8)
    waiting(samples(20, 1))
    after = waiting.take()
    assert after is not None
    assert after.skipped == 0


def test_samples_of_another_board_are_another_block() -> None:
    waiting = queue()
    waiting(samples(0, 3))
    waiting(samples(0, 2, sensors=4))
    shapes = [block.signal_mv.shape for block in (waiting.take(), waiting.take()) if block is not None]
    assert shapes == [(3, 2), (2, 4)]


def test_blocks_end_after_the_requested_time_exactly() -> None:
    waiting = queue()
    waiting(samples(7, 60))
    waiting(samples(67, 60))
    found = list(blocks(waiting, lambda: True, 1.0, 0.0))
    assert sum(map(len, found)) == 100
    assert found[-1].index[-1] == 106


def test_blocks_end_with_the_link_and_lose_nothing() -> None:
    """What came before the link closed is yielded."""
    waiting, closed = queue(), threading.Event()
    waiting(samples(0, 5))
    found = blocks(waiting, lambda: not closed.is_set(), None, 0.0)
    assert len(next(found)) == 5
    waiting(samples(5, 4))
    closed.set()
    assert [len(block) for block in found] == [4]


def test_a_block_is_a_frame_in_the_columns_of_the_export() -> None:
    waiting = queue()
    waiting(samples(0, 3))
    block = waiting.take()
    assert block is not None
    frame = block.to_frame()
    assert list(frame) == ["index", "time_s", "pressure_kpa", "target_kpa", "s1_mv", "s2_mv", "state", "flags"]
    pd.testing.assert_series_equal(frame["s1_mv"], pd.Series([0.0, 0.5, 1.0], name="s1_mv"))


def test_extra_channels_are_in_blocks_and_frames() -> None:
    """The values that the window shows, in the columns of a recording; other channels are another block."""
    definitions = [channels_of([("temperature", "degC")])]
    waiting = SampleQueue(lambda: 5.0, lambda: 0.5, lambda: definitions[-1])
    array = np.zeros(3, sample_dtype(2, "counts", 1))
    array["lit"][:, 0], array["channel"][:, 0] = [10, 20, 30], [20.0, np.nan, 25.0]
    waiting(array)
    waiting(array[:1])
    definitions.append(channels_of([("flow", "")]))
    waiting(array)
    block, later = waiting.take(), waiting.take()
    assert block is not None
    assert later is not None
    np.testing.assert_array_equal(block.others["temperature_degc"], [20.0, np.nan, 25.0, 20.0])
    assert list(later.others) == ["flow"]
    assert list(block.first(2).to_frame().columns)[-1:] == ["temperature_degc"]
    assert len(block.first(2).to_frame()) == 2
