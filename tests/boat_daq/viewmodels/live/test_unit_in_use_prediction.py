"""Predicted signals in the live model: frame, difference, and the word for what disagrees."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.signal_prediction.prediction import LivePrediction, live_prediction, predict_sensors
from boat_daq.viewmodels.live import unit_in_use as watched
from boat_daq.viewmodels.live.layout import Layout
from boat_daq.viewmodels.live.live_model import LiveModel
from boat_daq.viewmodels.live.unit_in_use import DisagreementWatch
from tests.analysis.twin_unit import identified, swings
from tests.boat_daq.gui.recorded_session import filled_ring


@pytest.fixture(scope="module")
def prediction() -> LivePrediction:
    _, x, signals = swings("SA1")
    return live_prediction(*identified("SA1"), predict_sensors([(x[1000::200], signals[1000::200, i]) for i in (0, 1)]))


@pytest.fixture(scope="module")
def ring():
    return filled_ring(20.0)


def test_prediction_holds_the_hysteresis_in_its_band(prediction):
    pressure_kpa, _, signals = swings("SA1")
    predicted, half = prediction(pressure_kpa[1000:])
    inside = np.abs(signals[1000:] - predicted) <= half
    assert inside[np.isfinite(predicted)].mean() > 0.95
    assert prediction.loop_mm == pytest.approx(0.115, abs=0.03)  # half of 3.5 % of 6.5 mm


def test_a_frame_has_predicted_signals_and_differences_that_a_layout_may_show(prediction, ring):
    model = LiveModel(lambda: ring, prediction=prediction)
    frame = model.frame(400)
    assert frame.predicted[0].shape == (frame.columns["time_s"].size, 2)
    away = frame.columns["s1_mv"] - frame.predicted[0][:, 0]
    assert np.array_equal(frame.columns["s1_difference_mv"], away, equal_nan=True)
    assert [axes.left for axes in model.plots()] == [("s1_mv",), ("s2_mv",), ("pressure_kpa",)]  # hidden until chosen
    shown = Layout(rows=(("s1_mv",), ("s1_difference_mv",)))
    model.layout = lambda: shown
    assert ("s1_difference_mv",) in [axes.left for axes in model.plots()]
    assert model.title("s1_difference_mv") == "Sensor 1 less predicted"


def test_without_identification_nothing_is_predicted(ring):
    model = LiveModel(lambda: ring)
    assert model.frame(400).predicted is None
    assert model.disagreement() == "none"
    assert model.differences() == []


def test_what_disagrees_is_reported_once_it_lasts(monkeypatch, prediction, ring):
    model, now = LiveModel(lambda: ring, prediction=prediction), [0.0]
    words = iter(["none", "mechanics", "none", *["mechanics"] * 20, *["none"] * 20])
    monkeypatch.setattr(watched, "monotonic", lambda: now[0])
    monkeypatch.setattr(LiveModel, "disagreement", lambda _: next(words))
    watch, found, over = DisagreementWatch(model), [], []
    for _ in range(40):
        now[0] += 0.6
        found.append(watch.follow(connected=True))
        over.append(watch.over)
    assert over.index(False) == found.index(watched.TEXTS["mechanics"]) and over[-1]  # its message leaves then
    assert [one[0] for one in found if one] == [watched.TEXTS["mechanics"][0]]
    assert watch.follow(connected=False) is None
