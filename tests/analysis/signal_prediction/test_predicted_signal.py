"""The chain's forward model: the fit gives its parameters back, and what disagrees is named."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.data.recording import Recording
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.signal_prediction.light_table import GuideShapes, stored_light, traced_light
from analysis.signal_prediction.predicted_signal import Disagreement, fit_signal_model, what_disagrees
from analysis.signal_prediction.prediction import disagreement, predict_run, predict_sensors, published_prediction
from protocol.base.errors import DataError
from tests.analysis.twin_unit import identified, swings

X = np.linspace(-2.6, 3.7, 60)
SLOPES, U = np.array([46.0, 33.0]), np.array([0.5, 0.5])


def test_fit_gives_gain_offset_and_loss_back_within_their_covariance():
    table = stored_light()
    truth = -30.0 * table.light(X, 0.4) + 2000.0
    found = fit_signal_model(X, truth + np.random.default_rng(0).normal(0, 0.5, X.size))
    sd = np.sqrt(np.diag(found.covariance))
    assert abs(found.gain_mv_per_percent + 30.0) < 4 * sd[0]
    assert abs(found.offset_mv - 2000.0) < 4 * sd[1]
    assert abs(found.loss_db_per_cm - 0.4) < 4 * sd[2]
    assert found.rms_mv == pytest.approx(0.5, rel=0.3)
    assert np.abs(found(X) - truth).max() < 1.0


def test_loss_explains_part_of_the_published_curves_and_leaves_the_rest():
    for sensor in published_prediction():
        assert sensor.before.r2 < sensor.after.r2 < 0.97
        assert 5.0 < sensor.after.rms_percent_fso < sensor.before.rms_percent_fso < 12.0
        assert sensor.after.gain_mv_per_percent < 0  # the front end inverts, or the real guides do not dim


def test_a_parabola_stands_beside_the_light_and_the_better_one_is_named():
    light, rng = stored_light(), np.random.default_rng(0)
    noise = rng.normal(0.0, 0.5, X.size)
    ours, theirs = predict_sensors([(X, 2000.0 - 30.0 * light.light(X, 0.4) + noise), (X, X - 3.0 * X**2)], cycles=3)
    assert ours.beats_parabola
    assert ours.held_out_rms_mv == pytest.approx(0.5, rel=0.5)
    assert not theirs.beats_parabola
    assert theirs.parabola.r2 == pytest.approx(1.0)
    assert theirs.parabola.held_out_rms_mv < 1e-9 < theirs.line.held_out_rms_mv
    for sensor in published_prediction():
        assert sensor.after.r2 < sensor.line.r2 < sensor.parabola.r2
        assert not sensor.beats_parabola


def test_outside_the_table_there_is_no_prediction():
    found = fit_signal_model(X, 10.0 * X + 5.0)
    assert np.isnan(found(np.array([-9.0, 9.0]))).all()
    with pytest.raises(DataError, match="only 0 readings"):
        fit_signal_model(X + 50.0, X)


@pytest.mark.parametrize(
    ("residual", "word"),
    [
        ((0.2, -0.1), Disagreement.NONE),
        ((46.0, 33.0), Disagreement.MECHANICS),
        ((30.0, 30.0), Disagreement.ELECTRONICS),
        ((30.0, 0.0), Disagreement.OPTICS),
        ((np.nan, np.nan), Disagreement.NONE),
    ],
)
def test_the_link_that_disagrees_is_named(residual, word):
    assert what_disagrees(np.array(residual), SLOPES, U, 0.05) is word


def test_signals_of_another_elongation_are_mechanics_and_of_a_lamp_electronics():
    fusion = identified("SA1")[1]
    at = [float(inverse.calibration.predict(np.array([1.0]))[0]) for inverse in fusion.inverses]
    assert disagreement(np.array(at), 1.0, 100, fusion) is Disagreement.NONE
    assert disagreement(np.array(at), 0.4, 100, fusion) is Disagreement.MECHANICS
    assert disagreement(np.array(at) + 25.0, 1.0, 100, fusion) is Disagreement.ELECTRONICS


def test_a_run_has_its_difference_as_a_column_and_agrees_where_nothing_is_wrong():
    model, fusion = identified("SA1")
    pressure_kpa, x, signals = swings("SA1")
    run = Recording.from_arrays(np.arange(x.size) / 100.0, pressure_kpa, signals, meta={"unit": "SA1"})
    sensors = predict_sensors([(x[1000::200], signals[1000::200, i]) for i in range(2)])
    found = predict_run(run, model, fusion, sensors)
    frame = found.frame
    inside = np.isfinite(frame["s1_predicted_mv"])
    assert inside.mean() > 0.95
    away = frame["s1_mv"] - frame["s1_predicted_mv"]
    assert np.allclose(frame["s1_difference_mv"][inside], away[inside])
    assert (np.abs(away[inside]) <= frame["s1_band_mv"][inside]).mean() > 0.9
    assert found.words["none"] > 95.0
    with pytest.raises(DataError, match="2 sensors, the calibration 1"):
        predict_run(run, model, fusion, sensors[:1])


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_stored_light_is_that_of_the_chain_within_a_thousandth_of_its_range():
    """Ten times the rays: with the table's own number the chance of the fan would be most of the difference."""
    shapes, table = GuideShapes(ActuatorParameters()), stored_light()
    at = np.sort(np.random.default_rng(0).uniform(*table.elongation_mm[[0, -1]], 15))
    for loss, row in zip(table.losses_db_per_cm, table.light_percent, strict=True):
        traced = traced_light(shapes, at, float(loss), rays=1_000_000)
        away = (table.light(at, loss) - traced) / np.ptp(row)
        assert np.abs(away).max() < 1e-3
