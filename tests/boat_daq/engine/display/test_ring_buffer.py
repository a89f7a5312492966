"""The ring and its pyramid against plain arrays that keep everything."""

from __future__ import annotations

import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.engine.display.ring_buffer import ColumnRing, MinMaxPyramid, RingBuffer, fold_columns
from boat_daq.engine.link.block import Block
from boat_daq.viewmodels.live.live_model import sensor_names
from protocol import Samples
from protocol.recording import SampleFlag, channels_of, sample_dtype


def entries_of(n: int, seed: int = 0, columns: int = 3) -> np.ndarray:
    """A random walk over rising time, [columns, n]."""
    rng = np.random.default_rng(seed)
    return np.vstack([np.arange(n) * 0.01, rng.normal(size=(columns - 1, n)).cumsum(axis=1)])


def pieces(entries: np.ndarray, cuts: list[int]) -> list[np.ndarray]:
    edges = np.cumsum([0, *cuts]) % max(1, entries.shape[1])
    edges = np.unique([0, *edges, entries.shape[1]])
    return [entries[:, a:b] for a, b in pairwise(edges)]


@given(st.lists(st.integers(1, 40), max_size=30), st.integers(1, 60), st.integers(0, 200), st.integers(0, 200))
def test_a_ring_is_the_tail_of_all_that_was_written(cuts, capacity, start, stop):
    """Whatever the sizes of the pieces, a copy is the same slice of everything, as far as it is still there."""
    everything = entries_of(sum(cuts) or 1)
    ring = ColumnRing(3, capacity)
    for piece in pieces(everything, cuts):
        ring.append(piece)
    n = everything.shape[1]
    assert (ring.oldest, ring.end) == (max(0, n - capacity), n)
    expected = everything[:, max(start, ring.oldest) : stop]
    assert np.array_equal(ring.copy(start, stop), expected)


@given(st.integers(1, 300), st.integers(1, 100), st.floats(-1, 4))
def test_a_time_is_found_where_a_search_of_everything_finds_it(n, capacity, time_s):
    """The bisection allows for the turn of the ring."""
    everything = entries_of(n)
    ring = ColumnRing(3, capacity)
    ring.append(everything)
    for after, side in ((False, "left"), (True, "right")):
        expected = max(ring.oldest, int(np.searchsorted(everything[0], time_s, side)))
        assert ring.find(time_s, after=after) == expected


@given(st.integers(1, 30_000), st.lists(st.integers(1, 3_000), max_size=20), st.integers(64, 4_000), st.data())
def test_a_drawing_has_the_extremes_of_its_span_and_few_points(n, cuts, max_points, data):
    """Never more points than requested, times in order, newest sample there, and no peak lost."""
    everything = entries_of(n, seed=n)
    pyramid = MinMaxPyramid(3, 30_000)
    for piece in pieces(everything, cuts):
        pyramid.append(piece)
    low, high = sorted(data.draw(st.tuples(st.floats(0, n / 100), st.floats(0, n / 100))))
    drawn = pyramid.draw(low, high, max_points)
    assert drawn.shape[1] <= max_points
    assert (np.diff(drawn[0]) >= 0).all()
    inside = everything[:, (everything[0] >= low) & (everything[0] <= high)]
    if inside.shape[1]:
        assert (drawn[1:].min(axis=1) <= inside[1:].min(axis=1)).all()
        assert (drawn[1:].max(axis=1) >= inside[1:].max(axis=1)).all()
    whole = pyramid.draw(-np.inf, np.inf, max_points)
    assert np.array_equal(whole[1:].min(axis=1), everything[1:].min(axis=1))
    assert np.array_equal(whole[1:].max(axis=1), everything[1:].max(axis=1))
    assert whole[0, -1] == everything[0, -1]


def test_few_samples_are_drawn_as_they_are():
    """Thinning begins only where it must."""
    everything = entries_of(3_000)
    pyramid = MinMaxPyramid(3, 10_000)
    pyramid.append(everything)
    assert np.array_equal(pyramid.draw(-np.inf, np.inf, 4_000), everything)


