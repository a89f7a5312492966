"""The trade-off page: the chart drawn, the marks, the maps, the fidelity; what is saved and remembered."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PySide6.QtCore import QPointF, QRect, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QApplication

from analysis.fidelity import fidelity
from analysis.studies.tradeoff.references import load
from boat_daq.gui import style
from boat_daq.gui.models import tradeoff_jobs
from boat_daq.gui.models.tradeoff_chart import spread_bars
from boat_daq.gui.plotting.axes import LogAxis, log_ticks
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.models import tradeoff
from boat_daq.viewmodels.models.tradeoff import OVERVIEW, read_report
from boat_daq.workflows.jobs import JobState
from tests.boat_daq.gui.recorded_session import RecordedSession, idle
from tests.boat_daq.viewmodels.models.reports import point, report


@pytest.fixture
def app_model(qtbot, tmp_path):
    """A model on a session that only shows."""
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.gui.app import make_application
    from boat_daq.viewmodels.app_model import AppModel

    make_application()
    made = AppModel(RecordedSession(idle()), tmp_path / "config", tmp_path / "rec", UnitLibrary(tmp_path / "units"))
    yield made
    made.close()


@pytest.fixture
def page(qtbot, app_model):
    """The page, shown, with one method measured."""
    from boat_daq.gui.models.tradeoff_page import TradeoffPage

    shown = TradeoffPage(app_model.tradeoff, app_model.atlas, app_model.precision, app_model.services)
    qtbot.addWidget(shown)
    shown.resize(1100, 700)
    app_model.tradeoff.take(report())
    app_model.tradeoff.show("inverse")
    shown.show()
    shown.refresh(app_model.snapshot)
    return shown


def test_chart_draws_the_measured_points(page):
    """Points at the logarithms of time and error; the default's ring on its point; the front in steps; lines."""
    card = page.chart
    assert np.allclose(card.settings.x, [0.0, math.log10(2.0)])
    assert np.allclose(card.settings.y, [-1.0, -3.0])
    assert (card.default.x.tolist(), card.default.y.tolist()) == ([math.log10(2.0)], [-3.0])
    assert np.allclose(card.front.x, [0.0, math.log10(2.0), math.log10(2.0)])
    assert np.allclose(card.front.y, [-1.0, -1.0, -3.0])
    assert card.notices.value() == pytest.approx(math.log10(0.02))
    assert card.sufficient.value() == pytest.approx(-2.0)
    assert card.numbers.texts == ["1", "2"]
    titles = [axis.label.toPlainText() for axis in (card.plot.left, card.plot.bottom)]
    assert ["(mm)" in titles[0], "(s)" in titles[1]] == [True, True], titles
    assert "at most half the tolerance: the default, fine." in page.explanation.text()
    assert page.table.item(1, 1).text() == "fine"
    assert page.table.item(1, 4).text() == "\u25cb \u25a1"


def test_the_spread_of_the_repeats_is_drawn_about_each_point():
    """Half to either side, as a cross; a spread wider than the value ends a decade below it."""
    chart = read_report(report(points=[point("wide", 1.0, 0.1, cpu_spread=4.0, error_spread=0.1)]))["inverse"]
    x, y = spread_bars(chart.points, chart.floor)
    assert np.allclose(10 ** x[:2], [0.1, 3.0])
    assert np.allclose(10 ** y[3:5], [0.05, 0.15])
    assert np.isnan(x[[2, 5]]).all()


@pytest.mark.parametrize("suffix", ["png", "svg", "csv"])
def test_the_chart_is_saved(page, tmp_path, suffix):
    """PNG and SVG hold a picture, CSV the settings with their units."""
    path = tmp_path / f"chart.{suffix}"
    page.chart.save(path)
    content = path.read_bytes()
    start = {"png": b"\x89PNG", "svg": b"<?xml", "csv": b"setting,processor time (s)"}[suffix]
    assert content.startswith(start)
    assert suffix != "csv" or b"fine,2.0,0.0,0.001" in content


