"""The window of a run's dynamics: step response, Bode plot, figures; where there is none, its reason."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtTest import QTest

from analysis.elongation_control.dynamic_figures import BodePoint, DynamicCalibration, DynamicFigure
from boat_daq.gui import style
from boat_daq.gui.results.dynamics_window import STEP_COLOURS, DynamicsWindow
from boat_daq.viewmodels.common.tolerance import tolerance_choice
from boat_daq.viewmodels.results.dynamics import SUGGESTED

FIGURES = {
    name: DynamicFigure(0.42, 0.40, 0.44) for name in ("time_constant_s", "rise_s", "settling_s", "overshoot_percent")
}
BODE = (BodePoint(0.5, -0.2, -20.0, 0.05, 1.0), BodePoint(1.0, -4.0, -60.0, 0.1, 2.0))
EDGE, NONE = DynamicFigure(0.87, 0.86, 0.88), DynamicFigure(*[float("nan")] * 3)
RESPONSE = np.array([[0.0, 1.0], [0.0, 1.02]])
FOUND = DynamicCalibration("SA1", True, "steps.boat", 0.05, {1.0: FIGURES}, BODE, EDGE, {1.0: RESPONSE})


@pytest.fixture
def window_of(live, tmp_path):
    """Return what makes the window of a result; windows are closed at the end."""
    windows, settled = [], []

    def make(found: DynamicCalibration | None, failed: str = "") -> DynamicsWindow:
        live.go("Recordings")
        settling = tolerance_choice(live.model.services, "the tolerance of settling", SUGGESTED, settled.append)
        path, report = tmp_path / "steps.boat", lambda target: None
        model = SimpleNamespace(found=found, failed=failed, path=path, report=report, settling=settling)
        windows.append(DynamicsWindow(live, model, live.model.services, live.pages["Recordings"].history))
        windows[-1].show()
        windows[-1].timerEvent()
        return windows[-1]

    yield make
    for window in windows:
        window.close()


def test_steps_and_sines_are_shown_with_their_figures(window_of):
    """The gain is drawn over the logarithm of the frequency, and saved over the frequency itself."""
    window = window_of(FOUND)
    assert window.verdict.text().startswith("Settles to within 0.05 mm in 0.42 s or less")
    assert not window.simulated.isHidden()
    assert window.save.isEnabled()
    curve = window.bode.layers[0][1]
    assert curve.x == pytest.approx(np.log10([0.5, 1.0]))
    assert curve.y.tolist() == [-0.2, -4.0]
    columns = window.bode.columns()
    assert columns["Frequency (Hz)"] == pytest.approx([0.5, 1.0])
    assert columns["U of the phase (\u00b0)"].tolist() == [2.0, 4.0]
    assert window.steps.plots[0].layers[0].y.tolist() == [0.0, 102.0]
    assert "1 mm" in window.legend.text().replace("\u00a0", " ")
    assert window.step_table.item(0, 1).text() == "0.420 \u00b1 0.020"
    assert window.bode_table.item(1, 1).text() == "\u22124.00 \u00b1 0.20"
    assert window.bode_table.horizontalHeaderItem(1).text() == "Gain, dB"
    window.settling.setEditText("0.02 mm")
    window.settling.typed.editingFinished.emit()
    assert window.model.settling.value == SUGGESTED[0]
    window.model.found = replace(FOUND, tolerance_mm=0.02)
    window.timerEvent()
    assert window.verdict.text().startswith("Settles to within 0.02 mm")
    assert len(window.steps.plots[0].layers) == 1


def test_steps_of_four_sizes_are_all_in_sight_in_colours_of_their_own(window_of):
    """No size is scrolled away in a window of the first size, and no two have one colour, light or dark."""
    sizes = (0.5, 1.0, 2.0, 3.0)
    window = window_of(replace(FOUND, steps=dict.fromkeys(sizes, FIGURES), responses=dict.fromkeys(sizes, RESPONSE)))
    table = window.step_table
    QTest.qWait(50)
    assert not table.verticalScrollBar().isVisible()
    assert table.rowViewportPosition(3) + table.rowHeight(3) <= table.viewport().height()
    for theme in (style.LIGHT, style.DARK):
        seen = [style.colour(one(theme)) for one in STEP_COLOURS]
        apart = [abs(a.hue() - b.hue()) for a, b in combinations(seen, 2)]
        assert min(min(one, 360 - one) for one in apart) > 25


def test_a_run_without_sines_has_no_bode_plot(window_of):
    """What was not run is left out; a band that is not reached is said to be beyond the highest sine."""
    steps = window_of(replace(FOUND, bode=(), bandwidth_hz=NONE))
    assert steps.bode.isHidden()
    assert not steps.steps.isHidden()
    sines = window_of(replace(FOUND, steps={}, responses={}, bandwidth_hz=NONE))
    assert sines.steps.isHidden()
    assert sines.verdict.text() == "Bandwidth above 1 Hz: \u22123 dB is not reached"


def test_a_failure_is_shown_and_nothing_can_be_saved(window_of):
    window = window_of(None, "unit SA1 has no accepted calibration")
    assert window.verdict.text() == "unit SA1 has no accepted calibration"
    assert not window.save.isEnabled()
