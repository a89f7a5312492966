"""The light of an actuator over elongation: refined where it jumps, kept, continued after a stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.signal_prediction import light_table
from analysis.signal_prediction.light_table import (
    LOSSES_DB_PER_CM,
    GuideShapes,
    build_light,
    light_csv,
    light_of,
    stored_light,
)
from protocol.base.errors import RequestError

OTHER = replace(ActuatorParameters(), wall_mm=2.4)
COARSE = replace(ActuatorParameters(), axial_elements=2, wall_elements=1, lattice_elements=1)


class Shapes:
    """In place of the guides of an actuator: the light itself is given."""

    range_mm = (-2.0, 3.0)

    def __init__(self, actuator=OTHER) -> None:
        pass


def stepped(_shapes, x, loss, face="outer", rays=0):
    """Return light that falls, with a step of a tenth within 0.01 mm at 1.5038 mm."""
    traced.append(len(x))
    light = 30.0 - x - np.clip((x - 1.5038) / 0.01, 0.0, 1.0)
    return light * 10.0 ** (-0.3 * loss)


traced: list[int] = []


@pytest.fixture(autouse=True)
def given_light(monkeypatch):
    traced.clear()
    monkeypatch.setattr(light_table, "traced_light", stepped)
    monkeypatch.setattr(light_table, "GuideShapes", Shapes)


def test_light_is_within_a_thousandth_of_its_range_beside_a_step_too():
    table = build_light(Shapes())
    x = np.random.default_rng(0).uniform(-2.0, 3.0, 2000)
    for loss in LOSSES_DB_PER_CM:
        away = table.light(x, loss) - stepped(None, x, loss)
        assert np.abs(away).max() < 1e-3 * 6.0
    assert 209 < len(table.elongation_mm) < 520


def test_a_difference_of_few_rays_is_not_refined(monkeypatch):
    level = np.random.default_rng(0)
    monkeypatch.setattr(light_table, "traced_light", lambda _s, x, *_: 30.0 + level.uniform(-2e-3, 2e-3, len(x)))
    assert len(build_light(Shapes()).elongation_mm) == 4 * 105 - 3


def test_a_table_is_traced_once_and_continued_where_it_was_stopped(tmp_path):
    def stop(done, total):
        assert done < total
        if done > 60:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        light_of(OTHER, progress=stop, folder=tmp_path)
    stopped = sum(traced)
    table = light_of(OTHER, folder=tmp_path)
    whole = sum(traced)
    traced.clear()
    build_light(Shapes())
    assert whole == sum(traced)  # nothing twice
    assert 0 < stopped < whole
    traced.clear()
    again = light_of(OTHER, build=False, folder=tmp_path)
    assert not traced
    assert np.array_equal(again.light_percent, table.light_percent)
    assert [path.suffix for path in tmp_path.iterdir()] == [".npz"]


def test_the_default_actuator_needs_no_trace_and_another_face_does(tmp_path):
    assert light_of(ActuatorParameters(), folder=tmp_path) is stored_light()
    assert light_of(ActuatorParameters(), "inner", build=False, folder=tmp_path) is None
    assert not traced


def test_the_csv_is_read_as_it_was_written(tmp_path, monkeypatch):
    (tmp_path / "light.csv").write_text(light_csv(table := build_light(Shapes())), encoding="utf-8")
    monkeypatch.setattr(light_table.resources, "files", lambda _: tmp_path)
    read = stored_light.__wrapped__()
    assert np.allclose(read.light_percent, table.light_percent, rtol=1e-6)
    assert np.allclose(read.elongation_mm, table.elongation_mm, atol=1e-6)


def test_guides_of_a_state_lie_between_those_solved_and_a_weak_actuator_is_refused():
    shapes = GuideShapes(COARSE, 5)
    low, high = shapes.range_mm
    guides = shapes.at(np.array([low, 0.5 * (low + high), high]))
    assert guides.shape == (3, 2, 7, 2)
    bow = np.ptp(guides[..., 0], axis=(1, 2))
    assert bow[0] != pytest.approx(bow[1], rel=1e-4)
    with pytest.raises(RequestError, match=r"critical|buckl"):
        GuideShapes(replace(COARSE, wall_modulus_kpa=100.0), 5)
