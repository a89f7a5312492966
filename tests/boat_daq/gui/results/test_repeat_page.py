"""The Repeat page over made-up results: cycles, interruptions, what is missing."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtWidgets import QLabel

from boat_daq.viewmodels.results.figure_tables import DRIFT_KEY, HYSTERESIS_KEY, SNR_KEY, BreakResult, RunFigure
from boat_daq.workflows.jobs import JobFailure, JobState
from tests.boat_daq.gui.results.run_results import CYCLES, USABLE, run_result
from tests.boat_daq.gui.windows import NARROW
from tests.conftest import mostly_at_night


def choose(page, name):
    """Choose a figure as the operator does."""
    page.figure.setCurrentIndex(page.figure.findText(name))
    page.figure.activated.emit(page.figure.currentIndex())


def test_one_plot_shows_a_figure_of_every_cycle_with_its_run(live):
    """Eight points, the figure of the run with its band, and the limit inside the plot; why single cycles are above."""
    whole = {
        HYSTERESIS_KEY: RunFigure(4.97, 4.9, 5.04, 5.0, "\u2264"), DRIFT_KEY: RunFigure(0.5, 0.4, 0.6),
        SNR_KEY: RunFigure(44.5, 44.0, 45.0, 60.0, "\u2265"), "fso_mv": RunFigure(250.0),
    }  # fmt: skip
    ends = np.array([np.linspace(-0.02, 0.02, CYCLES), np.linspace(-0.03, 0.03, CYCLES)])
    made = run_result()
    known = dataclasses.replace(made.sensors[0].cycles, whole=whole, ends=ends, lift_percent_fso=0.23)
    live.go("Repeatability")
    page = live.pages["Repeatability"]
    live.model.repeatability.show(
        dataclasses.replace(made, sensors=(dataclasses.replace(made.sensors[0], cycles=known),))
    )
    live.refresh()
    assert (page.verdict.text(), page.verdict.property("state")) == ("\u25cf All 8 published limits are kept", "ok")
    missed = dataclasses.replace(USABLE, limits_text="hysteresis: 5.05 % FSO, conditional fail", limits_state="check")
    live.model.repeatability.result = dataclasses.replace(live.model.repeatability.result, verdict=missed)
    live.model.repeatability.revision += 1
    live.refresh()
    assert QLabel.text(page.verdict).endswith("Hysteresis: 5.05\u00a0%\u00a0FSO, conditional fail")  # as it is drawn
    assert live.model.repeatability.verdict()[0] == "warning"  # of the limits, however usable the calibration is
    card = page.card
    cycles = list(range(1, CYCLES + 1))
    assert (card.sensors[0].x.tolist(), card.low_ends[0].x.tolist()) == (cycles, cycles)
    assert card.lines[0].y == pytest.approx(0.005 * (np.array(cycles) - 4.5))
    assert (card.plot.title, card.plot.unit) == ("From the mean", "% FSO")
    assert card.note.text().endswith("lowest level. Line and band: drift with its 95 % interval.")
    choose(page, "Hysteresis")
    assert (card.lines[0].y[0], card.bands[0].low[0], card.bands[0].y[0]) == (4.97, 4.9, 5.04)
    assert [mark.value() for mark in card.marks] == [5.0]
    assert card.low_ends[0].x.size == 0
    assert card.note.text().startswith(
        "Points: single cycles, made wider by noise, sensor 1 by 0.23 % FSO. Line and band"
    )
    choose(page, "SNR")
    low, high = card.plot.item.getViewBox().viewRange()[1]
    assert low < 44.0 < 60.0 < high
    choose(page, "Loops by cycle")
    assert page.loops.isVisible()
    assert [line.value() for _, line in page.loops.limits] == [5.0, -5.0]


def test_interruption_is_drawn_and_tested(live):
    """A line at the break and the tests in their own tab; gone with the next run."""
    rows = (("Sensor 1: span (mV)", "256 (n = 4)", "251 (n = 4)", "▲ 0.0004", "0.3"),)
    broken = run_result(breaks=(BreakResult(4.5, "the run was broken after 4 cycles (interrupted)", rows),))
    live.go("Repeatability")
    page = live.pages["Repeatability"]
    live.model.repeatability.show(broken)
    live.refresh()
    choose(page, "Sensitivity")
    assert (page.card.plot.unit, page.card.note.text()) == ("mV/kPa", "Points: cycles.")  # the run has no such figure
    assert [mark.value() for mark in page.card.marks] == [4.5]
    assert page.tabs.count() == 2
    assert page.tests.item(0, 3).text() == "▲ 0.0004"
    assert "broken after 4 cycles" in page.break_texts.text()
    live.model.repeatability.show(dataclasses.replace(broken, breaks=()))
    live.refresh()
    assert (page.card.marks, page.tabs.count()) == ([], 1)


@pytest.mark.parametrize("width", mostly_at_night(NARROW, 1280))
def test_what_the_run_has_reached_is_shown_in_a_line(live, width):
    """Whole at both widths; without an interval no space is left for it."""
    live.resize(width, 800)
    live.go("Repeatability")
    page = live.pages["Repeatability"]
    live.model.repeatability.show(run_result(drift_half=0.42, spread_half=0.13))
    live.refresh()
    assert page.known.text().endswith("drift ±0.42 % FSO per 100 cycles, repeatability ±0.13 % FSO")
    assert page.known.width() >= page.known.fontMetrics().horizontalAdvance(page.known.text())
    live.model.repeatability.show(run_result())
    live.refresh()
    assert page.known.isHidden()


@pytest.mark.parametrize("sensors", mostly_at_night(4, 1, 3))
def test_every_sensor_is_drawn(live, sensors):
    """One to four sensors: a loop plot and a symbol each; those of the run before are gone."""
    whole = run_result()
    live.go("Repeatability")
    page, (first, *_) = live.pages["Repeatability"], whole.sensors
    live.model.repeatability.show(whole)
    live.refresh()
    loops = dataclasses.replace(whole.loops, signal_mv=(whole.loops.signal_mv[0],) * sensors)
    live.model.repeatability.show(dataclasses.replace(whole, sensors=(first,) * sensors, loops=loops))
    live.refresh()
    choose(page, "SNR")
    assert [points.x.size for points in page.card.sensors] == [CYCLES * (n < sensors) for n in range(4)]
    marks = ["● sensor 1", "■ sensor 2", "▲ sensor 3", "◆ sensor 4"]
    assert page.card.readout.text().split("  ") == marks[:sensors]
    choose(page, "Loops by cycle")
    drawn = [plot for plot in page.loops.plots if plot.item in page.loops.view.ci.items]
    assert [plot.title for plot in drawn] == [f"Sensor {n}" for n in range(1, sensors + 1)]
    assert all(group[0].x.size for group in page.loops.groups[:sensors])


def test_missing_cycles_are_shown_in_place_of_the_plots(live):
    """No run, a run without a complete cycle, one that cannot be read: text and the next step, no empty axes."""
    app_model, model = live.model, live.model.repeatability
    live.go("Repeatability")
    page = live.pages["Repeatability"]
    live.refresh()
    assert page.missing.title.text() == "No repeatability run yet"
    model.show(dataclasses.replace(run_result(), cycles=0, partial=1))
    live.refresh()
    assert page.missing.isVisible()
    assert page.missing.title.text() == "run.boat has no complete cycle"
    model.show(run_result())
    live.refresh()
    assert not page.missing.isVisible()
    model._analysed(SimpleNamespace(state=JobState.FAILED, failure=JobFailure("damaged", "Recover it.", "")))
    live.refresh()
    assert (page.missing.isVisible(), page.missing.words.text()) == (True, "damaged. Recover it.")
    page.missing.button.click()
    assert app_model.sequence.plan.name == "repeatability"


def test_figure_without_cycles_is_shown_as_text(live):
    """Without hysteresis in any cycle a text replaces the plot; another figure is drawn."""
    live.go("Repeatability")
    page = live.pages["Repeatability"]
    whole = run_result()
    none = dataclasses.replace(whole.sensors[0].cycles, hysteresis_percent_fso=np.full(CYCLES, np.nan))
    sensors = tuple(dataclasses.replace(s, cycles=none) for s in whole.sensors)
    live.model.repeatability.show(dataclasses.replace(whole, sensors=sensors))
    live.refresh()
    choose(page, "Hysteresis")
    assert (page.card.view.isVisible(), page.card.empty_text.isVisible()) == (False, True)
    assert (page.card.note.text(), page.card.readout.text()) == ("", "")  # nothing is drawn
    choose(page, "SNR")
    assert page.card.view.isVisible()
    live.model.repeatability.show(dataclasses.replace(whole, cycles=1))
    choose(page, "Drift")
    assert (page.card.view.isVisible(), page.card.empty_text.text()) == (
        False,
        "One cycle has no drift. Run two or more.",
    )
