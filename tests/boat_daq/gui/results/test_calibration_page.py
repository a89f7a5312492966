"""The Calibrate page over made-up results: curves, comparison, warnings, acceptance and its undo."""

from __future__ import annotations

import dataclasses
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import QApplication

from analysis.calibration.curve_choice import CURVES, CurveCandidate
from analysis.warning import Warning, WarningCode
from boat_daq.engine.snapshot import LinkState
from boat_daq.errors import OperatorError
from boat_daq.gui import main_window, style
from boat_daq.gui.results.closed_readings import ClosedReadings
from boat_daq.viewmodels.results.analysis_jobs import CurveBands
from tests.boat_daq.gui.results.run_results import (
    GRID,
    X,
    out_of_tolerance_result,
    run_result,
    turning,
    without_readings,
)
from tests.boat_daq.gui.windows import SAMPLE, run_shortcut


def test_previous_calibration_is_compared(live):
    """Accept one, show another 2 mV away: the previous curve is drawn, the table has coefficients and E_n."""
    model = live.model
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    model.calibration.show(run_result())
    live.refresh()
    assert "no earlier calibration" in page.comparison.text()
    run_shortcut(live, "Ctrl+Return")
    model.calibration.accepted = None
    model.calibration.show(run_result(offset=2.0))
    live.refresh()
    assert page.coefficients.rowCount() == 8
    assert page.coefficients.item(0, 2).text() != page.coefficients.item(0, 1).text()
    assert "▲ differs" in page.comparison.text()
    card = page.curves[0]
    assert card.difference.y == pytest.approx(-2.0, abs=1e-6)
    assert card.previous.y == pytest.approx(card.curve.y - 2.0, abs=1e-3)


def test_acceptance_is_undone_and_redone_by_keys(live):
    """Ctrl+Return stores and uses it, Ctrl+Z removes it, Ctrl+Shift+Z restores it."""
    model = live.model
    live.go("Calibrate")
    model.calibration.show(run_result())
    live.refresh()
    page = live.pages["Calibrate"]
    for keys, in_force in (("Ctrl+Return", True), ("Ctrl+Z", False), ("Ctrl+Shift+Z", True)):
        run_shortcut(live, keys)
        live.refresh()
        assert (model.units.of(simulated=True).load("SA1").calibration is not None) is in_force
        assert page.accept.isEnabled() is not in_force
        assert ("calibrated 20" in live.header.unit.text()) is in_force


def test_sampled_posterior_replaces_curve_and_bands(live):
    """The mean with both of its bands; without a posterior the fit's own."""
    live.go("Calibrate")
    live.model.calibration.show(run_result())
    live.refresh()
    card = live.pages["Calibrate"].curves[0]
    assert card.readout.text().endswith("(fit)")
    assert not card.wide.item.isVisible()
    fit = card.curve.y
    found = [
        CurveBands(
            GRID, fit + 3, np.zeros(X.size), (fit + 2, fit + 4), (fit, fit + 6),
            {"converged": True, "n_eff": 9000.0, "acceptance": 0.4}, (fit - 5, fit + 9),
        )
    ] * 2  # fmt: skip
    live.model.calibration.posterior = tuple(found)
    live.model.calibration.revision += 1
    live.refresh()
    assert card.readout.text().endswith("(emcee)")
    assert card.curve.y == pytest.approx(fit + 3)
    wide, narrow = card.bands
    assert np.all((wide.low <= narrow.low) & (narrow.low <= card.curve.y) & (narrow.y <= wide.y))
    assert card.wide.item.isVisible()


