"""Results of every kind on the Calibrate page: what is drawn, written and cleared, in one window."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from analysis.warning import Warning, WarningCode
from boat_daq.gui import style
from boat_daq.viewmodels.results.run_result import CurveBands
from boat_daq.workflows.acceptance import RunVerdict
from protocol.base.errors import RequestError
from tests.boat_daq.gui.results.run_results import (
    GRID,
    X,
    out_of_tolerance_result,
    run_result,
    turning,
    whole_in_sight,
    without_curve,
    without_readings,
)
from tests.boat_daq.gui.windows import shared_window


@pytest.fixture(scope="module")
def opened(tmp_path_factory, qapp):
    """A window on a connected board for the tests that show results of their own on its Calibrate page."""
    with shared_window(tmp_path_factory.mktemp("opened")) as window:
        yield window


@pytest.fixture
def calibrate(opened):
    """That window, its Calibrate page without a result."""
    model = opened.model.calibration
    model.result, model.before, model.agreements, model.posterior = None, None, (), ()
    model.failure, model.last_path, model.accepted = None, None, None
    model.revision += 1
    opened.resize(*style.WINDOW_SIZE)
    opened.go("Calibration")
    opened.refresh()
    return opened


def test_sampled_posterior_replaces_curve_and_bands(calibrate):
    """The mean with both of its bands; without a posterior the fit's own."""
    calibrate.go("Calibration")
    calibrate.model.calibration.show(run_result())
    calibrate.refresh()
    card = calibrate.pages["Calibration"].curves[0]
    assert card.readout.text().endswith("(fit)")
    assert not card.wide.item.isVisible()
    fit = card.curve.y
    found = [
        CurveBands(
            GRID, fit + 3, np.zeros(X.size), (fit + 2, fit + 4), (fit, fit + 6),
            {"converged": True, "n_eff": 9000.0, "acceptance": 0.4, "band_error_percent_fso": 0.2},
            (fit - 5, fit + 9),
        )
    ] * 2  # fmt: skip
    calibrate.model.calibration.posterior = tuple(found)
    calibrate.model.calibration.revision += 1
    calibrate.refresh()
    assert card.readout.text().endswith("(emcee)")
    assert card.curve.y == pytest.approx(fit + 3)
    wide, narrow = card.bands
    assert np.all((wide.low <= narrow.low) & (narrow.low <= card.curve.y) & (narrow.y <= wide.y))
    assert card.wide.item.isVisible()
    assert "bands \u00b10.2 % FSO" in calibrate.pages["Calibration"].posterior.text()


def test_turning_curve_shows_its_reason_and_its_readings(calibrate):
    """A curve without an inverse: its reason and the button to the readings are under the verdict."""
    calibrate.go("Calibration")
    page = calibrate.pages["Calibration"]
    at_night = Warning(WarningCode.IMPORT, "", "recorded at night")
    misread = Warning(WarningCode.OUTLIER, "s1", "the reading +4.20 mm at 0 kPa is off the curve")
    whole = run_result(warnings=(at_night, misread))
    turned = turning(whole.sensors[0])
    verdict = RunVerdict("turns", "fail", "Not a calibration: the curve of sensor 1 turns inside its range")
    turned_run = dataclasses.replace(whole, sensors=(turned, whole.sensors[1]), verdict=verdict)
    calibrate.model.calibration.show(turned_run)
    calibrate.model.calibration.last_path = Path("run.boat")
    calibrate.refresh()
    assert page.verdict.text().endswith("turns inside its range")
    assert page.verdict.property("state") == "fault"
    assert "one signal would give two elongations" in page.warnings.text()
    assert (page.warnings.isVisible(), page.readings.isVisible(), page.accept.isEnabled()) == (True, True, False)
    assert page.run_warnings.text().splitlines()[0].endswith("is off the curve")  # first: it can be corrected


def test_many_warnings_scroll_below_the_figures(calibrate):
    """Forty warnings at 1280 x 800: accept button, verdict and figures remain visible; no heading over no figures."""
    calibrate.resize(1280, 800)
    calibrate.go("Calibration")
    page = calibrate.pages["Calibration"]
    warnings = tuple(
        Warning(WarningCode.OUTLIER, "s1", f"the reading +6.86 mm at +50 kPa, unloading, cycle {i} is off the curve")
        for i in range(40)
    )
    result = dataclasses.replace(out_of_tolerance_result(), warnings=warnings)
    rows = tuple(((f"Figure {k}, mV", ""), ("1.0", ""), ("2.0", "")) for k in range(6))
    for known in (rows, ()):
        calibrate.model.calibration.show(dataclasses.replace(result, figures=known, key_figures=known))
        calibrate.refresh()
        QApplication.processEvents()
        assert page.run_warnings.text().count("\u25b2") == 40
        assert page.table.isVisible() is bool(known)
        table = (page.table,) if known else ()
        assert all(whole_in_sight(calibrate, widget) for widget in (page.accept, page.verdict, *table, page.texts))
        assert page.table.model().rowCount() == len(known)


