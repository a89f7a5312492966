"""The Calibrate and Repeat pages over results made by hand: what is drawn, what stands beside it, what is undone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from analysis.calibration import fit_calibration
from boat_daq.viewmodels.figures import FigureText
from boat_daq.viewmodels.results import (
    BreakResult,
    CycleFigures,
    LoopSet,
    PosteriorResult,
    RunResult,
    SensorResult,
)
from tests.gui.test_manners import run_shortcut

CYCLES = 8
X = np.linspace(-2.7, 3.8, 19)
GRID = np.linspace(-2.7, 3.8, 161)


def sensor(number: int, offset: float = 0.0) -> SensorResult:
    """A cubic with a little scatter."""
    y = 1650 + offset + 40 * X - 2 * X**2 + 0.5 * np.cos(7 * X)
    fit = fit_calibration(X, y)
    each = np.linspace(0.0, 1.0, CYCLES)
    cycles = CycleFigures(5 + each, 44 + each, 2.8 + 0.01 * each, "mV/kPa", 0)
    content = {"name": f"s{number}", "fit": fit.as_json(), "elongation_mm": X.tolist(), "signal_mv": y.tolist()}
    return SensorResult(
        f"s{number}_mv", "", {}, cycles, X, y, fit.residuals, X > 0, np.ones(X.size, np.int64), GRID,
        fit.predict(GRID), fit.band(GRID, 0.68), fit.band(GRID, 0.95), content | {"figures": {}}, (),
    )  # fmt: skip


def result(offset: float = 0.0, **more) -> RunResult:
    """A run of two sensors and eight cycles."""
    level = np.linspace(-40.0, 50.0, 10)
    pressure = np.broadcast_to(level, (2, CYCLES, 10))
    loops = LoopSet(tuple(range(1, CYCLES + 1)), level, pressure, None, np.stack([1650 + 3 * pressure] * 2))
    nothing = FigureText("", "")
    return RunResult(
        "run.boat", "SA1", "2026-01-01", True, "staircase", 100.0, CYCLES, 0,
        (sensor(1, offset), sensor(2, offset)), (), nothing, nothing, loops, (), 0.14, **more,
    )  # fmt: skip


def test_the_last_calibration_stands_beside_this_one(live):
    """Accept one, look at another 2 mV away: its curve is drawn, the coefficients and E_n stand in the table."""
    desk = live.desk
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    desk.calibration.show(result())
    live.refresh()
    assert "no earlier calibration" in page.comparison.text()
    run_shortcut(live, "Ctrl+Return")
    desk.calibration.accepted = None
    desk.calibration.show(result(offset=2.0))
    live.refresh()
    assert page.beside.rowCount() == 8
    assert page.beside.item(0, 2).text() != page.beside.item(0, 1).text()
    assert "▲ differs" in page.comparison.text()
    card = page.curves[0]
    assert card.apart.y == pytest.approx(-2.0, abs=1e-6)
    assert card.before.y == pytest.approx(card.curve.y - 2.0, abs=1e-3)


def test_an_acceptance_is_undone_by_a_key(live):
    """Ctrl+Return stores and uses it, Ctrl+Z takes it out of force, Ctrl+Shift+Z puts it back."""
    desk = live.desk
    live.go("Calibrate")
    desk.calibration.show(result())
    live.refresh()
    page = live.pages["Calibrate"]
    for keys, in_force in (("Ctrl+Return", True), ("Ctrl+Z", False), ("Ctrl+Shift+Z", True)):
        run_shortcut(live, keys)
        live.refresh()
        assert (desk.units.load("SA1").calibration is not None) is in_force
        assert page.accept.isEnabled() is not in_force
        assert ("calibrated 20" in live.header.unit.text()) is in_force


def test_curve_and_bands_are_of_the_posterior_once_it_is_there(live):
    """The mean with both of its bands; without a posterior the fit's own."""
    live.go("Calibrate")
    live.desk.calibration.show(result())
    live.refresh()
    card = live.pages["Calibrate"].curves[0]
    assert card.readout.text().endswith("fit")
    assert not card.wide.item.isVisible()
    fit = card.curve.y
    found = [
        PosteriorResult(GRID, fit + 3, (fit + 2, fit + 4), (fit, fit + 6), (fit - 5, fit + 9),
                        {"converged": True, "n_eff": 9000.0, "acceptance": 0.4})
    ] * 2  # fmt: skip
    live.desk.calibration.posterior = tuple(found)
    live.desk.calibration.revision += 1
    live.refresh()
    assert card.readout.text().endswith("posterior")
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
    live.desk.repeatability.show(broken)
    live.refresh()
    for card in (page.hysteresis, page.sensitivity, page.snr):
        assert card.sensors[0].x.tolist() == list(range(1, CYCLES + 1))
    assert page.sensitivity.plot.unit == "mV/kPa"
    assert {line.value() for _, line in page.break_lines} == {4.5}
    assert page.tabs.count() == 2
    assert page.tested.item(0, 3).text() == "▲ 0.0004"
    assert "broken after 4 cycles" in page.broken.text()
    live.desk.repeatability.show(dataclasses.replace(broken, breaks=()))
    live.refresh()
    assert (page.break_lines, page.tabs.count()) == ([], 1)
