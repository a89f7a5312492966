"""The window of a unit: curves, dates, table, proposal; without a calibration the reason."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from boat_daq.engine.settings import Unit
from boat_daq.gui.plotting.plot import Curve
from boat_daq.gui.results.unit_window import CURVES_TITLE, DIFFERENCES, UNCERTAINTY_TITLE, UnitWindow
from boat_daq.workflows.unit_history import unit_over_time
from tests.boat_daq.viewmodels.results.units import unit


def window_of(live, found) -> UnitWindow:
    """Return the window of what was read."""
    model = SimpleNamespace(
        found=found, failed="", title="SA1  SIMULATED", name="SA1", units=SimpleNamespace(simulated=True),
        report=lambda target: None,
    )  # fmt: skip
    live.go("Recordings")
    window = UnitWindow(live, model, live.model.services, live.pages["Recordings"].compare_card)
    assert {card.empty_text.text() for card in window.cards.values()} == {"Loading \u2026"}
    window.timerEvent()
    return window


def test_unit_is_shown_over_time(live):
    """Three calibrations of two sensors: a curve each, 2 and 4 mV off the first, dates, six lines, a proposal."""
    window = window_of(live, unit_over_time(unit(0.0, 2.0, 4.0)))
    assert window.windowTitle() == "SA1  SIMULATED over time"
    drawn = [layer for layer in window.cards[CURVES_TITLE].plots[0].layers if isinstance(layer, Curve)]
    assert len(drawn) == 3
    apart = [layer.y.mean() for layer in window.cards[DIFFERENCES].plots[0].layers if isinstance(layer, Curve)]
    assert apart == pytest.approx([0.0, 2.0, 4.0], abs=1e-6)
    assert window.cards[UNCERTAINTY_TITLE].plots[0].layers[0].x.tolist() == [0.0, 60.0, 120.0]
    assert window.table.rowCount() == 6
    assert not window.simulated.isHidden()
    assert window.due.text().startswith("Due again 2026")
    assert all(card.empty_text.isHidden() for card in window.cards.values())
    assert window.sensor.count() == 2
    window.sensor.setCurrentIndex(1)
    assert window.save.isEnabled()
    window.close()


def test_unit_without_calibration_shows_the_reason(live):
    """No plot, no report; without a chosen line the button is grey, and says why."""
    window = window_of(live, unit_over_time(Unit("SA1")))
    assert window.due.text() == "SA1 has no accepted calibration yet"
    assert not window.save.isEnabled()
    window.close()
    page = live.pages["Recordings"]
    page.units.clearSelection()
    page._enable()
    assert not page.over_time.isEnabled()
    assert "Choose a line" in page.over_time.accessibleDescription()
