"""Speed and accuracy: the chart and the table of the defaults, the precision, the measurement."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QApplication

from analysis.fidelity import fidelity
from analysis.studies.tradeoff.references import load
from boat_daq.gui.plotting.axes import LogAxis, log_ticks
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.models import tradeoff
from boat_daq.workflows import measured_methods
from boat_daq.workflows.jobs import JobState
from tests.boat_daq.gui.recorded_session import RecordedSession, idle
from tests.boat_daq.viewmodels.models.reports import report


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

    shown = TradeoffPage(app_model.tradeoff, app_model.precision, app_model.services)
    qtbot.addWidget(shown)
    shown.resize(1100, 700)
    app_model.tradeoff.take(report(), own=True)
    shown.show()
    shown.refresh(app_model.snapshot)
    return shown


def test_fidelity_is_applied_and_kept(page, app_model):
    """Draft and reference move rays, table and sampler; the choice is there at the next start."""
    draft, reference = fidelity("draft"), fidelity("reference")
    assert draft.rays < reference.rays
    page.level.setCurrentIndex(page.level.findData("draft"))
    page.level.activated.emit(page.level.currentIndex())
    assert (app_model.optics.fidelity.rays, app_model.calibration.fidelity) == (
        draft.rays, draft,
    )  # fmt: skip
    app_model.precision.choose("reference")
    assert app_model.runs.fidelity.level == app_model.calibration.fidelity.level == "reference"
    page.refresh(app_model.snapshot)
    assert page.level.currentData() == "reference"
    assert app_model.optics.fidelity.ranking_rays == reference.ranking_rays
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


def test_measurement_of_this_computer_starts_reports_progress_and_is_cancelled(page, app_model, monkeypatch):
    """The button waits for the strip's bar and Cancel, the result replaces the one that was shown."""

    class FakeJob:
        label, state, fraction, failure, permille = "Measuring", JobState.RUNNING, 0.4, None, 400

        def __init__(self, label, function):
            assert function is measured_methods.measure_methods

        def poll(self):
            return self.state

        def cancel(self):
            self.state = JobState.CANCELLED

    monkeypatch.setattr(tradeoff, "Job", FakeJob)
    page.start.click()
    page.refresh(app_model.snapshot)
    assert not page.start.isEnabled()
    job = app_model.tradeoff.job
    job.state, job.result = JobState.DONE, report("tracer")
    app_model.jobs.poll()
    page.refresh(app_model.snapshot)
    assert (page.start.text(), page.start.isEnabled()) == ("Measure this computer", True)
    assert [d.name for d in app_model.tradeoff.defaults if d.measured] == ["tracer"]
    assert page.measured.text().startswith("This computer: ")
    page.start.click()
    app_model.tradeoff.toggle()
    app_model.jobs.poll()
    assert app_model.tradeoff.job is None


def show_shipped(page, app_model, width):
    """Show the shipped measurement at a width of the page."""
    app_model.tradeoff.take(load("measured"), own=False)
    page.resize(width, 680)
    page.refresh(app_model.snapshot)


def test_each_default_has_its_point_in_sight_and_a_row(page, app_model):
    """On the shipped measurement; error in percent of the tolerance."""
    show_shipped(page, app_model, 1156)
    card, table = page.overview, page.defaults
    (low_x, high_x), (low_y, high_y) = card.plot.item.getViewBox().viewRange()
    points = [at for layer in card.points.values() for at in zip(layer.x, layer.y, strict=True)]
    assert len(points) == table.rowCount() == len(tradeoff.METHOD_NAMES)
    assert all(low_x < x < high_x and low_y < y < high_y for x, y in points)
    texts = [text for labels in card.numbers for text in labels.texts]
    assert sorted(int(text.split()[0]) for text in texts) == list(range(1, len(points) + 1))
    shares = {d.name: d.share for d in app_model.tradeoff.defaults}
    assert sorted(10 ** (y - 2) for _, y in points) == pytest.approx(sorted(max(s, 0.01) for s in shares.values()))
    assert [text for text in texts if "<" in text] == ["6 (< 1 %)"] and shares["inverse"] < 0.01 < shares["reduced-fem"]
    row = list(tradeoff.METHOD_NAMES).index("tracer")
    assert [table.item(row, k).text() for k in (0, 2, 5)] == ["1", "250 rays", "31 %"]
    assert card.columns()["default"][row] == "250 rays"


@pytest.mark.parametrize("width", [1156, 740])
def test_every_row_is_on_one_line_and_in_sight_without_a_scroll_bar_of_the_table(page, app_model, width):
    """No cell is wrapped or cut; on a window of 1280 x 800 the whole page is in sight."""
    show_shipped(page, app_model, width)
    QApplication.processEvents()
    table = page.defaults
    assert table.alternatingRowColors()  # at 1920 px its values are far from their names
    assert all(table.rowHeight(row) < 2 * table.fontMetrics().lineSpacing() for row in range(table.rowCount()))
    assert all(table.sizeHintForColumn(k) <= table.columnWidth(k) for k in range(table.columnCount()))
    assert table.viewport().height() >= table.verticalHeader().length()
    card = table.parentWidget()
    assert card.rect().contains(table.geometry())
    assert page.narrow or page.minimumSizeHint().height() <= 646  # of 800: header, tabs and strip take the rest


def test_no_number_lies_on_a_line(page, app_model):
    """On the smallest chart, where the numbers are closest to them."""
    show_shipped(page, app_model, 740)
    QApplication.processEvents()
    card = page.overview
    box = card.plot.item.getViewBox()
    lines = [box.mapViewToScene(line.pos()).y() for line, *_ in card.plot._lines]
    texts = [item.sceneBoundingRect() for labels in card.numbers for item in labels._items if item.isVisible()]
    assert len(texts) == len(tradeoff.METHOD_NAMES)
    assert len(lines) == 2
    assert not [text for text in texts for at in lines if text.top() + 4 < at < text.bottom() - 4]
