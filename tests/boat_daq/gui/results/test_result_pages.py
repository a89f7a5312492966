"""The Calibrate and Repeat pages over results made by hand: what is drawn, what stands beside it, what is undone."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import QApplication

from analysis.calibration.fit import fit_calibration
from analysis.warning import Warning, WarningCode
from boat_daq.gui import style
from boat_daq.gui.results.closed_readings import ClosedReadings
from boat_daq.viewmodels.common.jobs import JobState
from boat_daq.viewmodels.results.analysis_view import (
    BreakResult,
    CycleSeries,
    FigureText,
    LoopSet,
    PosteriorResult,
    RunResult,
    SensorResult,
)
from tests.boat_daq.gui.test_manners import run_shortcut

SAMPLE = Path(__file__).parents[4] / "recordings" / "simulated_SA1_two_cycles.boat"
CYCLES = 8
X = np.linspace(-2.7, 3.8, 19)
GRID = np.linspace(-2.7, 3.8, 161)


def sensor(number: int, offset: float = 0.0) -> SensorResult:
    """A cubic with a little scatter."""
    y = 1650 + offset + 40 * X - 2 * X**2 + 0.5 * np.cos(7 * X)
    fit = fit_calibration(X, y)
    each = np.linspace(0.0, 1.0, CYCLES)
    cycles = CycleSeries(5 + each, 44 + each, 2.8 + 0.01 * each, "mV/kPa", 0)
    content = {"name": f"s{number}", "fit": fit.as_json(), "elongation_mm": X.tolist(), "signal_mv": y.tolist()}
    return SensorResult(
        f"s{number}_mv", "", {}, cycles, X, y, fit.residuals, X > 0, np.ones(X.size, np.int64), GRID,
        fit.predict(GRID), fit.band(GRID, 0.68), fit.band(GRID, 0.95), content | {"figures": {}}, (),
    )  # fmt: skip


def result(offset: float = 0.0, warnings: tuple[Warning, ...] = (), **more) -> RunResult:
    """A run of two sensors and eight cycles."""
    level = np.linspace(-40.0, 50.0, 10)
    pressure = np.broadcast_to(level, (2, CYCLES, 10))
    loops = LoopSet(tuple(range(1, CYCLES + 1)), level, pressure, None, np.stack([1650 + 3 * pressure] * 2))
    nothing = FigureText("", "")
    return RunResult(
        "run.boat", "SA1", "2026-01-01", True, "staircase", 100.0, CYCLES, 0,
        (sensor(1, offset), sensor(2, offset)), (), nothing, nothing, loops, warnings, 0.14, **more,
    )  # fmt: skip


def test_the_last_calibration_stands_beside_this_one(live):
    """Accept one, look at another 2 mV away: its curve is drawn, the coefficients and E_n stand in the table."""
    model = live.model
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    model.calibration.show(result())
    live.refresh()
    assert "no earlier calibration" in page.comparison.text()
    run_shortcut(live, "Ctrl+Return")
    model.calibration.accepted = None
    model.calibration.show(result(offset=2.0))
    live.refresh()
    assert page.beside.rowCount() == 8
    assert page.beside.item(0, 2).text() != page.beside.item(0, 1).text()
    assert "▲ differs" in page.comparison.text()
    card = page.curves[0]
    assert card.apart.y == pytest.approx(-2.0, abs=1e-6)
    assert card.before.y == pytest.approx(card.curve.y - 2.0, abs=1e-3)


def test_an_acceptance_is_undone_by_a_key(live):
    """Ctrl+Return stores and uses it, Ctrl+Z takes it out of force, Ctrl+Shift+Z puts it back."""
    model = live.model
    live.go("Calibrate")
    model.calibration.show(result())
    live.refresh()
    page = live.pages["Calibrate"]
    for keys, in_force in (("Ctrl+Return", True), ("Ctrl+Z", False), ("Ctrl+Shift+Z", True)):
        run_shortcut(live, keys)
        live.refresh()
        assert (model.units.load("SA1").calibration is not None) is in_force
        assert page.accept.isEnabled() is not in_force
        assert ("calibrated 20" in live.header.unit.text()) is in_force


def test_curve_and_bands_are_of_the_posterior_once_it_is_there(live):
    """The mean with both of its bands; without a posterior the fit's own."""
    live.go("Calibrate")
    live.model.calibration.show(result())
    live.refresh()
    card = live.pages["Calibrate"].curves[0]
    assert card.readout.text().endswith("fit")
    assert not card.wide.item.isVisible()
    fit = card.curve.y
    found = [
        PosteriorResult(GRID, fit + 3, (fit + 2, fit + 4), (fit, fit + 6), (fit - 5, fit + 9),
                        {"converged": True, "n_eff": 9000.0, "acceptance": 0.4})
    ] * 2  # fmt: skip
    live.model.calibration.posterior = tuple(found)
    live.model.calibration.revision += 1
    live.refresh()
    assert card.readout.text().endswith("emcee")
    assert card.curve.y == pytest.approx(fit + 3)
    wide, narrow = card.bands
    assert np.all((wide.low <= narrow.low) & (narrow.low <= card.curve.y) & (narrow.y <= wide.y))
    assert card.wide.item.isVisible()


