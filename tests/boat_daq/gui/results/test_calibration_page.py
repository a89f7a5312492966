"""The Calibrate page over made-up results: curves, comparison, warnings, acceptance and its undo."""

from __future__ import annotations

import dataclasses
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication, QFileDialog

from analysis.calibration.curve_choice import CURVES, CurveCandidate
from analysis.calibration_export.verdict import Verdict, VerdictCode, VerdictState
from boat_daq.engine.snapshot import LinkState, SessionState
from boat_daq.gui import main_window
from boat_daq.gui.results.closed_readings import ClosedReadings
from boat_daq.viewmodels.results import calibration
from boat_daq.viewmodels.results.figure_tables import FSO_KEY, HYSTERESIS_KEY, RunFigure
from boat_daq.workflows.acceptance import RunVerdict
from boat_daq.workflows.jobs import JobState
from protocol.base.errors import RequestError
from protocol.base.units import STORED_UNITS, ShownUnits
from tests.boat_daq.gui.results.run_results import (
    out_of_tolerance_result,
    result_to_check,
    run_result,
    whole_in_sight,
    without_readings,
)
from tests.boat_daq.gui.windows import SAMPLE, run_shortcut


def test_previous_calibration_is_compared(live):
    """Accept one, show another run 2 mV away: the previous curve is drawn, the table has coefficients and E_n."""
    model = live.model
    live.go("Calibration")
    page = live.pages["Calibration"]
    model.calibration.show(run_result())
    live.refresh()
    assert "no earlier calibration" in page.comparison.text()
    run_shortcut(live, "Ctrl+Return")
    model.calibration.show(run_result())
    live.refresh()
    assert "no earlier calibration" in page.comparison.text()  # its own in force is none
    assert (page.verdict.text()[:10], page.accept.isEnabled()) == ("\u2713 Accepted", False)
    assert page.accept.property("role") != "primary"
    model.calibration.show(run_result(offset=2.0, recording_id="another"))
    live.refresh()
    assert page.accept.property("role") == "primary"
    assert page.coefficients.rowCount() == 10
    assert page.coefficients.item(1, 2).text() != page.coefficients.item(1, 1).text()
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


@pytest.mark.parametrize("size", [(853, 533), pytest.param((1280, 800), marks=pytest.mark.nightly)])
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
    assert page.verdict.text().startswith("\u2713 Accepted: U = 0.13 mm")
    assert page.verdict.text().endswith("out of tolerance")
    assert page.verdict.property("state") == "warning"
    assert model.unit.texts(model.snapshot)[-1].endswith(", out of tolerance")


def test_verdict_is_the_headline_and_a_reading_to_check_blocks_acceptance(live):
    """U and the range in words, amber; three ways out beside the reading; nothing is accepted before."""
    model = live.model.calibration
    live.go("Calibration")
    page = live.pages["Calibration"]
    model.show(run_result())
    live.refresh()
    assert page.verdict.text() == "\u25cf U = 0.13 mm (k = 2) from \u22122.7 to 3.8 mm"
    assert (page.detail.text(), page.detail.property("state")) == ("All 8 published limits are kept.", "")
    missed = dataclasses.replace(run_result().verdict, limits_text="5.05 % FSO, conditional fail", limits_state="check")
    model.show(dataclasses.replace(run_result(), verdict=missed))
    live.refresh()
    assert page.detail.property("state") == "warning"  # under a green headline it was said in passing
    known = Verdict(VerdictCode.USABLE, VerdictState.OK, u_mm=0.13, range_mm=(-2.7, 3.8))
    model.show(dataclasses.replace(run_result(), verdict=RunVerdict("usable", "ok", known.headline)))
    live.model.unit_choice.choose(ShownUnits.of("in"))
    live.refresh()
    assert page.verdict.text() == "\u25cf U = 0.0051 in (k = 2) from \u22120.11 to 0.15 in"
    assert page.candidates.horizontalHeaderItem(2).text() == "U, in"
    live.model.unit_choice.choose(STORED_UNITS)
    model.show(result_to_check())
    live.refresh()
    assert page.verdict.text().endswith("to 3.8 mm; 1 reading to check")
    assert page.verdict.property("state") == "warning"
    assert page.to_check.text() == "Before accepting, check +10.00 mm at +10 kPa, 9.2 mm from the others."
    for way in (page.correct, page.leave_out, page.reason, page.confirm):
        assert way.isVisible()
    assert not page.accept.isEnabled()
    with pytest.raises(RequestError, match="1 reading to check"):
        model.accept()
    confirmed = []
    model.confirm_readings = confirmed.append
    page.reason.setText("read again")
    page.confirm.click()
    assert (confirmed, page.reason.text()) == (["read again"], "")


def test_reading_left_out_is_analysed_again_and_comes_back(live, monkeypatch):
    """Truth: what is stored in the recording, and the analyses that are started, once for each change."""
    model, stored, started = live.model.calibration, [], []
    monkeypatch.setattr(calibration, "change_readings", lambda path, values: stored.append(dict(values)) or {6: 10.0})
    monkeypatch.setattr(model, "_start", started.append)
    model.last_path = Path("run.boat")
    model.show(result_to_check())
    live.go("Calibration")
    live.refresh()
    live.pages["Calibration"].leave_out.click()
    live.model.undo.undo()
    assert stored == [{6: None}, {6: 10.0}]
    assert started == [Path("run.boat")] * 2
    assert live.model.notices.current().cause == "Undone: leaving out 1 reading"
    model.show(result_to_check(step=None))
    live.refresh()
    live.pages["Calibration"].leave_out.click()
    assert "in a file" in live.model.notices.current().cause


