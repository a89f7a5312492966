"""The optics page: designs on and off the grid, curves from a file, the sweep's pictures."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF
from PySide6.QtWidgets import QLabel

from analysis.fidelity import fidelity
from analysis.optics.sweep.figure_of_merit import Merit, merit
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.gui import style
from boat_daq.gui.models.optics_page import select
from boat_daq.viewmodels.models import optics
from boat_daq.viewmodels.models.optics import PAPER_DESIGN, DesignResult, StateScene, SweepSummary
from boat_daq.workflows.jobs import JobFailure, JobState
from tests.boat_daq.gui.models.test_tradeoff_page import app_model  # noqa: F401 - a fixture
from tests.boat_daq.gui.recorded_session import connected

NORMAL = fidelity("normal")
LINE = np.array([[0.0, 0.0], [75.0, 1.0]])


class FakeJob:
    """Job that ends when the test ends it."""

    made: ClassVar[list[FakeJob]] = []

    def __init__(self, label, function, *args):
        self.label, self.function, self.args = label, function, args
        self.state, self.result, self.failure, self.fraction = JobState.RUNNING, None, None, 0.5
        FakeJob.made.append(self)

    def poll(self):
        return self.state

    def cancel(self):
        self.state = JobState.CANCELLED

    def bring(self, result):
        """End well with `result`."""
        self.state, self.result = JobState.DONE, result

    def fail(self, cause):
        """End badly."""
        self.state, self.failure = JobState.FAILED, JobFailure(cause, "Choose another.", "")


def traced(rays=250, error=4.6):
    """A design with fifteen straight rays."""
    scene, x = StateScene(LINE, LINE, LINE, LINE), np.linspace(-2.7, 3.8, 15)
    flat = np.full(15, 100.0)
    return DesignResult((scene,) * 15, x, flat, flat, merit(flat, 1.0), np.linspace(error / 2, error, 15), rays)


def swept(rays=250):
    """A sweep of two designs, the second the paper's."""
    values = np.array([[5, 0.7, 0.6, 0.8], [*PAPER_DESIGN]])
    p, flags = np.array([1.0, 0.25]), np.array([True, False])
    found = Merit(p, np.array([40.0, 10.0]), np.array([2, 7]), np.array([3.0, 6.0]), p, p, ~flags, ~flags)
    return SweepSummary(values, found, flags, 0, 1, np.array([1, 2]), 1.0, 30, rays)


@pytest.fixture
def page(qtbot, app_model, monkeypatch):  # noqa: F811 - the fixture above
    """The page, shown, with the paper's design traced."""
    from boat_daq.gui.models.optics_page import OpticsPage

    FakeJob.made = []
    monkeypatch.setattr(optics, "Job", FakeJob)
    shown = OpticsPage(app_model.optics, app_model.services)
    qtbot.addWidget(shown)
    shown.resize(1100, 700)
    shown.show()
    shown.refresh(app_model.snapshot)
    FakeJob.made[-1].bring(traced())
    update(shown)
    return shown


def update(page):
    page.model.jobs.poll()
    page.refresh(SessionSnapshot(SessionState.IDLE, LinkState.CLOSED))


def test_design_off_the_grid_is_shown_in_its_fields(page):
    """A value that is not offered is added while it is shown."""
    page.model.choose((7, 1.234, 0.61, 0.55), "inner")
    assert FakeJob.made[-1].args == ((7, 1.234, 0.61, 0.55), NORMAL.rays, "inner")
    update(page)
    assert (page.fields["width"].currentText(), page.fields["width"].count()) == ("1.23", 7)
    assert page.face.currentData() == "inner"
    page.model.choose(PAPER_DESIGN, "outer")
    update(page)
    assert (page.fields["width"].currentText(), page.fields["width"].count()) == ("1", 6)


def many(tied=3, paper=4):
    """A sweep of six designs, whose best three cannot be told apart; the paper's at a place from 0."""
    values = np.array([[7, 0.7, 0.6, 1.0], *([5, 1.0, 0.5, s] for s in (0.5, 0.6, 0.7, 0.8, 1.0))])
    values[paper] = PAPER_DESIGN
    p = np.array([1.0, 0.9, 0.8, 0.5, 0.38, 0.1])
    flags = np.arange(6) < tied
    found = Merit(*[p] * 6, ~flags, ~flags)
    return SweepSummary(values, found, flags, 0, paper, np.arange(1, 7), 1.0, 90, 250, "5 (3 to 6)", 2, 7)


