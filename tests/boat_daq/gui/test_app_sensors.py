"""Boards with one to four sensors over a real port: connect, live page, plan with readings, calibration, commands."""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import SessionState
from boat_daq.viewmodels.common.services import Page, Tab
from boat_daq.viewmodels.live.connection import VirtualBoardProcess
from boat_daq.viewmodels.results.run_result import analyse_run
from boat_daq.workflows.acceptance import confirm_readings
from boat_daq.workflows.run_session import SessionRequest, run_session
from protocol.simulator.truth import noise_free_run, truth_figures
from tests.boat_daq.commands.calls import call
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.boat_daq.gui.windows import PATIENCE_MS, Grid, close_all

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

RAMP_KPA_PER_S, DWELL_S, TICK_S = 20.0, 2.0, 0.005
SHORT = dataclasses.replace(
    built_in_plans()["calibration"],
    cycles=1,
    step_kpa=22.5,
    ramp_kpa_per_s=RAMP_KPA_PER_S,
    min_dwell_s=DWELL_S,
    settling_s=0.5,
)
ONE_TO_FOUR = [4, *(pytest.param(sensors, marks=pytest.mark.nightly) for sensors in (1, 2, 3))]


class TruthGrid(Grid):
    """The grid of a board in this process, to 0.1 mm."""

    def __init__(self, truth: Path) -> None:
        super().__init__(None)
        self._truth = truth

    def grid_mm(self):
        return VirtualBoardProcess.grid_mm(SimpleNamespace(_truth=self._truth), 0.1)


@pytest.fixture
def window(qtbot, tmp_path):
    """A window on a session of its own."""
    from boat_daq.gui.app import make_application, window_on
    from boat_daq.viewmodels.app_model import AppModel

    make_application()
    model = AppModel(Session(), tmp_path / "config", tmp_path / "recordings", UnitLibrary(tmp_path / "units"))
    model.shadow.prepare = lambda: None
    shown = window_on(model)
    shown.resize(1280, 800)
    shown.show()
    yield shown
    close_all([shown])


def sensitivities(unit):
    """The true sensitivities of a unit over the plan."""
    cycle = (50.0, *SHORT.targets_kpa)
    truth = truth_figures(unit, cycle_kpa=cycle, ramp_kpa_per_s=RAMP_KPA_PER_S, dwell_s=DWELL_S)
    return [sensor.sensitivity_mv_per_mm for sensor in truth.sensors]


@pytest.mark.parametrize("sensors", ONE_TO_FOUR)
def test_board_is_calibrated_in_the_window(window, qtbot, tmp_path, sensors):
    """Every sensor has its value, plot, overlay, curve, loop and figures, near the truth."""
    unit, truth, model, live = f"SA1x{sensors}", tmp_path / "truth.csv", window.model, window.live
    with serve_in_thread(BoardSettings(port="pty", speed=100.0, unit=unit, truth=str(truth))) as board:
        model.connection.connect(board.url)
        qtbot.waitUntil(lambda: model.connected() and model.live.has_data(), timeout=PATIENCE_MS)
        window.refresh()
        window.draw()
        for timer in (window.frame_timer, window.calm_timer):
            timer.stop()
        shown = [figure for name, figure in live.figures.items() if name.startswith("s") and figure.isVisible()]
        assert [figure.value.text() != "\u2013" for figure in shown] == [True] * sensors
        titles = [*(f"Sensor {n}" for n in range(1, sensors + 1)), "Pressure"]
        qtbot.waitUntil(lambda: window.draw() or [plot.title for plot in live.plots.rows] == titles)
        model.connection.board = TruthGrid(truth)
        model.run.begin(SHORT)
        model.run.read_all = True
        until = time.monotonic() + PATIENCE_MS / 1000
        while model.tick().state is not SessionState.IDLE:  # often: at this speed a reading that waits costs minutes
            assert time.monotonic() < until
            time.sleep(TICK_S)
        live.toggle_overlay()
        window.refresh()
        assert [curves[-1].x.size > 0 for curves in live.overlay.curves[:sensors]] == [True] * sensors
        path = model.session.stop_recording()
        result = analyse_run(path)  # as a helper process does
        if confirm_readings(result, "read by the test rig"):  # the lowest level of one cycle is read once
            result = analyse_run(path)
        model.calibration.show(result)
        window.go(Tab.CALIBRATION)
        window.refresh()
        page = window.pages[Tab.CALIBRATION]
        curves = [card for card in page.curves if card.isVisible()]
        assert [card.curve.x.size > 0 for card in curves] == [True] * sensors
        assert (len(page.loops.curves), page.table.columnCount()) == (sensors, 1 + sensors)
        found = [sensor.record.figures["sensitivity_mv_per_mm"] for sensor in result.sensors]
        assert found == pytest.approx(sensitivities(unit), rel=0.03)
        model.calibration.accept()
        window.go(Page.MEASURE)
        elongation = at_rest(window, qtbot)  # inverse of one sensor, fused from more
    assert elongation == pytest.approx(0.0, abs=0.5)
    model.repeatability.show(result)
    window.go(Tab.REPEATABILITY)
    window.refresh()
    assert window.pages[Tab.REPEATABILITY].table.columnCount() == 1 + sensors
    assert (window.guard._covers, live.guard._covers) == ({}, {})