def test_fit_is_shown_at_once_and_accepted_only_with_its_intervals(live):
    """The first result of the analysis is shown without a colour; a cancelled one leaves what was shown before."""
    model = live.model.calibration
    live.go("Calibration")
    page = live.pages["Calibration"]
    model.show(run_result())
    whole = model.result
    running = SimpleNamespace(state=JobState.RUNNING, first=None, poll=lambda: running.state, cancel=lambda: None)
    live.model.jobs.start("analysis", running, model._analysed, model._show_first)
    running.first = run_result(offset=3.0, preliminary=True)
    live.model.jobs.poll()
    live.refresh()
    assert model.result.preliminary
    assert (page.detail.text(), page.verdict.property("state")) == ("Intervals follow \u2026", "")
    assert page.curves[0].curve.x.size
    assert not page.accept.isEnabled()
    running.state = JobState.CANCELLED
    live.model.jobs.poll()
    assert model.result is whole


def test_six_figures_are_shown_and_all_on_request(live):
    """The others are behind a button, whose state is kept."""
    rows = tuple(((f"Figure {n}\nmm", ""), ("1", ""), ("2", "")) for n in range(9))
    live.go("Calibration")
    page = live.pages["Calibration"]
    live.model.calibration.show(run_result(figures=rows, key_figures=rows[:6]))
    live.refresh()
    assert page.table.rowCount() == 6
    page.figures.all.click()
    assert page.table.rowCount() == 9
    assert live.model.preferences.get("all figures results") is True
    live.resize(853, 600)  # the page scrolls there, and the table does not
    QApplication.processEvents()
    QApplication.processEvents()
    assert page.table.verticalScrollBar().maximum() == 0
    page.figures.all.click()
    for _ in range(10):
        QApplication.processEvents()
    below = page.figures.height() - page.figures.all.geometry().bottom()
    assert below < page.figures.all.height()  # nothing empty under the six


def test_loops_are_opened_and_drawn_with_the_limit(live):
    """Truth: 2 mV between the branches of a full scale of 200 mV is 1 %; the limit is where it is published."""
    made = run_result()
    signal = made.loops.signal_mv.copy()
    signal[:, 1] += 2.0
    known = dataclasses.replace(
        made.sensors[0].cycles, whole={FSO_KEY: RunFigure(200.0), HYSTERESIS_KEY: RunFigure(1.0, limit=5.0)}
    )
    sensors = tuple(dataclasses.replace(sensor, cycles=known) for sensor in made.sensors)
    loops = dataclasses.replace(made.loops, signal_mv=signal)
    live.go("Calibration")
    page = live.pages["Calibration"]
    live.model.calibration.show(dataclasses.replace(made, sensors=sensors, loops=loops))
    live.refresh()
    drawn = page.loops.curves[1].y
    assert drawn[np.isfinite(drawn)] == pytest.approx(1.0)
    assert np.isnan(drawn).sum() == made.cycles
    assert [line.value() for _, line in page.loops.limits] == [5.0, -5.0]
    assert page.loops.actuator.item not in page.loops.view.ci.items


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
    for _ in range(2):  # the first is asked for again: it is far from the others
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
    model.calibration.show(out_of_tolerance_result())  # another run: its calibration would be accepted
    assert model.notices.current() is None
    run_shortcut(live, "Ctrl+Return")
    notice = model.notices.current()
    assert notice is not None and notice.action is not None
    notice.action()
    assert model.units.of(simulated=True).load("SA1").calibration is not None


def test_last_run_of_an_earlier_start_is_analysed(live, monkeypatch):
    """After a new start "Analyse the last run" takes the recording that was written last."""
    folder = live.model.services.recordings
    live.go("Calibration")
    page = live.pages["Calibration"]
    live.refresh()
    assert page.empty.button.text() == "Go to Measure"  # there is none yet
    folder.mkdir()
    for i, name in enumerate(("b.boat", "a.boat")):
        path = folder / name
        path.touch()
        os.utime(path, ns=(i, i))
    requested: list[Path] = []
    live.model.session.change(link=LinkState.CLOSED)
    monkeypatch.setattr(live.model.calibration, "analyse", requested.append)
    looks, newest = [], live.model.calibration._newest
    monkeypatch.setattr(live.model.calibration, "_newest", lambda kind: looks.append(kind) or newest(kind))
    live.refresh()
    live.refresh()
    assert looks == [None]  # not at every picture: each looks through the folder
    assert page.empty.button.text() == "Analyse the last run"
    page.empty.button.click()
    assert requested == [folder / "a.boat"]
    live.model.session.change(state=SessionState.RUNNING)
    live.refresh()
    assert (page.empty.button.text(), "when it has ended" in page.empty.words.text()) == ("Go to Measure", True)


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