def test_a_job_without_a_map_names_those_of_its_methods(page, app_model):
    """The button is grey, and the text refers to the tracer's map."""
    for shown, allowed in (("sweep", False), ("tracer", True)):
        app_model.tradeoff.show(shown)
        page.refresh(app_model.snapshot)
        page.refresh(app_model.snapshot)
        assert page.atlas.sweep.isEnabled() is allowed
        assert ("see \u201cRay tracer\u201d" in page.atlas.words.text()) is not allowed


def test_map_shows_outcomes_by_colour_hatching_and_letter(page, app_model):
    """A place that works has the plain ground, a refused one is hatched; its tooltip shows the message."""
    axis = {"name": "noise", "unit": "mV", "values": [1.0, 2.0], "labels": []}
    cells = [
        [{"outcome": "works", "error": 0.0, "said": ""}, {"outcome": "refused", "error": None, "said": "too much"}]
    ]
    app_model.atlas.take(
        {"maps": [{
            "name": "m", "method": "inverse", "title": "A map", "truth": "t", "unit": "mm", "tolerance": 0.1,
            "x": axis, "y": axis | {"values": [0.0]}, "cells": cells,
        }]}
    )  # fmt: skip
    page.refresh(app_model.snapshot)
    card = page.atlas
    item, cells = card.items[0]
    centre = [item.getViewBox().mapViewToScene(QPointF(x, 0.5)) for x in (0.5, 1.5)]
    card._look(centre[1])
    assert card.words.text().endswith("refuses: too much")
    image = card.view.grab().toImage()
    ground = {name: QColor(pair[0]) for name, pair in style.outcome_colours(cells.theme).items()}
    inks = [set() for _ in range(2)]
    for seen, at in zip(inks, (card.view.mapFromScene(c) for c in centre), strict=True):
        seen.update(image.pixelColor(at.x() + i, at.y() + k).name() for i in range(-9, 10) for k in range(-9, 10))
    assert inks[0] == {ground["works"].name()}
    assert ground["refused"].name() in inks[1]
    assert len(inks[1]) > 2
    assert card.columns()["message"] == ["", "too much"]


def test_method_without_a_chart_shows_its_map_alone(page, app_model):
    """Nothing empty is above the maps."""
    app_model.tradeoff.show("fit")
    page.refresh(app_model.snapshot)
    assert not page.upper.isVisible()
    assert page.atlas.readout.text() == "not mapped yet"


def test_fidelity_is_applied_and_kept(page, app_model):
    """Draft and reference move rays, table, sampler and live points; the choice is there at the next start."""
    draft, reference = fidelity("draft"), fidelity("reference")
    assert draft.rays < reference.rays
    page.level.setCurrentIndex(page.level.findData("draft"))
    page.level.activated.emit(page.level.currentIndex())
    assert (app_model.live.points_a_column, app_model.optics.traced_rays, app_model.calibration.fidelity) == (
        draft.points_a_column, draft.rays, draft,
    )  # fmt: skip
    app_model.precision.choose("reference")
    assert app_model.runs.fidelity.level == app_model.calibration.fidelity.level == "reference"
    page.refresh(app_model.snapshot)
    assert page.level.currentData() == "reference"
    assert app_model.optics.swept_rays == reference.ranking_rays
    assert Preferences(app_model.folder).get("fidelity") == "reference"
    app_model.preferences.set("fidelity", "nonsense")
    assert app_model.precision.level == "normal"


@pytest.mark.parametrize(("low", "high", "labels"), [(-1.2, 0.1, ["0.1", "0.2", "0.5", "1"]), (-14.0, 0.0, 8)])
def test_a_logarithmic_axis_has_round_labels(qtbot, low, high, labels):
    """1-2-5 over little more than a decade; over many, whole powers of ten and not too many."""
    ticks = log_ticks(low, high)
    found = LogAxis("left").tickStrings(ticks, 1.0, 1.0)
    assert found == labels if isinstance(labels, list) else len(found) <= labels
    assert all(low <= t <= high for t in ticks)