@pytest.mark.parametrize("size", [(1280, 800), (853, 533)])
def test_missed_bounds_are_shown_beside_the_accept_button(live, size):
    """Figures, bounds and their source are visible beside a button that is not primary; acceptance is marked."""
    model = live.model
    model.unit.preparation.call = lambda *_: None  # the live conversion is not looked at here
    live.resize(*size)
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    model.calibration.show(run_result())
    live.refresh()
    assert (page.accept.text(), page.accept.property("role"), page.warnings_line.isVisible()) == (
        "Accept",
        "primary",
        False,
    )
    assert page.verdict.property("state") == "ok"
    model.calibration.show(out_of_tolerance_result())
    live.refresh()
    QApplication.processEvents()
    assert page.verdict.property("state") == "warning"
    assert page.warnings.text() == "Sensor 1: R\u00b2 0.7512 is below 0.9988, combined error 33.0 % FSO is above 12.1"
    assert (page.accept.text(), page.accept.property("role")) == ("Accept anyway", "")
    for widget in (page.accept, page.warnings):
        assert whole_in_sight(live, widget)
    page.accept.click()
    stored = model.units.of(simulated=True).load("SA1").calibration
    assert stored is not None
    assert stored.content["poor"] == [page.warnings.text()]
    live.refresh()
    assert "Accepted out of tolerance" in page.verdict.text()
    assert model.unit.text(model.snapshot).endswith(", out of tolerance")


def test_turning_curve_shows_its_reason_and_its_readings(live):
    """A curve without an inverse: its reason and the button to the readings are under the verdict."""
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    at_night = Warning(WarningCode.IMPORT, "", "recorded at night")
    misread = Warning(WarningCode.OUTLIER, "s1", "the reading +4.20 mm at 0 kPa is off the curve")
    whole = run_result(warnings=(at_night, misread))
    turned = turning(whole.sensors[0])
    live.model.calibration.show(dataclasses.replace(whole, sensors=(turned, whole.sensors[1])))
    live.model.calibration.last_path = Path("run.boat")
    live.refresh()
    assert page.verdict.text().endswith("the curve turns inside its range")
    assert "one signal would give two elongations" in page.warnings.text()
    assert (page.warnings.isVisible(), page.readings.isVisible(), page.accept.isEnabled()) == (True, True, False)
    assert page.run_warnings.text().splitlines()[0].endswith("is off the curve")  # first: it can be corrected


def test_readings_are_corrected_in_a_panel(live, tmp_path, qtbot):
    """The panel shows a correction and its undo without being refreshed."""
    path = Path(shutil.copy(SAMPLE, tmp_path / "older.boat"))
    live.go("Calibrate")
    live.model.calibration.show(out_of_tolerance_result())
    live.model.calibration.last_path = path
    live.refresh()
    live.pages["Calibrate"].readings.click()
    (panel,) = live.findChildren(ClosedReadings)
    before, index = panel.table.model.rows[2].cells[3], panel.table.model.index(2, 3)
    panel.table.model.setData(index, "1.25")
    qtbot.waitUntil(lambda: index.data() == "1.25", timeout=10_000)
    live.model.undo.undo()
    qtbot.waitUntil(lambda: index.data() == before, timeout=10_000)
    panel.close()


def test_key_does_not_accept_a_calibration_out_of_tolerance(live):
    """Ctrl+Return then prompts in the status strip, without a dialog; its action accepts."""
    model = live.model
    model.unit.preparation.call = lambda *_: None  # the live conversion is not looked at here
    live.go("Calibrate")
    model.calibration.show(out_of_tolerance_result())
    live.refresh()
    run_shortcut(live, "Ctrl+Return")
    assert model.units.of(simulated=True).load("SA1").calibration is None
    notice = model.notices.current()
    assert notice is not None
    assert "R\u00b2 0.7512 is below 0.9988" in notice.cause
    assert (notice.action_text, QApplication.activeModalWidget()) == ("Accept anyway", None)
    assert notice.action is not None
    notice.action()
    assert model.units.of(simulated=True).load("SA1").calibration is not None


def test_many_warnings_scroll_below_the_figures(live):
    """Forty warnings at 1280 x 800: the accept button, the verdict and the figures remain visible."""
    live.resize(1280, 800)
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    warnings = tuple(
        Warning(WarningCode.OUTLIER, "s1", f"the reading +6.86 mm at +50 kPa, unloading, cycle {i} is off the curve")
        for i in range(40)
    )
    live.model.calibration.show(dataclasses.replace(out_of_tolerance_result(), warnings=warnings))
    live.refresh()
    QApplication.processEvents()
    assert page.run_warnings.text().count("\u25b2") == 40
    assert page.table.height() > style.FIGURES_LEAST
    assert all(whole_in_sight(live, widget) for widget in (page.accept, page.verdict, page.table, page.texts))