def test_every_cycle_is_drawn_and_a_break_is_seen(live):
    """Eight points in each plot; a line at the break and the tests in their own tab; gone with the next run."""
    rows = (("Sensor 1: span (mV)", "256 (n = 4)", "251 (n = 4)", "▲ 0.0004", "0.3"),)
    broken = result(breaks=(BreakResult(4.5, "the run was broken after 4 cycles (interrupted)", rows),))
    live.go("Repeat")
    page = live.pages["Repeat"]
    live.model.repeatability.show(broken)
    live.refresh()
    for card in (page.hysteresis, page.sensitivity, page.snr):
        assert card.sensors[0].x.tolist() == list(range(1, CYCLES + 1))
    assert page.sensitivity.plot.unit == "mV/kPa"
    assert {line.value() for _, line in page.break_lines} == {4.5}
    assert page.tabs.count() == 2
    assert page.tested.item(0, 3).text() == "▲ 0.0004"
    assert "broken after 4 cycles" in page.broken.text()
    live.model.repeatability.show(dataclasses.replace(broken, breaks=()))
    live.refresh()
    assert (page.break_lines, page.tabs.count()) == ([], 1)


def poor_result(**more) -> RunResult:
    """The same run with a fit that misses two bounds."""
    short = (
        Warning(WarningCode.OUT_OF_TOLERANCE, "r2", "R\u00b2 0.7512 is below 0.9988"),
        Warning(WarningCode.OUT_OF_TOLERANCE, "combined_error_percent_fso", "combined error 33.0 % FSO is above 12.1"),
    )
    whole = result(**more)
    return dataclasses.replace(
        whole, sensors=(dataclasses.replace(whole.sensors[0], out_of_tolerance=short), whole.sensors[1])
    )


@pytest.mark.parametrize("size", [(1280, 800), (853, 533)])
def test_what_is_poor_stands_beside_the_offer_to_accept(live, size):
    """Figures, bounds and their source are said in sight of a button that is not the next step; accepting is marked."""
    model = live.model
    model.unit.preparation.ask = lambda content: None  # the live conversion is not looked at here
    live.resize(*size)
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    model.calibration.show(result())
    live.refresh()
    assert (page.accept.text(), page.accept.property("role"), page.judgement.isVisible()) == (
        "Accept",
        "primary",
        False,
    )
    assert page.verdict.property("state") == "ok"
    model.calibration.show(poor_result())
    live.refresh()
    QApplication.processEvents()
    assert page.verdict.property("state") == "warning"
    assert page.poor.text() == "Sensor 1: R\u00b2 0.7512 is below 0.9988, combined error 33.0 % FSO is above 12.1"
    assert (page.accept.text(), page.accept.property("role")) == ("Accept anyway", "")
    for widget in (page.accept, page.poor):
        assert whole_in_sight(live, widget)
    page.accept.click()
    stored = model.units.load("SA1").calibration
    assert stored is not None
    assert stored.content["poor"] == [page.poor.text()]
    live.refresh()
    assert "though poor" in page.verdict.text()
    assert model.unit.text(model.snapshot).endswith(", poor")


