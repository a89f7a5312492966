"""The shadow's page: alarms as what, since when, how sure; cycles drawn; skipped cycles reported."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtCore import QPointF
from PySide6.QtGui import QColor

from analysis.shadow.monitoring.monitor import Alarm, CycleFigures
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.gui import style
from boat_daq.gui.plotting.shadow_pane import ShadowView
from boat_daq.viewmodels.live.shadow_live import CycleMark, ShadowPicture
from protocol.base.errors import DataError
from tests.boat_daq.gui.models.test_tradeoff_page import app_model  # noqa: F401 - a fixture
from tests.conftest import mostly_at_night


def mark(cycle, deviation=0.04, loss=-130.0):
    return CycleMark(cycle, 20.0 * cycle, deviation, CycleFigures(loss, np.nan, 1.02, 0.03, 0.0, np.nan))


@pytest.fixture
def page(qtbot, app_model):  # noqa: F811 - the fixture above
    """The page on a monitor that has seen a leak."""
    from boat_daq.gui.models.shadow_page import ShadowPage

    app_model.shadow.prepare = lambda: None
    shown = ShadowPage(app_model.shadow, app_model.monitor, app_model.services)
    qtbot.addWidget(shown)
    app_model.monitor.marks = [mark(c, loss=-130.0 + 2.0 * (c > 9)) for c in range(1, 13)]
    app_model.monitor.alarms = [Alarm("drift", "offset", "mm", -0.02, 10, 12, 2500.0, ("leak",))]
    app_model.monitor.revision += 1
    shown.show()
    shown.refresh(app_model.snapshot)
    return shown


def test_alarm_row_has_cause_time_and_probability(page):
    """One row: the illness, the first cycle of the change with its time, when it was found, how rare it is."""
    cells = [page.alarms.item(0, k).text() for k in range(page.alarms.columnCount())]
    assert cells == [
        "\u25b2 Drift", "cycle 10, 3:20", "cycle 12, 2 later", "2\u2009500 cycles",
        "offset \u22120.02 mm, may follow from leak",
    ]  # fmt: skip
    assert page.verdict.text() == "1 alarm in 12 cycles"
    assert page.cycles.alarms.x.tolist() == [12.0]


def test_nominal_curve_is_drawn_with_its_band(page, app_model):  # noqa: F811 - the fixture above
    """Once the table is loaded, before the model is, with the error of the table; it was given as nan."""
    shadow, pressure = app_model.shadow, np.linspace(-40.0, 50.0, 5)
    assert page.nominal.readout.text() == "preparing the shadow \u2026"
    shadow._table = SimpleNamespace(errors_mm=np.array([8e-5]))
    shadow.nominal_curve = lambda: (pressure, 0.08 * pressure, 0.08 * pressure - 1.0, 0.08 * pressure + 1.0)
    page.nominal.show_model(shadow)
    assert page.nominal.nominal.y[-1] == pytest.approx(4.0)
    assert page.nominal.band.y[-1] == pytest.approx(5.0)
    assert page.nominal.readout.text().endswith("numerical error 0.08 \u00b5m")


def test_each_figure_of_the_cycles_can_be_drawn(page):
    """The leak is drawn as its change from the first cycles; a figure that is NaN throughout draws nothing."""
    page.cycles.figure.setCurrentIndex(page.cycles.figure.findData("loss"))
    page.cycles.show_cycles()
    assert page.cycles.points.y.tolist() == [0.0] * 9 + [2.0] * 3
    assert page.cycles.plot.unit == "%/min"
    page.monitor.marks = [CycleMark(1, 0.0, np.nan, mark(1).figures)]
    page.cycles.figure.setCurrentIndex(page.cycles.figure.findData("deviation"))
    page.cycles.show_cycles()
    assert page.cycles.points.x.size == 0
    assert "once it is complete" in page.cycles.empty_text.text()  # no calibration is lacking
    snapshot = SessionSnapshot(SessionState.IDLE, LinkState.UP)
    page.refresh(snapshot)
    assert "Accept a calibration" in page.cycles.empty_text.text()
    page.model._live.inverse = lambda columns: None
    page.refresh(snapshot)
    assert "once it is complete" in page.cycles.empty_text.text()


def test_absence_of_alarms_is_reported(page, app_model):  # noqa: F811 - the fixture above
    """A healthy run is reported as such, with the rate of false alarms that is allowed."""
    doubtful = Alarm("drift", "offset", "mm", -0.02, 10, 12, 2500.0, (), independent=False)
    page.monitor.alarms = [doubtful]
    assert page.monitor.rows()[0][3] == "2\u2009500 cycles or fewer"
    page.monitor.alarms = []
    page.monitor.revision += 1
    page.refresh(app_model.snapshot)
    healthy, rate = "\u25cf none in 12 cycles", "expected false alarms: 1 per 1\u2009000 healthy cycles"
    assert page.verdict.text() == f"{healthy}; too few cycles yet to detect a leak or softening; {rate}"
    assert not page.alarms.isVisible()


def test_cycle_without_figures_is_reported_and_skipped(page, app_model):  # noqa: F811 - the fixture above
    """Its error comes to the strip; the window continues; an alarm found with it is shown at the next refresh."""

    class Done:
        def __init__(self, outcome):
            self.outcome = outcome

        def done(self):
            return True

        def result(self):
            if isinstance(self.outcome, Exception):
                raise self.outcome
            return self.outcome

    alarm = Alarm("leak", "loss", "%/min", 2.0, 13, 13, 9000.0)
    bad = DataError("no elongation is known in this cycle", "check the calibration's range")
    page.monitor._reported = len(page.monitor.alarms)
    page.monitor._reducing.pending = [Done((mark(13), [alarm], {})), Done(bad), Done((mark(15), [], {}))]
    app_model.tick()
    assert app_model.notices.current().cause == "no elongation is known in this cycle"
    app_model.tick()
    assert any("leak since cycle 13" in notice.cause for notice in app_model.notices.history)
    assert [m.cycle for m in page.monitor.marks][-2:] == [13, 15]


@pytest.mark.parametrize("suffix", ["png", "svg", "csv"])
def test_the_picture_of_the_shadow_is_saved(page, tmp_path, suffix):
    """PNG and SVG hold the picture, CSV the guides and the tracked points."""
    path = tmp_path / f"shadow.{suffix}"
    page.pane.save(path)
    start = {"png": b"\x89PNG", "svg": b"<?xml", "csv": b'"outline at rest, x (mm)"'}[suffix]
    assert path.read_bytes().startswith(start)


def test_pane_follows_the_menu_commands(page, app_model):  # noqa: F811 - the fixture above
    """The colour is the model's: both panes follow, scale and all."""
    page.model.quantity = "strain"
    page.refresh(app_model.snapshot)
    assert page.pane.quantity.currentData() == "strain"
    assert page.pane.view.scale_texts == ("0", "strain", "20 % or more")