def test_missing_readings_are_shown_in_place_of_the_curves(calibrate):
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
        (dataclasses.replace(without_readings(0), plateaus=0), "This run has no plateaus", "Show its cycles"),
    ):
        calibrate.model.calibration.show(run)
        calibrate.go("Calibration")
        page = calibrate.pages["Calibration"]
        calibrate.refresh()
        assert not any(card.isVisible() for card in page.curves)
        assert page.loops.view.isVisible() is bool(run.cycles)
        assert page.missing.isVisible()
        assert page.missing.title.text() == title
        assert (page.missing.button.text() if page.missing.button.isVisible() else "") == action
        calibrate.model.calibration.show(run_result())
        calibrate.refresh()
        assert all(card.isVisible() for card in page.curves)


def test_run_is_shown_by_its_kind(calibrate):
    """A run without plateaus opens in the tab of its cycles; the button of the other tab leads there too."""
    calibrate.go("Calibration")
    run = dataclasses.replace(without_readings(0), plateaus=0, path="cycles.boat")
    calibrate.model.calibration.show(run)
    assert calibrate.place == "Repeatability"
    calibrate.go("Calibration")
    calibrate.refresh()
    calibrate.pages["Calibration"].missing.button.click()
    assert (calibrate.place, calibrate.model.repeatability.result) == ("Repeatability", run)


def test_headline_counts_plateaus_readings_and_points(calibrate):
    """How many plateaus there are, were read and are in the curve."""
    calibrate.go("Calibration")
    page = calibrate.pages["Calibration"]
    for read, words in (
        (19, "19 of 37 plateaus read, all used"),
        (20, "20 of 37 plateaus read, 19 used"),
    ):
        calibrate.model.calibration.show(dataclasses.replace(run_result(), plateaus=37, read=read))
        calibrate.refresh()
        assert words in page.headline.text()
    calibrate.model.calibration.show(dataclasses.replace(run_result(), plateaus=19, read=19))
    calibrate.refresh()
    assert "19 of 19 readings used" in page.headline.text()


def test_new_analysis_clears_the_page(calibrate):
    """A run without readings, opened after one with, was shown with the curves of the other."""
    calibrate.go("Calibration")
    page, model = calibrate.pages["Calibration"], calibrate.model.calibration
    model.show(run_result())
    calibrate.refresh()
    card = page.curves[0]
    assert card.branches[0][0].x.size and page.curves[0].columns()
    whole = run_result()
    bare = without_curve(whole.sensors[0], "none was read")
    model.show(dataclasses.replace(whole, sensors=(bare, bare)))
    calibrate.refresh()
    assert not any(layer.x.size for shown in page.curves for plot in shown.plots for layer in plot.layers)
    assert page.missing.isVisible()
    assert not card.isVisible()
    model.show(run_result())
    calibrate.refresh()
    model.result = None
    model.revision += 1
    calibrate.refresh()
    assert not any(layer.x.size for layer in (*card.top.layers, *page.loops.plots[0].layers))
    assert page.table.rowCount() == 0
    assert calibrate.grab().width() == calibrate.width()  # it paints


def test_failed_analysis_shows_cause_and_remedy(calibrate):
    """In one empty state, with the way to another recording."""
    calibrate.go("Calibration")
    model, page = calibrate.model.calibration, calibrate.pages["Calibration"]
    model.failure = RequestError("x.boat is not a recording", "Choose another one.")
    model.revision += 1
    page.refresh(calibrate.model.snapshot)
    shown = page.empty.title.text(), page.empty.words.text()
    assert shown == ("\u25b2 x.boat is not a recording", "Choose another one.")
    assert page.empty.button.isVisible() and not page.verdict.isVisible()
    page.empty.button.click()
    assert calibrate.pages["Recordings"].isVisible()


def test_uncertainty_is_drawn_over_the_range(calibrate):
    """A line for each sensor; where no curve gives an elongation the card says so."""
    x = np.linspace(-2.7, 3.8, 41)
    u = tuple(np.column_stack([x, 0.06 + scale * (x + 2.7)]) for scale in (0.01, 0.02))
    calibrate.go("Calibration")
    page = calibrate.pages["Calibration"]
    calibrate.model.calibration.show(run_result(u_elongation=u))
    calibrate.refresh()
    for line, of_sensor in zip(page.uncertainty.lines, u, strict=True):
        assert line.x == pytest.approx(x)
        assert line.y == pytest.approx(of_sensor[:, 1])
    assert page.uncertainty.readout.text() == "\u2014 sensor 1  - - sensor 2"
    assert "largest over the range, of all sensors together" in page.traced.text()
    calibrate.model.calibration.show(run_result())
    calibrate.refresh()
    assert page.uncertainty.empty_text.text() == "No curve gives an elongation."