def test_a_curve_that_turns_says_why_and_leads_to_its_readings(live):
    """No bound to miss, but no inverse: the whole reason and the way to the readings stand under the verdict."""
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    at_night = Warning(WarningCode.IMPORT, "", "recorded at night")
    misread = Warning(WarningCode.OUTLIER, "s1", "the reading +4.20 mm at 0 kPa is off the curve")
    whole = result(warnings=(at_night, misread))
    fit = whole.sensors[0].content["fit"] | {"monotone": False}
    turned = dataclasses.replace(whole.sensors[0], content=whole.sensors[0].content | {"fit": fit})
    live.model.calibration.show(dataclasses.replace(whole, sensors=(turned, whole.sensors[1])))
    live.model.calibration.last_path = Path("run.boat")
    live.refresh()
    assert page.verdict.text().endswith("the curve turns inside its range")
    assert "one signal would stand for two elongations" in page.poor.text()
    assert (page.poor.isVisible(), page.look.isVisible(), page.accept.isEnabled()) == (True, True, False)
    assert page.flags.text().splitlines()[0].endswith("is off the curve")  # before the rest: it can be corrected


def test_readings_are_corrected_from_the_calibration_page(live, tmp_path, qtbot):
    """The panel beside the window shows a correction, and its undo, by itself."""
    path = Path(shutil.copy(SAMPLE, tmp_path / "older.boat"))
    live.go("Calibrate")
    live.model.calibration.show(poor_result())
    live.model.calibration.last_path = path
    live.refresh()
    live.pages["Calibrate"].look.click()
    (panel,) = live.findChildren(ClosedReadings)
    before, index = panel.table.model.rows[2].cells[3], panel.table.model.index(2, 3)
    panel.table.model.setData(index, "1.25")
    qtbot.waitUntil(lambda: index.data() == "1.25", timeout=10_000)
    live.model.undo.undo()
    qtbot.waitUntil(lambda: index.data() == before, timeout=10_000)
    panel.close()


def test_a_key_alone_accepts_nothing_poor(live):
    """Ctrl+Return on a poor calibration asks in the strip, without a box; its answer accepts."""
    model = live.model
    model.unit.preparation.ask = lambda content: None  # the live conversion is not looked at here
    live.go("Calibrate")
    model.calibration.show(poor_result())
    live.refresh()
    run_shortcut(live, "Ctrl+Return")
    assert model.units.load("SA1").calibration is None
    notice = model.notices.current()
    assert notice is not None
    assert "R\u00b2 0.7512 is below 0.9988" in notice.cause
    assert (notice.action_text, QApplication.activeModalWidget()) == ("Accept anyway", None)
    assert notice.action is not None
    notice.action()
    assert model.units.load("SA1").calibration is not None


def test_remarks_scroll_and_leave_the_figures_and_the_offer_in_sight(live):
    """Forty flags at 1280 x 800: the button to accept, the verdict and the table of figures are still there."""
    live.resize(1280, 800)
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    warnings = tuple(
        Warning(WarningCode.OUTLIER, "s1", f"the reading +6.86 mm at +50 kPa, unloading, cycle {i} is off the curve")
        for i in range(40)
    )
    live.model.calibration.show(dataclasses.replace(poor_result(), warnings=warnings))
    live.refresh()
    QApplication.processEvents()
    assert page.flags.text().count("\u25b2") == 40
    assert page.table.height() > style.FIGURES_LEAST
    assert all(whole_in_sight(live, widget) for widget in (page.accept, page.verdict, page.table, page.remarks))


def without_readings(read: int, **more) -> RunResult:
    """A run that has no curve."""
    nothing = np.zeros(0)
    whole = result()
    sensors = tuple(dataclasses.replace(s, x=nothing, y=nothing, content=None, void="...") for s in whole.sensors)
    return dataclasses.replace(whole, sensors=sensors, plateaus=37, read=read, **more)