def test_samples_that_left_the_ring_are_still_drawn():
    """A day behind an hour's ring: its extremes are there, though its samples are not."""
    everything = entries_of(400_000)
    everything[1, 1_234] = 1e6
    pyramid = MinMaxPyramid(3, 2_000)
    for start in range(0, 400_000, 5_000):
        pyramid.append(everything[:, start : start + 5_000])
    drawn = pyramid.draw(-np.inf, np.inf, 4_000)
    assert drawn.shape[1] <= 4_000
    assert drawn[0, 0] == 0.0
    assert drawn[1].max() == 1e6


def test_nan_hides_no_number():
    """An entry is NaN only where all its samples are."""
    everything = entries_of(10_000)
    everything[1, ::2] = np.nan
    everything[2] = np.nan
    pyramid = MinMaxPyramid(3, 10_000)
    pyramid.append(everything)
    drawn = pyramid.draw(-np.inf, np.inf, 500)
    assert np.nanmax(drawn[1]) == np.nanmax(everything[1])
    assert np.isnan(drawn[2]).all()


def test_a_copy_taken_while_the_writer_runs_is_whole():
    """A reader without a lock never sees an entry half of one turn and half of another."""
    ring = ColumnRing(2, 500)
    stop = threading.Event()

    def write():
        at = 0
        while not stop.is_set():
            numbers = np.arange(at, at + 137, dtype=float)
            ring.append(np.vstack([numbers, -numbers]))
            at += 137

    writer = threading.Thread(target=write)
    writer.start()
    turns, deadline = set(), time.monotonic() + 20
    while len(turns) < 50 and time.monotonic() < deadline:
        copied = ring.copy(0, ring.end)
        turns.add(ring.end // 500)
        if copied.shape[1]:
            assert (np.diff(copied[0]) == 1).all()
            assert np.array_equal(copied[0], -copied[1])
    stop.set()
    writer.join()
    assert len(turns) >= 50


def samples_of(n: int, *, first_us: int = 0, host_ns: int = 0) -> np.ndarray:
    samples = np.zeros(n, sample_dtype(2))
    samples["index"] = np.arange(n)
    samples["time_us"] = first_us + np.arange(n) * 10_000
    samples["host_ns"] = host_ns
    samples["pressure_pa"] = np.arange(n) * 100.0
    samples["lit"] = [[2048, 1024]] * n
    samples["dark"] = 24
    return samples


def test_columns_are_in_the_units_of_their_names():
    """kPa, mV = (lit - dark) * vref / 2**bits, seconds from the first sample; the target as it was set."""
    ring = RingBuffer(2, mv_per_count=3300 / 4096, capacity=100)
    ring(Block(0, b"x", events=(Samples(samples_of(3, first_us=5_000_000)),)))
    ring.target_kpa = 50.0
    ring.append(samples_of(2, first_us=5_030_000))
    view = ring.view()
    assert list(view) == ["time_s", "pressure_kpa", "target_kpa", "s1_mv", "s2_mv"]
    assert view["time_s"] == pytest.approx([0, 0.01, 0.02, 0.03, 0.04])
    assert view["pressure_kpa"] == pytest.approx([0, 0.1, 0.2, 0, 0.1])
    assert np.array_equal(view["target_kpa"], [np.nan] * 3 + [50.0] * 2, equal_nan=True)
    assert view["s1_mv"] == pytest.approx([2024 * 3300 / 4096] * 5)
    assert view["s2_mv"] == pytest.approx([1000 * 3300 / 4096] * 5)
    assert len(ring) == 5
    assert len(ring.view(0.015)["time_s"]) == 3
    assert ring.view(last=1)["time_s"] == pytest.approx([0.04])
    assert len(ring.view(0.015, last=10)["time_s"]) == 3


def test_time_continues_where_the_boards_clock_restarts():
    """After a restart the screen's time continues by the host time that passed; it never falls."""
    ring = RingBuffer(2, mv_per_count=1.0, capacity=100)
    ring.append(samples_of(3, first_us=90_000_000, host_ns=0))
    ring.append(samples_of(2, first_us=0, host_ns=2_000_000_000))
    assert ring.view()["time_s"] == pytest.approx([0, 0.01, 0.02, 2.02, 2.03])


def test_time_continues_where_a_restarted_clock_is_ahead():
    """A board whose clock begins at any time: the axis went from 1:04 to 1:00:22. A pause is no restart."""
    ring = RingBuffer(2, mv_per_count=1.0, capacity=1000)
    for second in range(3):
        ring.append(samples_of(100, first_us=second * 1_000_000, host_ns=second * 1_000_000_000))
    ring.append(samples_of(2, first_us=3_600_000_000, host_ns=7_000_000_000))
    time_s = ring.view(last=2)["time_s"]
    assert time_s[0] == pytest.approx(2.99 + 5.0)
    ring.append(samples_of(2, first_us=3_612_000_000, host_ns=19_000_000_000))  # twelve seconds without samples
    assert ring.view(last=1)["time_s"][0] == pytest.approx(2.99 + 5.0 + 12.01)


def test_a_fast_virtual_board_keeps_its_own_time():
    """At a hundred times real time a block comes seconds of board time after the one before."""
    ring = RingBuffer(2, mv_per_count=1.0, capacity=1000)
    for block in range(50):
        ring.append(samples_of(2, first_us=block * 5_000_000, host_ns=block * 50_000_000))
    assert ring.newest_s == pytest.approx(49 * 5.0 + 0.01)


def test_an_instant_of_board_time_has_its_place_in_the_picture():
    """A sample's own board time gives its own time in the ring, also after a reset; one of the old clock gives none."""
    ring = RingBuffer(2, mv_per_count=1.0, capacity=1000)
    assert ring.time_of(0) is None
    ring.append(samples_of(300, first_us=7_000_000, host_ns=0))
    assert ring.time_of(7_000_000) == 0.0
    assert ring.time_of(8_500_000) == pytest.approx(ring.view()["time_s"][150])
    ring.append(samples_of(10, first_us=20_000, host_ns=5_000_000_000))
    assert ring.time_of(20_000) == pytest.approx(ring.view()["time_s"][300])
    assert ring.time_of(8_500_000) is None


def test_what_is_implausible_is_not_drawn():
    """One absurd sample with a good checksum does not throw the axes; the pressure of an absurd signal stays."""
    samples = samples_of(4)
    samples["flags"][3] = SampleFlag.IMPLAUSIBLE
    samples["pressure_pa"][1] = 5e9
    samples["flags"][1] = SampleFlag.IMPLAUSIBLE
    samples["flags"][2] = SampleFlag.PRESSURE_INVALID
    ring = RingBuffer(2, mv_per_count=1.0)
    ring.append(samples)
    view = ring.view()
    assert np.array_equal(np.isnan(view["pressure_kpa"]), [False, True, True, False])
    assert np.array_equal(np.isnan(view["s1_mv"]), [False, True, False, True])


def test_signals_in_millivolt_are_taken_as_they_are():
    """Text profiles that give a signal need no conversion."""
    samples = np.zeros(2, sample_dtype(1, "signal"))
    samples["signal_mv"] = [[1.5], [2.5]]
    ring = RingBuffer(1, mv_per_count=1.0)
    ring.append(samples)
    assert ring.view()["s1_mv"].tolist() == [1.5, 2.5]


def test_extra_channels_are_columns_of_their_own():
    """Behind the signals, in their own unit; an implausible pressure does not make a temperature unknown."""
    channels = channels_of([("temperature", "degC"), ("supply", "mV")])
    samples = np.zeros(2, sample_dtype(2, "signal", 2))
    samples["channel"] = [[21.5, 4999.0], [22.5, np.nan]]
    samples["flags"][0] = SampleFlag.IMPLAUSIBLE
    ring = RingBuffer(2, mv_per_count=1.0, others=channels)
    ring.append(samples)
    view = ring.view()
    assert list(view)[5:] == ["temperature_degc", "supply_mv"]
    assert view["temperature_degc"].tolist() == [21.5, 22.5]
    assert np.array_equal(view["supply_mv"], [4999.0, np.nan], equal_nan=True)
    assert sensor_names(view) == ("s1_mv", "s2_mv")


def test_an_empty_ring_is_drawn_empty():
    """Before the first sample there is nothing, and no error."""
    ring = RingBuffer(2, mv_per_count=1.0)
    assert ring.draw()["time_s"].shape == ring.view()["time_s"].shape == (0,)


def test_columns_of_pixels_show_the_extremes_of_their_samples():
    """Truth: the extremes of each column, sample by sample."""
    time_s = np.arange(5000) * 0.01
    signal = np.random.default_rng(7).standard_normal(5000)
    signal[[17, 3210]] = np.nan
    folded = fold_columns(np.stack([time_s, signal]), 0.5)
    for at in range(100):
        inside = (time_s >= 0.5 * at) & (time_s < 0.5 * (at + 1))
        low, high = folded[:, 2 * at], folded[:, 2 * at + 1]
        assert (low[0], high[0]) == (time_s[inside][0], time_s[inside][-1])
        assert (low[1], high[1]) == (np.nanmin(signal[inside]), np.nanmax(signal[inside]))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_extremes_are_in_the_order_of_time(sign):
    """A falling edge was drawn as saw teeth: the minimum of each stretch came before its maximum."""
    time_s = np.arange(4000) * 0.01
    ramp = sign * np.clip(time_s - 10.0, 0.0, 8.37)
    pyramid = MinMaxPyramid(2, 8192)
    pyramid.append(np.stack([time_s, ramp]))
    drawn = pyramid.draw(0.0, 40.0, 200)
    assert drawn.shape[1] < 200
    for points in (drawn, fold_columns(drawn, 1.0), fold_columns(np.stack([time_s, ramp]), 0.5)):
        assert np.all(sign * np.diff(points[1]) >= 0.0)


def test_two_points_a_column_or_fewer_are_left_as_they_are():
    points = np.stack([np.arange(8) * 0.25, np.arange(8.0)])
    assert fold_columns(points, 0.5) is points
    assert fold_columns(points[:, :0], 0.5).shape == (2, 0)
    assert fold_columns(points, 0.75).shape[1] < 8


def test_a_camera_is_a_column_between_its_frames():
    """At the time of the least delayed blocks, from rest; NaN before the first frame and where none is seen."""
    ring = RingBuffer(2, mv_per_count=1.0)
    for block in range(100):
        samples = np.zeros(10, sample_dtype(2, "signal"))
        samples["time_us"] = (10 * block + np.arange(10)) * 10_000 + 5_000_000
        late_ns = 4_000_000 * (block % 3)  # a busy computer
        samples["host_ns"] = samples["time_us"][-1] * 1000 + 7_000_000_000 + late_ns
        ring.append(samples)
    assert "camera_mm" not in ring.view()
    for at_s in np.arange(1.0, 9.0, 1 / 30):
        x = None if 4.0 < at_s < 5.0 else 2.0 + at_s
        ring.add_camera(round((at_s + 5.0 + 7.0) * 1e9), x, None if x is None else 0.004, 2.0)
    columns = ring.view()
    assert [channel.column for channel in ring.channels] == ["camera_mm"]
    time_s, mm = columns["time_s"], columns["camera_mm"]
    seen = (time_s > 1.01) & (time_s < 8.9) & ~((time_s > 3.9) & (time_s < 5.1))
    assert np.abs(mm - time_s)[seen].max() < 1e-6
    assert np.isnan(mm[time_s < 0.99]).all()
    assert np.isnan(mm[(time_s > 4.05) & (time_s < 4.95)]).all()
    assert columns["camera_u_mm"][seen] == pytest.approx(0.004)
    assert ring.draw(2.0, 3.0, max_points=64)["camera_mm"] == pytest.approx(
        ring.draw(2.0, 3.0, max_points=64)["time_s"]
    )