def test_missing_readings_are_shown_in_place_of_the_curves(live):
    """Without readings, cycles or plateaus: what is missing and the next step, no empty axes."""
    for run, title, action in (
        (without_readings(0), "None of 37 plateaus has a reading", "Enter readings \u2026"),
        (without_readings(3), "Only 3 of 37 plateaus have a reading", "Enter readings \u2026"),
        (
            without_readings(3, stepped=False),
            "Only 3 of 37 plateaus have a reading",
            "Choose the file of readings \u2026",
        ),
        (without_readings(0, cycles=0), "This run has no complete cycle", "Show the plan"),
        (dataclasses.replace(without_readings(0), plateaus=0), "This run has no plateaus", "Show it on Repeat"),
    ):
        live.go("Calibrate")
        page = live.pages["Calibrate"]
        live.model.calibration.show(run)
        live.refresh()
        assert not any(card.isVisible() for card in page.curves)
        assert not page.actuator.view.isVisible()
        assert page.missing.isVisible()
        assert page.missing.title.text() == title
        assert (page.missing.button.text() if page.missing.button.isVisible() else "") == action
        assert title in page.verdict.text()
        live.model.calibration.show(run_result())
        live.refresh()
        assert all(card.isVisible() for card in page.curves)


def test_run_without_plateaus_is_shown_on_the_repeat_page(live):
    """The button shows the run on the Repeat page."""
    live.go("Calibrate")
    run = dataclasses.replace(without_readings(0), plateaus=0)
    live.model.calibration.show(run)
    live.refresh()
    live.pages["Calibrate"].missing.button.click()
    assert (live.page, live.model.repeatability.result) == ("Repeat", run)


def test_headline_counts_plateaus_readings_and_points(live):
    """How many plateaus there are, were read and are in the curve."""
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    for read, words in (
        (19, "19 of 37 plateaus read, all in the curve"),
        (20, "20 of 37 plateaus read, 19 in the curve"),
    ):
        live.model.calibration.show(dataclasses.replace(run_result(), plateaus=37, read=read))
        live.refresh()
        assert words in page.headline.text()
    live.model.calibration.show(dataclasses.replace(run_result(), plateaus=19, read=19))
    live.refresh()
    assert "19 of 19 plateaus read, all in the curve" in page.headline.text()


def whole_in_sight(window, widget) -> bool:
    """Whether all of a widget is inside the window's page without scrolling."""
    viewport = window.scrolls["Calibrate"].viewport()
    place = widget.mapTo(viewport, QPoint(0, 0))
    return widget.isVisible() and viewport.rect().contains(QRect(place, widget.size()))


def test_last_run_of_an_earlier_start_is_analysed(live, monkeypatch):
    """After a new start "Analyse the last run" takes the recording that was written last."""
    folder = live.model.services.recordings
    folder.mkdir()
    for i, name in enumerate(("b.boat", "a.boat")):
        path = folder / name
        path.touch()
        os.utime(path, ns=(i, i))
    requested: list[Path] = []
    live.model.session.change(link=LinkState.CLOSED)
    monkeypatch.setattr(live.model.calibration, "analyse", requested.append)
    live.model.calibration.analyse_current()
    assert requested == [folder / "a.boat"]


@pytest.mark.nightly
@pytest.mark.parametrize("width", [853, 1280])
def test_no_table_of_figures_scrolls_sideways(whole, width):
    """At 150 % on 1280 x 800 the figures were in a column of which only the names were visible."""
    cells = (("256.3", "definition"), ("190.6", "definition"))
    rows = tuple(((name, name), *cells) for name in ("Sensitivity, mV/mm", "Repeatability, worst level, % FSO") * 7)
    shown = dataclasses.replace(run_result(), figures=rows)
    whole.model.calibration.show(shown)
    whole.model.repeatability.show(shown)
    whole.resize(width, 533)
    for name in ("Calibrate", "Repeat"):
        whole.go(name)
        QApplication.processEvents()
        table = whole.pages[name].table
        assert table.isVisible()
        assert table.horizontalScrollBar().maximum() == 0
        assert whole.scrolls[name].horizontalScrollBar().maximum() == 0


