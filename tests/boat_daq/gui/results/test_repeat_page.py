"""The Repeat page over made-up results: cycles, interruptions, what is missing."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from boat_daq.viewmodels.results.figure_tables import BreakResult
from boat_daq.workflows.jobs import JobFailure, JobState
from tests.boat_daq.gui.results.run_results import CYCLES, run_result
from tests.boat_daq.gui.windows import NARROW


def test_every_cycle_and_interruption_is_drawn(live):
    """Eight points in each plot; a line at the break and the tests in their own tab; gone with the next run."""
    rows = (("Sensor 1: span (mV)", "256 (n = 4)", "251 (n = 4)", "▲ 0.0004", "0.3"),)
    broken = run_result(breaks=(BreakResult(4.5, "the run was broken after 4 cycles (interrupted)", rows),))
    live.go("Repeat")
    page = live.pages["Repeat"]
    live.model.repeatability.show(broken)
    live.refresh()
    for card in (page.hysteresis, page.sensitivity, page.snr):
        assert card.sensors[0].x.tolist() == list(range(1, CYCLES + 1))
    assert page.sensitivity.plot.unit == "mV/kPa"
    assert {line.value() for _, line in page.break_lines} == {4.5}
    assert page.tabs.count() == 2
    assert page.tests.item(0, 3).text() == "▲ 0.0004"
    assert "broken after 4 cycles" in page.break_texts.text()
    live.model.repeatability.show(dataclasses.replace(broken, breaks=()))
    live.refresh()
    assert (page.break_lines, page.tabs.count()) == ([], 1)


@pytest.mark.parametrize("width", [1280, NARROW])
def test_what_the_run_has_reached_is_shown_in_a_line(live, width):
    """Whole at both widths; without an interval no space is left for it."""
    live.resize(width, 800)
    live.go("Repeat")
    page = live.pages["Repeat"]
    live.model.repeatability.show(run_result(drift_half=0.42, spread_half=0.13))
    live.refresh()
    assert page.known.text().endswith("drift ±0.42 % FSO per 100 cycles, repeatability ±0.13 % FSO")
    assert page.known.width() >= page.known.fontMetrics().horizontalAdvance(page.known.text())
    live.model.repeatability.show(run_result())
    live.refresh()
    assert page.known.isHidden()


@pytest.mark.parametrize("sensors", [1, 3, 4])
def test_every_sensor_is_drawn(live, sensors):
    """One to four sensors: a loop plot and a symbol each; those of the run before are gone."""
    whole = run_result()
    live.go("Repeat")
    page, (first, *_) = live.pages["Repeat"], whole.sensors
    live.model.repeatability.show(whole)
    live.refresh()
    loops = dataclasses.replace(whole.loops, signal_mv=(whole.loops.signal_mv[0],) * sensors)
    live.model.repeatability.show(dataclasses.replace(whole, sensors=(first,) * sensors, loops=loops))
    live.refresh()
    drawn = [plot for plot in page.loops.plots if plot.item in page.loops.view.ci.items]
    assert [plot.title for plot in drawn] == [f"Sensor {n}" for n in range(1, sensors + 1)]
    assert all(group[0].x.size for group in page.loops.groups[:sensors])
    assert [points.x.size for points in page.snr.sensors] == [CYCLES * (n < sensors) for n in range(4)]
    assert page.snr.readout.text().split() == ["●", "1", "■", "2", "▲", "3", "◆", "4"][: 2 * sensors]


def test_missing_cycles_are_shown_in_place_of_the_plots(live):
    """No run, a run without a complete cycle, one that cannot be read: text and the next step, no empty axes."""
    app_model, model = live.model, live.model.repeatability
    live.go("Repeat")
    page = live.pages["Repeat"]
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
    """Without hysteresis in any cycle a text replaces its plot; the others are drawn."""
    live.go("Repeat")
    page = live.pages["Repeat"]
    whole = run_result()
    none = dataclasses.replace(whole.sensors[0].cycles, hysteresis_percent_fso=np.full(CYCLES, np.nan))
    sensors = tuple(dataclasses.replace(s, cycles=none) for s in whole.sensors)
    live.model.repeatability.show(dataclasses.replace(whole, sensors=sensors))
    live.refresh()
    assert (page.hysteresis.view.isVisible(), page.hysteresis.empty_text.isVisible()) == (False, True)
    assert page.snr.view.isVisible()