@pytest.mark.parametrize(
    ("run", "title", "action"),
    [
        (without_readings(0), "None of 37 plateaus has a reading", "Enter readings \u2026"),
        (without_readings(3), "Only 3 of 37 plateaus have a reading", "Enter readings \u2026"),
        (without_readings(3, path="run.csv"), "Only 3 of 37 plateaus have a reading", ""),
        (without_readings(0, cycles=0), "This run has no complete cycle", "Show the plan"),
        (dataclasses.replace(without_readings(0), plateaus=0), "This run has no plateaus", "Show it on Repeat"),
    ],
)
def test_what_is_missing_for_a_curve_stands_in_its_place(live, run, title, action):
    """Without readings, cycles or plateaus: no empty axes, but what is missing, and the next step as a button."""
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
    live.model.calibration.show(result())
    live.refresh()
    assert all(card.isVisible() for card in page.curves)


def test_the_next_step_of_a_run_without_plateaus_is_the_other_page(live):
    """The button shows the run on the Repeat page."""
    live.go("Calibrate")
    run = dataclasses.replace(without_readings(0), plateaus=0)
    live.model.calibration.show(run)
    live.refresh()
    live.pages["Calibrate"].missing.button.click()
    assert (live.page, live.model.repeatability.result) == ("Repeat", run)


def test_one_count_of_plateaus(live):
    """How many there were, were read and are in the curve: one sentence, in the line under the verdict."""
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    for read, words in (
        (19, "19 of 37 plateaus read, all in the curve"),
        (20, "20 of 37 plateaus read, 19 in the curve"),
    ):
        live.model.calibration.show(dataclasses.replace(result(), plateaus=37, read=read))
        live.refresh()
        assert words in page.headline.text()
    live.model.calibration.show(dataclasses.replace(result(), plateaus=19, read=19))
    live.refresh()
    assert "all 19 plateaus read, all in the curve" in page.headline.text()


def test_repeat_says_what_is_missing(live):
    """No run, a run without a whole cycle, one that cannot be read: words and the next step, never empty axes."""
    app_model, model = live.model, live.model.repeatability
    live.go("Repeat")
    page = live.pages["Repeat"]
    live.refresh()
    assert page.missing.title.text() == "No run of many cycles yet"
    model.show(dataclasses.replace(result(), cycles=0, partial=1))
    live.refresh()
    assert page.missing.isVisible()
    assert page.missing.title.text() == "run.boat has no complete cycle"
    model.show(result())
    live.refresh()
    assert not page.missing.isVisible()
    model._analysed(
        SimpleNamespace(state=JobState.FAILED, failure=SimpleNamespace(cause="damaged", remedy="Recover it."))
    )
    live.refresh()
    assert (page.missing.isVisible(), page.missing.words.text()) == (True, "damaged. Recover it.")
    page.missing.button.click()
    assert app_model.sequence.plan.name == "repeatability"


def test_a_figure_that_no_cycle_has_is_said(live):
    """Hysteresis of no cycle: words in the place of its plot; the others are drawn."""
    live.go("Repeat")
    page = live.pages["Repeat"]
    whole = result()
    none = dataclasses.replace(whole.sensors[0].cycles, hysteresis_percent_fso=np.full(CYCLES, np.nan))
    sensors = tuple(dataclasses.replace(s, cycles=none) for s in whole.sensors)
    live.model.repeatability.show(dataclasses.replace(whole, sensors=sensors))
    live.refresh()
    assert (page.hysteresis.view.isVisible(), page.hysteresis.empty_text.isVisible()) == (False, True)
    assert page.snr.view.isVisible()


def whole_in_sight(window, widget) -> bool:
    """Whether all of a widget is inside the window's page without scrolling."""
    room = window.scrolls["Calibrate"].viewport()
    place = widget.mapTo(room, QPoint(0, 0))
    return widget.isVisible() and room.rect().contains(QRect(place, widget.size()))