def test_curve_is_chosen_beside_what_each_would_be(live, monkeypatch):
    """The choice shows the curve of the run and takes another, for the report too; a row a curve, cleared with it."""
    live.go("Calibrate")
    page, model, chosen = live.pages["Calibrate"], live.model.calibration, []
    assert not page.choice.isEnabled()
    of_sensor = tuple(CurveCandidate(name, "adequate", "", 0.4, 0.08) for name in CURVES)
    model.show(dataclasses.replace(run_result(), curve="auto", candidates=(of_sensor, of_sensor)))
    live.refresh()
    assert page.choice.currentText() == "By cross-validation"
    assert page.candidates.rowCount() == 2 * (1 + len(CURVES))
    monkeypatch.setattr(model, "choose_curve", chosen.append)
    page.choice.setCurrentIndex(page.choice.findText("Monotone spline"))
    page.choice.activated.emit(page.choice.currentIndex())
    assert chosen == ["spline"]
    model.last_path, model.choice = Path("a.boat"), "spline"
    monkeypatch.setattr(main_window, "ask_save", lambda _, services, name, kinds, make, done: make(Path("r.pdf")))
    monkeypatch.setattr(live.model.runs, "report", lambda paths, target, curve: chosen.append((paths, curve)))
    live.ask_report()
    assert chosen[1:] == [([Path("a.boat")], "spline")]
    model.show(None)
    model.failure = "a failure"
    monkeypatch.setattr(model, "verdict", lambda: ("fault", ""))
    monkeypatch.setattr(model, "headline", lambda: "")
    live.refresh()
    assert page.candidates.rowCount() == 0


def test_new_analysis_clears_the_page(live):
    """A run without readings, opened after one with, was shown with the curves of the other."""
    live.go("Calibrate")
    page, model = live.pages["Calibrate"], live.model.calibration
    model.show(run_result())
    live.refresh()
    card = page.curves[0]
    assert card.branches[0][0].x.size and page.curves[0].columns()
    whole, none = run_result(), np.zeros(0)
    bare = dataclasses.replace(whole.sensors[0], x=none, y=none, fit=None, void="none was read")
    model.show(dataclasses.replace(whole, sensors=(bare, bare)))
    live.refresh()
    assert not any(layer.x.size for shown in page.curves for plot in shown.plots for layer in plot.layers)
    assert page.missing.isVisible()
    assert not card.isVisible()
    model.show(run_result())
    live.refresh()
    model.result = None
    model.revision += 1
    live.refresh()
    assert not any(layer.x.size for layer in (*card.top.layers, *page.loops.plots[0].layers))
    assert page.table.rowCount() == 0
    assert live.grab().width() == live.width()  # it paints


def test_failed_analysis_shows_cause_and_remedy(live):
    """Both were in one line, cut with an ellipsis before the remedy, over axes from 0 to 1."""
    live.go("Calibrate")
    model, page = live.model.calibration, live.pages["Calibrate"]
    model.failure = OperatorError("x.boat is not a recording", "Choose another one.")
    model.revision += 1
    page.refresh(live.model.snapshot)
    assert (page.verdict.text(), page.headline.text()) == ("\u25a0 x.boat is not a recording", "Choose another one.")
    assert all(card.empty_text.text() == "Nothing to show." for card in page.curves)


def test_uncertainty_is_drawn_over_the_range(live):
    """A line for each sensor in micrometres; where no curve gives an elongation the card says so."""
    x = np.linspace(-2.7, 3.8, 41)
    u = tuple(np.column_stack([x, 0.06 + scale * (x + 2.7)]) for scale in (0.01, 0.02))
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    live.model.calibration.show(run_result(u_elongation=u))
    live.refresh()
    for line, of_sensor in zip(page.uncertainty.lines, u, strict=True):
        assert line.x == pytest.approx(x)
        assert line.y == pytest.approx(1000.0 * of_sensor[:, 1])
    live.model.calibration.show(run_result())
    live.refresh()
    assert page.uncertainty.empty_text.text() == "No curve gives an elongation."
