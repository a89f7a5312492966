"""The shadow of the moment: state, stability, nominal curve."""

from __future__ import annotations

from copy import copy

import numpy as np
import pytest

from analysis.shadow.model.table import default_unstable
from boat_daq.formatting import number
from boat_daq.viewmodels.live import shadow_live
from boat_daq.viewmodels.live.live_model import LiveModel
from boat_daq.viewmodels.live.shadow_live import COLOUR_LEVELS, Moment, ShadowLive
from boat_daq.workflows.jobs import JobRunner
from boat_daq.workflows.live_conversion import LiveElongation
from protocol.simulator.plant import Body
from protocol.simulator.specimens import find_specimen
from tests.boat_daq.gui.recorded_session import connected, filled_ring
from tests.boat_daq.viewmodels.helpers import MV_PER_MM, Straight


@pytest.fixture(scope="module")
def ring():
    """Two hundred seconds of signals."""
    return filled_ring(200.0)


def pane_on(ring, model, inverse):
    pane = ShadowLive(LiveModel(lambda: ring, inverse=inverse), JobRunner())
    pane.model = model
    return pane


def test_state_is_at_the_measured_elongation(ring, model):
    """The drawn tip is at the rest length plus the measured elongation; both halves are there; colours are in range."""
    pane = pane_on(ring, model, Straight())
    now = pane.now()
    pressure, measured, expanded = now.pressure, now.measured, now.expanded
    picture = pane.picture()
    assert picture.corners[..., 1].max() == pytest.approx(75.0 + measured, abs=1e-4)  # the reduced model's own error
    assert picture.corners[..., 0].min() == pytest.approx(-picture.corners[..., 0].max())
    assert picture.levels.min() >= 0
    assert picture.levels.max() < COLOUR_LEVELS
    assert picture.tracked.shape == (14, 2)
    assert expanded == pytest.approx(0.3)
    nominal = float(model.table.nominal_elongation(np.array(pressure))[0])
    lines = {name: value for name, value, _ in pane.lines()}
    assert lines["Model"].startswith(f"{number(nominal, 2, sign=True)} \u00b1")
    assert lines["Measured"] == f"{number(measured, 2, sign=True)} \u00b10.30 mm"


def test_nominal_actuator_is_drawn_without_a_calibration(ring, model):
    """Nothing is claimed to be measured."""
    pane = pane_on(ring, model, None)
    picture = pane.picture()
    assert np.isnan(picture.measured_mm)
    assert pane.lines()[0][1] == "no calibration: model shown"
    assert picture.corners[..., 1].max() == pytest.approx(75.0 + picture.nominal_mm, abs=0.02)


def test_calibration_that_is_loading_is_not_missing(ring, model):
    pane = pane_on(ring, model, None)
    pane._live.loading = True
    assert pane.lines()[0][1] == "loading the calibration \u2026"


def test_state_outside_the_table_is_reported(ring, model):
    """No full solution is made in a frame; the pane reports that it cannot show this."""

    def absurd(signal_mv):
        n = len(signal_mv)
        return LiveElongation(np.full(n, 40.0), np.full(n, 0.3), np.zeros(n, bool))

    pane = pane_on(ring, model, absurd)
    assert pane.picture().corners.size == 0
    name, text, level = pane.lines()[-1]
    assert (name, level) == ("Model", "warning")
    assert text.startswith("\u25b2 not drawn: outside the reduced model (\u221241.5 .. 55.0 kPa")


def test_last_state_is_drawn_just_beyond_the_table(ring, model):
    """Between the table's -41.5 kPa and the -42 kPa that the interlock allows; farther out nothing is drawn."""
    pane = pane_on(ring, model, None)
    pane.now = lambda: Moment(-41.8, -2.8, 0.3, True)
    assert pane.picture().corners[..., 1].max() == pytest.approx(75.0 - 2.8, abs=0.01)
    assert pane.lines()[-1] == ("Model", "\u25b2 drawn at \u221241.5 kPa, the model's last state", "warning")
    pane.now = lambda: Moment(-43.0, -2.8, 0.3, True)
    assert pane.picture().corners.size == 0


def test_nan_from_the_calibration_is_reported(ring, model):
    """Outside the calibration the nominal actuator is drawn with the reason; disagreeing sensors are reported."""

    def nowhere(signal_mv):
        n = len(signal_mv)
        return LiveElongation(np.full(n, np.nan), np.full(n, np.nan), np.ones(n, bool))

    pane = pane_on(ring, model, nowhere)
    picture = pane.picture()
    assert pane.lines()[0] == ("Measured", "\u25b2 outside the calibration", "warning")
    assert ("Sensors", "\u25b2 contradict each other", "warning") in pane.lines()
    assert picture.corners.size > 0
    assert np.isnan(picture.measured_mm)