@pytest.mark.parametrize("theme", mostly_at_night(style.DARK, style.LIGHT))
def test_legend_of_the_shadow_is_in_the_picture(live, theme):
    """Each mark is drawn in its colour above the scale, once the actuator is drawn: before, they explain nothing."""
    live.set_theme(theme)
    view = live.live.shadow.view
    view.resize(260, 420)
    empty = live.model.shadow.picture()
    element = np.array([[[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]]])
    drawn = replace(empty, corners=element, levels=np.zeros(1, np.int64))
    always = {theme.target, theme.muted, theme.text}
    for picture, marks in (
        (empty, set()),
        (replace(drawn, measured_mm=np.nan), always),
        (replace(drawn, measured_mm=1.0), {theme.elongation, *always}),
    ):
        view.show_picture(picture)
        image = view.grab().toImage()
        top = image.height() - style.CONTROL_HEIGHT - 2 * 16
        shown = {image.pixelColor(x, y).name() for x in range(image.width()) for y in range(top, image.height())}
        assert marks <= shown
        assert bool(marks) or shown == {theme.surface}
        assert (theme.elongation in shown) is (theme.elongation in marks)  # nothing measured, nothing named


def test_guides_end_at_the_base_and_at_the_tip(qtbot):
    """Their end pieces are in the holders: drawn, they crossed the base line unexplained."""
    view = ShadowView()
    qtbot.addWidget(view)
    view.resize(300, 500)
    view.paint_theme(style.LIGHT)
    guide = np.array([[10.0, -12.0], [10.0, 88.0]])
    box = np.array([[-28.0, 0.0], [28.0, 0.0], [28.0, 76.0], [-28.0, 76.0]])
    ends = np.array([[10.0, -8.0], [10.0, 84.0]])  # tracked points in the holders: drawn, they floated in the air
    view.show_picture(ShadowPicture(box, box[None], np.zeros(1, np.int64), guide[None], ends, math.nan, 1.0))
    view.show()
    image, place = view.grab().toImage(), view._transform()

    def dark(z):
        at = place.map(QPointF(10.0, z)).toPoint()
        return any(image.pixelColor(at.x() + dx, at.y()) == QColor(style.LIGHT.text) for dx in (-1, 0, 1))

    assert [dark(z) for z in (-8.0, -3.0, 20.0, 60.0, 82.0)] == [False, False, True, True, False]