def test_page_answers_which_design_is_best_and_how_sure_that_is(page):
    """Best, paper's and those like the best in words; the strip has all designs, the ranks are behind Details."""
    page.model.sweep = None
    page.model.revision += 1
    update(page)
    assert page.best.text().startswith("Press \u201cSweep all designs\u201d")
    page.model.sweep = many()
    page.model.revision += 1
    update(page)
    assert page.best.text() == "Best: 7 cavities, 0.7 \u00d7 0.6 mm, spacing 1.0 mm"
    assert page.paper.text().endswith("0.5 mm, spacing 0.9 mm   38 % of the best figure of merit")
    assert page.certainty.text() == "2 designs of 6 cannot be told from the best with 250 rays."
    assert page.strip.tied.x.tolist() == [1.0, 2.0, 3.0]
    assert page.strip.others.x.tolist() == [4.0, 5.0, 6.0]
    assert (page.strip.best.x.tolist(), page.strip.paper.x.tolist()) == ([1.0], [5.0])
    assert not page.ranks.isVisible()
    page.details_button.click()
    assert page.ranks.isVisible()
    assert "5 (3 to 6)" in page.ranks.text()
    assert "2 designs best in at least one of 7 sweeps" in page.ranks.text()
    page.best_button.click()
    assert page.model.values == (7, 0.7, 0.6, 1.0)
    page.model.show_place(5)
    assert page.model.values == PAPER_DESIGN
    page.model.sweep = many(tied=5)
    assert page.model.certainty_text().endswith("with 250 rays. The paper's is one of them.")
    page.model.sweep = many(tied=1)
    assert page.model.certainty_text() == "The best can be told from all other designs with 250 rays."


def test_one_button_traces_more_rays(page):
    """Of 250 rays to 1 000, and on; it stops the sweep that runs."""
    page.model.sweep = many()
    page.model.revision += 1
    update(page)
    assert page.sweep_button.text() == "Trace 1\u2009000 rays"
    page.sweep_button.click()
    assert FakeJob.made[-1].args[1] == 1000
    update(page)
    assert page.sweep_button.text() == "Stop the sweep"
    page.sweep_button.click()
    update(page)
    assert page.sweep_button.text() == "Trace 1\u2009000 rays"
    page.model.sweep = dataclasses.replace(many(), rays=5000)
    assert page.model.more_rays == 10_000


def test_every_selector_has_its_name_above(page):
    """Nine fields had no name."""
    page.details_button.click()
    fields = (*page.fields.values(), page.face)
    names = [label for label in page.findChildren(QLabel) if label.isVisible() and label.text()]
    for field in fields:
        corner = field.mapTo(page, QPoint(0, 0))
        above = [n for n in names if abs(n.mapTo(page, QPoint(0, 0)).x() - corner.x()) <= 2]
        assert any(0 <= corner.y() - n.mapTo(page, n.rect().bottomLeft()).y() <= 8 for n in above), (
            field.accessibleName()
        )


def test_nothing_is_traced_by_itself_during_a_run(qtbot, app_model, monkeypatch):  # noqa: F811 - the fixture above
    """Opening the page in a run took the processor from the reader; the page says why it is empty."""
    from boat_daq.gui.models.optics_page import OpticsPage

    FakeJob.made = []
    monkeypatch.setattr(optics, "Job", FakeJob)
    shown = OpticsPage(app_model.optics, app_model.services)
    qtbot.addWidget(shown)
    shown.refresh(SessionSnapshot(SessionState.RUNNING, LinkState.UP))
    assert FakeJob.made == []
    assert "until the run has ended" in shown.scene.empty_text.text()
    assert not any(b.isEnabled() for b in (shown.sweep_button, shown.best_button, shown.paper_button))
    shown.fields["width"].activated.emit(0)
    app_model.optics.show_place(1)
    assert (FakeJob.made, app_model.optics.design_text()) == ([], "")
    assert "until the run has ended" in shown.response.empty_text.text()
    for state in (SessionState.IDLE, SessionState.ARMED):
        shown.refresh(dataclasses.replace(connected(), state=state))  # +30 kPa by hand
    assert FakeJob.made == []
    shown.refresh(SessionSnapshot(SessionState.IDLE, LinkState.UP))
    assert len(FakeJob.made) == 1
    assert FakeJob.made[0].args[0] == app_model.optics.values != PAPER_DESIGN
    assert shown.sweep_button.isEnabled()