def test_narrow_page_puts_the_table_below_the_chart(page, qtbot):
    """Beside each other where the width allows it, otherwise over each other, each with its own height."""
    from boat_daq.gui.widgets.layouts import PageScroll

    scroll = PageScroll()
    qtbot.addWidget(scroll)
    scroll.setWidget(page)
    scroll.resize(1100, 700)
    scroll.show()
    qtbot.waitExposed(scroll)
    assert page.chart.y() == page.table_card.y()
    scroll.resize(868, 420)
    qtbot.waitUntil(lambda: page.chart.height() >= style.STACKED_HEIGHT)
    assert page.table_card.y() >= page.chart.y() + page.chart.height()
    qtbot.waitUntil(lambda: page.height() >= page.minimumSizeHint().height() > 420)
    scroll.takeWidget()


def test_measurement_of_this_computer_starts_reports_progress_and_is_cancelled(page, app_model, monkeypatch):
    """The button starts and cancels, the bar follows, the result replaces the one that was shown."""

    class FakeJob:
        label, state, fraction, failure, permille = "Measuring", JobState.RUNNING, 0.4, None, 400

        def __init__(self, label, function):
            assert function is tradeoff_jobs.measure_methods

        def poll(self):
            return self.state

        def cancel(self):
            self.state = JobState.CANCELLED

    monkeypatch.setattr(tradeoff, "Job", FakeJob)
    page.start.click()
    page.refresh(app_model.snapshot)
    assert (page.start.text(), page.progress.value()) == ("Cancel", 400)
    job = app_model.tradeoff.job
    job.state, job.result = JobState.DONE, report("tracer")
    app_model.jobs.poll()
    page.refresh(app_model.snapshot)
    assert page.start.text() == "Measure this computer"
    assert set(app_model.tradeoff.charts) == {"tracer"}
    assert page.measured.text().startswith("Measured on this computer")
    page.start.click()
    page.start.click()
    app_model.jobs.poll()
    assert app_model.tradeoff.job is None


def shown_at(page, app_model, name, width):
    """Show a method of the shipped measurement at a width of the page."""
    app_model.tradeoff.take(load("measured"))
    page.resize(width, 680)
    app_model.tradeoff.show(name)
    page.refresh(app_model.snapshot)


@pytest.mark.parametrize("name", tradeoff.METHOD_NAMES)
def test_default_of_every_method_has_its_ring_in_sight(page, app_model, name):
    """On the shipped measurement."""
    shown_at(page, app_model, name, 1156)
    card = page.chart
    (low_x, high_x), (low_y, high_y) = card.plot.item.getViewBox().viewRange()
    ((x, y),) = zip(card.default.x, card.default.y, strict=True)
    assert low_x < x < high_x
    assert low_y < y < high_y


def test_overview_shows_each_default_and_leads_to_its_method(page, app_model):
    """Error in percent of what is noticeable; a click on a point or a row, and Enter, show the method."""
    shown_at(page, app_model, OVERVIEW, 1156)
    card, table = page.overview, page.defaults
    assert page.all.isVisible()
    assert not page.one.isVisible()
    assert table.rowCount() == len(tradeoff.METHOD_NAMES)
    row = list(tradeoff.METHOD_NAMES).index("tracer")
    assert [table.item(row, k).text() for k in (0, 2, 5)] == ["1", "250 rays", "31 %"]
    assert card.columns()["default"][row] == "250 rays"
    QApplication.processEvents()
    place = card.plot.item.getViewBox().mapViewToScene(QPointF(*card._at["tracking"]))
    card.click(place + QPointF(3, 2))
    assert app_model.tradeoff.shown == "tracking"
    page.refresh(app_model.snapshot)
    assert page.one.isVisible()
    assert page.methods.currentItem().text().startswith("Camera")
    page.methods.setCurrentRow(0)
    assert app_model.tradeoff.shown == OVERVIEW
    table.cellActivated.emit(row, 0)
    assert app_model.tradeoff.shown == "tracer"


@pytest.mark.parametrize("width", [1156, 740])
def test_names_of_settings_are_wrapped_not_cut(page, app_model, width):
    """A row is as high as the lines of its name."""
    shown_at(page, app_model, "reduced-fem", width)
    table = page.table
    QApplication.processEvents()
    for row in range(table.rowCount()):
        needed = table.fontMetrics().boundingRect(
            QRect(0, 0, table.columnWidth(1) - 8, 1000), Qt.TextFlag.TextWordWrap, table.item(row, 1).text()
        )
        assert needed.width() <= table.columnWidth(1)
        assert needed.height() <= table.rowHeight(row)
