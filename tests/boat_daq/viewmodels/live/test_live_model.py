"""The live plots: what is drawn, cursors, statistics, frame interval."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.calibration.inverse import Fusion, Inverse
from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.viewmodels.live.live_model import HEADINGS_SHORT, STATISTICS_HEADINGS, LiveModel, with_holes
from boat_daq.workflows.live_conversion import Conversion, LiveElongation
from protocol.base.units import NOTHING
from protocol.recording import sample_dtype
from tests.boat_daq.gui.recorded_session import connected, filled_ring, idle


def test_frame_never_has_more_points_than_the_screen(ring):
    """Whatever the span, a frame holds a few points a pixel, and the extremes of all samples are in it."""
    model = LiveModel(lambda: ring, window_s=math.inf)
    frame = model.frame(800)
    assert frame.columns["time_s"].size <= 2400
    everything = ring.view()
    for name in ("s1_mv", "s2_mv", "pressure_kpa"):
        assert frame.columns[name].min() == everything[name].min()
        assert frame.columns[name].max() == everything[name].max()


@pytest.mark.parametrize("column_s", [0.01, 2.0])
def test_holes_of_time_have_no_line_and_no_band(column_s):
    """An unplugged board: the line breaks and the band closes over its hole; a lost sample breaks nothing."""
    time_s = np.repeat(np.arange(0.0, 400 * column_s, column_s), 2)
    time_s[200:] += 30 * max(column_s, 1.0)
    time_s[500:] += column_s
    columns = with_holes({"time_s": time_s, "s1_mv": np.ones(800)})
    assert np.flatnonzero(np.isnan(columns["s1_mv"])).tolist() == [200]
    assert time_s[199] < columns["time_s"][200] < time_s[200]
    mm = columns["s1_mv"]
    at, low, high = LiveElongation(mm, np.full(801, 0.5), np.zeros(801, bool)).band(columns["time_s"])
    inside = (at >= time_s[199]) & (at <= time_s[200])
    assert (high - low)[inside].tolist() == [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert np.isfinite(low).all()


def test_following_and_looking_back(ring):
    """Following ends at the newest sample; a view of the past stays where it is."""
    model = LiveModel(lambda: ring, window_s=30.0)
    assert model.span_s() == pytest.approx((569.99, 599.99))
    model.frozen_s = (100.0, 120.0)
    assert model.span_s() == (100.0, 120.0)
    model.set_window(60.0)
    assert model.span_s() == pytest.approx((539.99, 599.99))


def test_plots_fill_from_the_left(ring):
    """The time begins at the first sample and stands still until the picture is full, then follows the newest one."""
    first, second = filled_ring(25.0), filled_ring(70.0)
    short, long = LiveModel(lambda: first, window_s=60.0), LiveModel(lambda: second, window_s=60.0)
    assert short.span_s() == (0.0, 60.0)
    assert short._shown_s(733) == (0.0, 60.0)
    assert long.span_s() == pytest.approx((9.99, 69.99))
    assert LiveModel(lambda: ring, window_s=math.inf).span_s() == pytest.approx((0.0, 599.99))


def append(ring, time_s, *, s1_mv):
    """Add one sample to a filled ring."""
    sample = np.zeros(1, sample_dtype(2, "signal"))
    sample["time_us"], sample["host_ns"] = round(time_s * 1e6), round(time_s * 1e9)
    sample["signal_mv"] = s1_mv, 1624.0
    ring.append(sample)


def test_plot_moves_by_whole_columns_and_appends():
    """What is drawn on begins where the picture ended and holds every newer sample, inside its ranges."""
    ring = filled_ring(61.0)
    model, now_s = LiveModel(lambda: ring, window_s=60.0), ring.view(last=1)["time_s"][0]
    drawn, moved = model.frame(800), 0
    model.ranges(drawn, 0.0)
    column_s = 60.0 / 800
    for _ in range(100):
        now_s += 0.01
        append(ring, now_s, s1_mv=1640.0)
        more = model.newest(drawn, 800)
        columns = (more.high_s - drawn.high_s) / column_s
        assert columns == pytest.approx(round(columns), abs=1e-6)
        assert more.high_s - more.low_s == pytest.approx(60.0)
        assert more.columns["time_s"] == pytest.approx([drawn.columns["time_s"][-1], now_s])
        assert now_s <= more.high_s + 1e-9 <= now_s + column_s + 1e-6
        moved, drawn = moved + round(columns), more
    assert moved == pytest.approx(1.0 / column_s, abs=1.0)


@pytest.mark.parametrize("what", ["leaves its range", "a hole", "another width", "held", "earlier", "a calibration"])
def test_plot_that_must_change_is_drawn_whole(what):
    """A value outside the vertical range, a hole, another width, a view of the past, a calibration just loaded."""
    ring = filled_ring(60.0)
    model, now_s = LiveModel(lambda: ring, window_s=3600.0), ring.view(last=1)["time_s"][0]
    drawn = model.frame(800)
    model.ranges(drawn, 0.0)
    append(ring, now_s + 0.01, s1_mv=1640.0)
    assert model.newest(drawn, 800) is not None
    if what == "leaves its range":
        append(ring, now_s + 0.02, s1_mv=9000.0)
    elif what == "a hole":
        append(ring, now_s + 1.2, s1_mv=1640.0)
    elif what == "held":
        model.frozen_s = (0.0, 30.0)
    elif what == "earlier":
        model.frozen_s = (drawn.low_s - 100.0, drawn.high_s - 100.0)
    elif what == "a calibration":
        model.inverse = lambda mv: LiveElongation(mv[:, 0], mv[:, 1], np.zeros(len(mv), bool))
    assert model.newest(drawn, 640 if what == "another width" else 800) is None


def test_nothing_to_draw_before_the_first_sample():
    """Without a ring there is no frame, no headline and no statistics, and no error either."""
    model = LiveModel(lambda: None)
    assert model.frame(800) is None
    assert not model.has_data()
    assert model.headline(idle()).pressure == "\u2013"
    assert model.statistics() == []


def test_statistics_between_the_cursors_agree_with_numpy(ring):
    """Mean, sd, extremes and slope are those of the samples between A and B, in either order."""
    model = LiveModel(lambda: ring)
    model.cursors_s["a"] = 50.0
    model.cursors_s["b"] = 40.0
    first = model.statistics()[0]
    columns = ring.view()
    inside = (columns["time_s"] >= 40.0) & (columns["time_s"] <= 50.0)
    y, t = columns["s1_mv"][inside], columns["time_s"][inside]
    assert (first.mean, first.sd) == pytest.approx((y.mean(), y.std(ddof=1)))
    assert (first.low, first.high) == (y.min(), y.max())
    assert first.slope_per_s == pytest.approx(np.polyfit(t, y, 1)[0], rel=1e-6)
    at_a, at_b = y[t >= t[-1] - 0.2].mean(), y[t <= t[0] + 0.2].mean()
    assert first.difference == pytest.approx(at_b - at_a, rel=0.02)
    model.cursors_s["a"] = 30.0
    model.cursors_s["b"] = 40.0
    t, y = columns["time_s"], columns["s1_mv"]
    from_a, to_b = y[(t >= 30.0) & (t <= 30.2)].mean(), y[(t >= 39.8) & (t <= 40.0)].mean()
    assert model.statistics()[0].difference == pytest.approx(to_b - from_a, rel=0.02)
    ratios = {span.name: span.cells[-1] for span in model.statistics()}
    assert ratios["Sensor 1"].endswith(" dB")
    assert ratios["Pressure"] == NOTHING  # -43.6 dB of a pressure of 0 says nothing
    assert all(len(span.cells) == len(STATISTICS_HEADINGS) == len(HEADINGS_SHORT) + 1 for span in model.statistics())


def test_elongation_outside_the_range_is_not_shown(ring):
    """A signal outside the calibrated range gives a dash and the reason."""
    outside = LiveElongation(np.array([np.nan]), np.array([np.nan]), np.array([False]))
    model = LiveModel(lambda: ring, inverse=lambda signal: outside)
    head = model.headline(connected())
    assert (head.elongation, head.band) == ("\u2013", "\u25b2 out of range")


def test_elongation_says_that_its_calibration_is_loading(ring):
    """A dash alone beside "calibrated" in the header said nothing."""
    head = LiveModel(lambda: ring, loading=True).headline(connected())
    assert (head.elongation, head.band) == ("\u2013", "preparing")


@given(st.floats(1.0, 3600.0), st.integers(200, 3000), st.floats(0.0, 100.0))
def test_frame_interval_follows_the_visible_motion(window_s, width, cost_ms):
    """The frame interval is at least 60 a second and never slower than a byte may take to its pixel."""
    interval = LiveModel(lambda: None, window_s=window_s).frame_interval_ms(width, cost_ms, connected=True)
    assert 16 <= interval <= 45


def test_expensive_frames_are_fewer(ring):
    """Frames of 2 ms are drawn as the picture moves, at 60 a second; of 6 ms only as a fifth of a core allows."""
    model = LiveModel(lambda: ring, window_s=10.0)
    assert [model.frame_interval_ms(800, cost_ms, connected=True) for cost_ms in (2.0, 6.0)] == [16, 30]


def test_elongation_a_little_beyond_the_range_is_shown_and_marked(ring):
    """A value up to two u beyond the end is read, with its mark; in the table it has a column of its own."""
    model = LiveModel(
        lambda: ring,
        inverse=lambda mv: LiveElongation(
            np.full(len(mv), 3.85), np.full(len(mv), 0.1), np.zeros(len(mv), bool), np.ones(len(mv), bool)
        ),
    )
    head = model.headline(connected())
    assert head.elongation == "+3.85"
    assert (head.band, head.band_short) == ("\u00b10.10 at end", "\u00b10.10 end")


@pytest.mark.parametrize("window_s", [math.inf, 60.0])
def test_hold_at_the_end_of_the_range_is_drawn_by_its_extremes(window_s):
    """Thinned, half its samples outside, a hold was a comb; each column is as of the samples; a hole of time stays."""
    ring = RingBuffer(1, mv_per_count=1.0)
    samples = np.zeros(60_000, sample_dtype(1, "signal"))
    samples["time_us"] = np.arange(60_000) * 10_000 + (np.arange(60_000) >= 30_000) * 60_000_000
    samples["signal_mv"] = 1400.0 + np.random.default_rng(3).normal(0.0, 3.0, (60_000, 1))
    samples["signal_mv"][20_000:25_000] += 50.0  # all outside
    ring.append(samples)
    u_mm, nodes = np.full(129, 0.03), np.linspace(800.0, 1400.0, 257)  # 1000 mV + 100 mV/mm, -2 mm to 4 mm
    sensor = Inverse((-2.0, 4.0), np.array([-1.0, 1.0]), np.array([[1100.0, 300.0]]), nodes, u_mm, 0.0 * u_mm)
    frame = LiveModel(lambda: ring, Conversion(Fusion((sensor,), np.eye(1))), window_s=window_s).frame(300)
    time_s, mm, width_s = frame.columns["time_s"], frame.elongation.mm, (frame.high_s - frame.low_s) / 300
    low, high = extremes_by_column(time_s, mm, width_s)
    sample_s, raw = samples["time_us"] * 1e-6, (samples["signal_mv"][:, 0] - 1000.0) / 100.0
    shown = sample_s >= frame.low_s
    true_low, true_high = extremes_by_column(sample_s[shown], raw[shown], width_s)
    known = {at for at, least in true_low.items() if least <= 4.06}  # two u beyond the end
    off = known ^ {at for at, least in low.items() if np.isfinite(least)}
    assert len(off) <= 4  # at the ends of the outside and of the hole
    both = sorted(known - off)
    assert np.mean([low[at] - true_low[at] for at in both]) == pytest.approx(0.0, abs=2e-3)
    assert np.mean([high[at] - min(true_high[at], 4.06) for at in both]) == pytest.approx(0.0, abs=2e-3)
    assert np.isnan(frame.columns["s1_mv"]).sum() == math.isinf(window_s)


def extremes_by_column(time_s, values, width_s):
    """Return the least and greatest value by column of pixels."""
    column = np.floor(time_s / width_s).astype(int)
    parts = {int(at): values[column == at] for at in np.unique(column)}
    parts = {at: part[np.isfinite(part)] for at, part in parts.items()}
    return (
        {at: part.min() if part.size else math.nan for at, part in parts.items()},
        {at: part.max() if part.size else math.nan for at, part in parts.items()},
    )


@pytest.mark.parametrize(("at_s", "expected"), [(10.0, 5.0), (30.02, 12.5), (60.0, None)])
def test_value_at_an_instant_is_the_mean_about_it(at_s, expected):
    """As long as a readout's mean; of the nearest sample where fewer come than that; none where there are no data."""
    ring = filled_ring(20.0)
    for time_s, mv in ((29.9, 12.5), (30.7, 99.0)):
        append(ring, time_s, s1_mv=mv)
    values = LiveModel(lambda: ring).values_at(at_s)
    columns = ring.view()
    about = np.abs(columns["time_s"] - at_s) <= 0.1
    if expected == 5.0:
        assert values["s1_mv"] == pytest.approx(columns["s1_mv"][about].mean(), abs=0.5)
        assert values["pressure_kpa"] == pytest.approx(columns["pressure_kpa"][about].mean(), abs=0.05)
    else:
        assert values.get("s1_mv") == expected