def test_first_opening_shows_the_shipped_sweep_and_what_is_being_done(qtbot, app_model, monkeypatch):  # noqa: F811
    """It was empty for 40 s while the tracer was compiled."""
    from boat_daq.gui.models.optics_page import OpticsPage

    monkeypatch.setattr(optics, "Job", FakeJob)
    shown = OpticsPage(app_model.optics, app_model.services)
    qtbot.addWidget(shown)
    shown.refresh()
    assert shown.best.text().startswith("Best:")
    assert shown.strip.others.x.size + shown.strip.tied.x.size == 648
    job, names = (
        FakeJob.made[-1],
        {"optics": FakeJob.made[-1], "compiled code": SimpleNamespace(counted="compiling: 3 of 98 functions")},
    )
    monkeypatch.setattr(app_model.optics.jobs, "get", names.get)
    job.fraction = None
    shown.refresh()
    assert "appear here. Compiling: 3 of 98 functions." in shown.scene.empty_text.text()
    job.fraction = 0.4
    shown.refresh()
    assert shown.scene.empty_text.text() == "The light guide and its rays appear here. Tracing \u2026 40 %."


def test_value_not_offered_is_listed_last_while_selected(page):
    """Selecting off and on again leaves the offer as it was."""
    field = page.fields["depth"]
    before = [field.itemText(i) for i in range(field.count())]
    select(field, 0.777, "0.777")
    assert field.currentText() == "0.777"
    select(field, 0.5, "0.5")
    assert [field.itemText(i) for i in range(field.count())] == before


def test_late_trace_is_not_shown_for_another_design(page):
    """The previous request's result is kept, not drawn in place of the current one's."""
    page.model.choose((3, 0.5, 0.5, 0.5))
    late = FakeJob.made[-1]
    late.bring(traced())
    page.model.values = PAPER_DESIGN
    page.model.result = None
    page.model.jobs.poll()
    assert page.model.result is None
    page.model.choose((3, 0.5, 0.5, 0.5))
    assert page.model.result is late.result


def test_click_on_a_map_shows_the_design(page):
    """The cell under the mouse in the map of its width."""
    page.model.sweep = None
    page.sweep_button.click()
    assert FakeJob.made[-1].args == ((3, 5, 7), NORMAL.ranking_rays)
    FakeJob.made[-1].bring(swept())
    update(page)
    marked = {spot.symbol(): spot.pos().toTuple() for spot in page.maps.maps[5].marks.points()}
    assert marked == {"o": (4.5, 0.5)}
    x, y = page.maps.maps[5].shown.getData()
    assert (x.min(), x.max(), y.min(), y.max()) == (4.0, 5.0, 0.0, 1.0)  # about the cell, within the map
    assert [spot.symbol() for spot in page.maps.maps[2].marks.points()] == ["star"]

    class Click:
        def scenePos(self):
            return page.maps.maps[2].item.getViewBox().mapViewToScene(QPointF(3.2, 1.9))

    page.maps._clicked(Click())
    assert page.model.values == (5, 0.7, 0.6, 0.8)


def test_slider_selects_states_without_tracing(page):
    """Fifteen states, each drawn from what is there."""
    before = len(FakeJob.made)
    page.slider.setValue(0)
    assert page.response.now.value() == pytest.approx(-2.7)
    page.slider.setValue(14)
    assert page.response.now.value() == pytest.approx(3.8)
    assert "state 14 of 14" in page.scene.readout.text()
    assert len(FakeJob.made) == before