def lines_of(pane):
    """The names and texts under the picture."""
    return {name: words for name, words, _ in pane.lines()}


@pytest.mark.parametrize(
    ("pressure", "elongation", "warned"), [(-41.0, 2.5, True), (-41.0, -1.7, False), (-19.9, 3.0, False)]
)
def test_unstable_held_state_is_reported(ring, model, pressure, elongation, warned):
    """At -41 kPa an elongated tip would buckle if it could, a shortened one would not; with little vacuum, none."""
    pane = pane_on(ring, model, None)
    pane.now = lambda: Moment(pressure, elongation, 0.3, True)
    pane._unstable = default_unstable()
    assert ("Stability" in lines_of(pane)) is warned


def test_model_is_loaded_once_it_is_wanted_and_nothing_compiles(ring, monkeypatch):
    """A job that compiles is not joined by a thread that compiles the same: it would hold the interpreter."""
    pane, loaded = pane_on(ring, None, None), []
    running = {"compiled code": object()}
    monkeypatch.setattr(pane._jobs, "get", running.get)
    monkeypatch.setattr(pane._loading, "call", loaded.append)
    pane.poll()
    pane.prepare()
    pane.poll()
    assert lines_of(pane)["Model"] == "preparing \u2026"
    assert shadow_live._load not in loaded
    running.clear()
    pane.poll()
    pane.poll()
    assert loaded[-1:] == [shadow_live._load]


def test_a_far_reading_is_known_while_code_compiles(ring, model, monkeypatch):
    """On a first start a run begins before the compiling has ended, and any reading was taken unasked."""
    pane = pane_on(ring, None, None)
    monkeypatch.setattr(pane._jobs, "get", lambda name: object())
    assert pane.nominal_at(40.0) is None
    pane.prepare()
    for pending in list(pane._loading.pending):
        pending.result(timeout=10.0)
    pane.poll()
    assert (pane.model, pane.nominal_at(40.0)) == (None, pane_on(ring, model, None).nominal_at(40.0))


def test_picture_is_drawn_again_with_another_table(ring, model):
    """Nothing else has changed: the picture of the table before was kept."""
    pane = pane_on(ring, model, Straight())
    before = pane.picture()
    assert pane.picture() is before
    pane.model = copy(model)
    assert pane.picture() is not before


def test_trace_pairs_pressure_and_elongation(ring, model):
    """Pressure and elongation of the last minute are means of the same samples, so that they lie on the curve."""
    pressure, mm = pane_on(ring, model, Straight()).trace()
    assert 600 < pressure.size <= 1300
    assert np.abs(mm - (46.4 * pressure * 0.072 - 2.7 * (pressure * 0.072) ** 2) / MV_PER_MM).max() < 0.15


def test_outline_is_drawn_before_the_model_is_ready(ring):
    """The pane never waits."""
    picture = pane_on(ring, None, Straight()).picture()
    assert picture.corners.size == 0
    assert picture.rest.shape == (4, 2)


def test_nominal_curve_rises_inside_its_band(model, ring):
    """Elongation grows with pressure, and the curve lies in its band."""
    pressure, mm, low, high = pane_on(ring, model, None).nominal_curve()
    assert pressure.size > 50
    assert np.all(np.diff(mm) > 0)
    assert np.all((low <= mm) & (mm <= high))


def test_readouts_and_shadow_show_one_pressure(ring, model):
    """Live showed -9.5 kPa beside the shadow's -9.7 during a ramp: their means were over different times."""
    pane = pane_on(ring, model, Straight())
    head = pane._live.headline(connected())
    shown = {name: value for name, value, _ in pane.lines()}
    assert shown["Pressure"] == f"{head.pressure} kPa"
    assert shown["Measured"].startswith(f"{head.elongation} \u00b1")


@pytest.mark.parametrize("unit", ["SA1", "SA2", "SA3"])
def test_healthy_specimen_is_inside_the_band_at_every_plateau(ring, model, unit):
    """Its loop is no fault: at rest it was called outside the band of the elastic model."""
    cycle = np.concatenate([np.arange(50.0, -41.0, -5.0), np.arange(-35.0, 51.0, 5.0)])
    pane, wrong = pane_on(ring, model, None), []
    for pressure, mm in zip(cycle, Body(find_specimen(unit).actuator).advance(cycle), strict=True):
        pane.now = lambda p=pressure, x=mm: Moment(p, x, 0.05, True)
        marks = [mark for _, mark, _ in pane.lines()]
        wrong += [] if "\u25cf inside the band" in marks else [(pressure, mm)]
    assert wrong == []