def at_rest(window, qtbot) -> float:
    """Wait for the elongation of the live page with the unit at rest, mm."""

    def shown() -> bool:
        window.refresh()
        window.draw()
        return text() not in ("\u2013", "")

    def text() -> str:
        return window.live.figures["mm"].value.text().replace("\u2212", "-")

    qtbot.waitUntil(shown, timeout=PATIENCE_MS)
    return float(text())


@pytest.mark.nightly
@pytest.mark.parametrize("sensors", [1, 2, 3, 4])
def test_board_is_calibrated_by_the_commands(tmp_path, sensors):
    """Recorded over its port and analysed with true readings: the sensitivity of each sensor, and a report."""
    unit, path = f"SA1x{sensors}", tmp_path / "run.boat"
    with serve_in_thread(BoardSettings(port="pty", speed=100.0, unit=unit)) as board:
        run_session(SessionRequest(board.url, path, SHORT, unit=unit))
    targets = (50.0, *SHORT.targets_kpa)
    run = noise_free_run(unit, targets, ramp_kpa_per_s=RAMP_KPA_PER_S, dwell_s=DWELL_S)
    pressure, elongation, _ = run.holds(0.5, DWELL_S)
    rows = "\n".join(f"{kpa:.3f},{mm:.3f}" for kpa, mm in zip(pressure, elongation, strict=True))
    readings = tmp_path / "readings.csv"
    readings.write_text(f"pressure_kpa,elongation_mm\n{rows}\n", encoding="utf-8")
    printed = call("analyze", path, "--elongation", readings, "--no-mcmc")
    found = [sensor["sensitivity_mv_per_mm"] for sensor in printed["sensors"]]
    assert found == pytest.approx(sensitivities(unit), rel=0.01)
    call("report", path, "--out", tmp_path / "run.html")
    assert f"Sensor {sensors}" in (tmp_path / "run.html").read_text(encoding="utf-8") or sensors == 1


@pytest.mark.nightly
@pytest.mark.parametrize("sensors", [1, 3, 4])
def test_hundred_cycles_have_their_figures(tmp_path, sensors):
    """The repeatability plan over a port at a hundred times real time: every cycle, every sensor, every file."""
    unit, path = f"SA1x{sensors}", tmp_path / "run.boat"
    plan = built_in_plans()["repeatability"]
    with serve_in_thread(BoardSettings(port="pty", speed=100.0, unit=unit)) as board:
        run_session(SessionRequest(board.url, path, plan, unit=unit))
    printed = call("analyze", path, "--no-mcmc")
    assert printed["cycles"]["complete"] == plan.cycles == 100
    assert [sensor["name"] for sensor in printed["sensors"]] == [f"s{n}" for n in range(1, sensors + 1)]
    assert all(0.0 < sensor["repeatability_percent_fso"] < 1.0 for sensor in printed["sensors"])
    assert call("verify", path)["identical"]
    call("report", path, "--out", tmp_path / "run.pdf")
    call("export", path, "--format", "csv", "--out", tmp_path / "run.csv")
    assert f"s{sensors}_dark" in (tmp_path / "run.json").read_text(encoding="utf-8")
