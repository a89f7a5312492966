"""The Calibrate page over made-up results: curves, comparison, warnings, acceptance and its undo."""

from __future__ import annotations

import dataclasses
import os
import shutil
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication, QFileDialog

from analysis.calibration.curve_choice import CURVES, CurveCandidate
from boat_daq.engine.snapshot import LinkState
from boat_daq.gui import main_window
from boat_daq.gui.results.closed_readings import ClosedReadings
from tests.boat_daq.gui.results.run_results import (
    out_of_tolerance_result,
    run_result,
    whole_in_sight,
    without_readings,
)
from tests.boat_daq.gui.windows import SAMPLE, run_shortcut


def test_previous_calibration_is_compared(live):
    """Accept one, show another 2 mV away: the previous curve is drawn, the table has coefficients and E_n."""
    model = live.model
    live.go("Calibration")
    page = live.pages["Calibration"]
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
    live.go("Calibration")
    model.calibration.show(run_result())
    live.refresh()
    page = live.pages["Calibration"]
    for keys, in_force in (("Ctrl+Return", True), ("Ctrl+Z", False), ("Ctrl+Shift+Z", True)):
        run_shortcut(live, keys)
        live.refresh()
        assert (model.units.of(simulated=True).load("SA1").calibration is not None) is in_force
        assert page.accept.isEnabled() is not in_force
        assert ("calibrated 20" in live.header.unit.text()) is in_force


def test_calibration_is_exported_to_the_place_that_is_chosen(live, tmp_path, monkeypatch):
    """The button requests a place, JSON unless another suffix is given, and passes it on; without a fit it is off."""
    live.go("Calibration")
    page = live.pages["Calibration"]
    live.model.calibration.show(without_readings(3))
    live.refresh()
    assert not page.export.isEnabled()
    live.model.calibration.show(run_result())
    live.refresh()
    targets = []
    monkeypatch.setattr(live.model.calibration, "export", targets.append)
    page.export.click()
    dialog = live.findChildren(QFileDialog)[-1]
    dialog.fileSelected.emit(str(tmp_path / "calibration.h"))
    dialog.close()
    assert targets == [tmp_path / "calibration.h"]


@pytest.mark.parametrize("size", [(1280, 800), (853, 533)])
def test_missed_bounds_are_shown_beside_the_accept_button(live, size):
    """Figures, bounds and their source are visible beside a button that is not primary; acceptance is marked."""
    model = live.model
    model.unit.preparation.call = lambda *_: None  # the live conversion is not looked at here
    live.resize(*size)
    live.go("Calibration")
    page = live.pages["Calibration"]
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


def test_readings_are_corrected_in_a_panel(live, tmp_path, qtbot):
    """The panel shows a correction and its undo without being refreshed."""
    path = Path(shutil.copy(SAMPLE, tmp_path / "older.boat"))
    live.go("Calibration")
    live.model.calibration.show(out_of_tolerance_result())
    live.model.calibration.last_path = path
    live.refresh()
    live.pages["Calibration"].readings.click()
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
    live.go("Calibration")
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
    for name in ("Calibration", "Repeatability"):
        whole.go(name)
        QApplication.processEvents()
        table = whole.pages[name].table
        assert table.isVisible()
        assert table.horizontalScrollBar().maximum() == 0
        assert whole.scrolls[name].horizontalScrollBar().maximum() == 0


def test_curve_is_chosen_beside_what_each_would_be(live, monkeypatch):
    """The choice shows the curve of the run and takes another, for the report too; a row a curve, cleared with it."""
    live.go("Calibration")
    page, model, chosen = live.pages["Calibration"], live.model.calibration, []
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