def test_answers_state_their_errors_and_rays(page):
    """The error (k = 2) of the state and the greatest of all; the plot states how many of the rays are drawn."""
    page.slider.setValue(14)
    assert "100.0 \u00b1 4.6 of 250 rays detected (k = 2), 250 traced" in page.scene.readout.text()
    assert page.response.readout.text().endswith("band up to \u00b14.6 (k = 2)")
    assert page.scene.drawn.text == ""
    page.model.set_fidelity(fidelity("reference"))
    page.model.choose(PAPER_DESIGN)
    FakeJob.made[-1].bring(traced(20_000, 0.2))
    update(page)
    assert "100.00 \u00b1 0.20 of 250 rays detected (k = 2), 20\u2009000 traced" in page.scene.readout.text()
    assert page.scene.drawn.text == "250 of 20\u2009000 rays drawn"
    page.sweep_button.click()
    FakeJob.made[-1].bring(dataclasses.replace(swept(), error_text="counts of 250 rays within 7.8"))
    update(page)
    assert "Counts of 250 rays within 7.8" in page.ranks.text()


def test_design_before_is_shown_faded_until_the_new_one_is_traced(page):
    """It vanished while the new one was traced; how much is done is shown."""
    page.model.choose((3, 0.5, 0.5, 0.5))
    update(page)
    assert page.scene.view.isVisible()
    assert page.scene.plot.item.opacity() == page.response.plot.item.opacity() == style.STALE_OPACITY
    assert page.scene.readout.text().startswith("previous design")
    assert page.response.readout.text() == "tracing \u2026 50 %   previous design shown"
    FakeJob.made[-1].fraction = 0.8
    update(page)
    assert "80 %" in page.response.readout.text()
    FakeJob.made[-1].bring(traced())
    update(page)
    assert page.scene.plot.item.opacity() == page.response.plot.item.opacity() == 1.0
    assert "previous design" not in page.scene.readout.text() + page.response.readout.text()


def test_cancelled_trace_is_not_started_again(page):
    """The plots keep the design before, and the page says how the chosen one is traced."""
    page.model.choose((3, 0.5, 0.5, 0.5))
    page.model.jobs.cancel("optics")
    made = len(FakeJob.made)
    update(page)
    update(page)
    assert len(FakeJob.made) == made
    assert page.response.readout.text().startswith("\u25b2 The tracing was stopped. Choose the design again")
    assert page.scene.plot.item.opacity() == style.STALE_OPACITY
    page.model.choose(PAPER_DESIGN)
    update(page)
    assert page.scene.plot.item.opacity() == 1.0
    assert "range" in page.response.readout.text()


def test_refused_sweep_is_reported_beside_its_button(page):
    """Cause and remedy; before, the design's own readout had them."""
    page.sweep_button.click()
    FakeJob.made[-1].fail("an error of 1e-09 rays takes more than 10 000 000 rays")
    update(page)
    assert page.outcome.text().startswith(
        "\u25b2 an error of 1e-09 rays takes more than 10 000 000 rays. Choose another."
    )
    assert page.model.problem == ""
    assert page.model.notices.current().remedy == "Choose another."
    page.sweep_button.click()
    update(page)
    assert "\u25b2" not in page.outcome.text()


def test_fidelity_chosen_during_a_trace_begins_it_again(page):
    """Its result would be of the fidelity before."""
    page.model.choose((3, 0.5, 0.5, 0.5))
    page.model.set_fidelity(fidelity("reference"))
    assert FakeJob.made[-1].args[1] == fidelity("reference").rays


def test_empty_plots_show_what_will_be_there(live, monkeypatch):
    """Before, empty axes from 0 to 1 were shown, like data that are missing."""
    monkeypatch.setattr(live.model.optics, "choose", lambda *_: None)
    live.go("Optics")
    page = live.pages["Optics"]
    page.details_button.click()
    live.model.optics.sweep = None
    for card in (page.strip, page.maps):
        card.show_sweep()
    page.scene.show_state(live.model.optics)
    page.response.show_result(live.model.optics)
    for cards, what in (((page.scene, page.response), "appear here"), ((page.strip, page.maps), "design")):
        for card in cards:
            assert not card.view.isVisible()
            assert what in card.empty_text.text()
    page.response.show_empty("")
    assert page.response.view.isVisible()
    assert not page.response.empty_text.isVisible()
