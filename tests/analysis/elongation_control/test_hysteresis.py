"""The identified hysteresis against the virtual board's own operator, and its inverse against itself."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.elongation_control.hysteresis import identify
from protocol.base.errors import DataError
from protocol.simulator.specimens import find_specimen
from tests.analysis.twin_unit import identified, swings


@pytest.mark.parametrize("specimen", ["SA1", "SA3"])
def test_identification_finds_weights_and_envelopes(specimen):
    model, truth = identified(specimen)[0], find_specimen(specimen).actuator.hysteresis
    assert model.rms_mm < 0.02  # creep is left: 0.7 % of the elongation
    assert model.weights.sum() == pytest.approx(sum(truth.weights), rel=0.02)
    assert model.up_curvature == pytest.approx(truth.up_curvature, abs=1.5e-4)
    assert model.down_curvature == pytest.approx(truth.down_curvature, abs=1.5e-4)


def test_noise_of_sensor_and_gauge_leaves_the_model_unbiased():
    pressure_kpa, x, _ = swings("SA1")
    generator = np.random.default_rng(0)
    noisy = identify(pressure_kpa + generator.normal(0, 0.04, x.size), x + generator.normal(0, 0.03, x.size))
    clean = identified("SA1")[0]
    assert np.abs(noisy.series(pressure_kpa) - clean.series(pressure_kpa))[1000:].max() < 0.03


def test_inverse_gives_the_elongation_back_from_any_memory():
    model = identified("SA1")[0]
    memory, wanted = model.rest(0.0, 0.0), np.random.default_rng(1).uniform(-2.5, 3.5, 200)
    for mm in wanted:
        memory = model.after(memory, model.pressure(memory, mm))
        assert model.elongation(memory) == pytest.approx(mm, abs=1e-9)


def test_rest_reproduces_the_elongation_of_a_unit_with_unknown_history():
    model = identified("SA1")[0]
    assert model.elongation(model.rest(10.0, 0.75)) == pytest.approx(0.75, abs=1e-9)
    assert model.elongation(model.rest(10.0, 3.0)) < 3.0  # no history leads there: the integrator takes the rest


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda p, x: (p[:30], x[:30]), "only 30 points"),
        (lambda p, x: (p / 10, x), "spans 9 kPa"),
        (lambda p, x: (p, np.random.default_rng(2).permutation(x)), "does not follow pressure"),
    ],
)
def test_a_run_that_shows_no_hysteresis_is_refused(change, cause):
    pressure_kpa, x, _ = swings("SA1")
    with pytest.raises(DataError, match=cause):
        identify(*change(pressure_kpa[::20], x[::20]))
