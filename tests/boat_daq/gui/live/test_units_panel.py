"""Units of the values, and extra channels among the live plots."""

from __future__ import annotations

import pytest
from PySide6.QtTest import QTest

from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.viewmodels.common.services import Tab
from protocol.recording import channels_of
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import run_command

CHANNELS = channels_of([("temperature", "degC"), ("tag", "")])


@pytest.fixture
def measured(make):
    """A window on a board with a temperature, and a field that holds no numbers."""
    return make(RecordedSession(connected(), filled_ring(60.0, channels=CHANNELS)))


def labels(plot) -> list[str]:
    """Return title and labels of the left axis."""
    _, values, _ = plot.left._ticks()
    return [plot.left.labelText, *plot.left.tickStrings(values, 1.0, plot.left._ticks()[0])]


def draw(window) -> None:
    """Show the newest values and a frame."""
    window.refresh()
    window.draw()


def choose(panel, quantity: str, unit: str) -> None:
    """Choose a unit as the mouse does."""
    box = panel.units[quantity]
    box.setCurrentIndex(box.findData(unit))
    box.activated.emit(box.currentIndex())


def test_channels_and_chosen_units_of_the_live_page(measured):
    """A channel has its plot and statistics; bar, V, °F and % are in every plot of a run; stored values keep theirs."""
    window, plots, model = measured, measured.live.plots, measured.model.live
    window.resize(1280, 1400)
    draw(window)
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Sensor 2", "Pressure", "Temperature"]
    assert labels(plots.rows[-1])[0] == "Temperature (\u00b0C)"
    assert model.text("temperature_degc", 21.456) == "21.46 \u00b0C"
    model.cursors_s.update(a=10.0, b=50.0)
    assert [(span.name, span.unit) for span in model.statistics()][-1] == ("Temperature", "\u00b0C")
    before = model.headline(window.model.snapshot)
    run_command(window, "Units of the values …")
    panel = window.units_panel
    for quantity, unit in (("pressure", "bar"), ("voltage", "V"), ("temperature", "degF"), ("length", "%")):
        choose(panel, quantity, unit)
    draw(window)
    signal, _, pressure, temperature = plots.rows
    assert [labels(plot)[0] for plot in (signal, pressure, temperature)] == [
        "Sensor 1 (V)", "Pressure (bar)", "Temperature (\u00b0F)",
    ]  # fmt: skip
    assert {float(text.replace("\u2212", "-")) for text in labels(pressure)[1:]} >= {0.0, 0.4}
    number = float(before.signals[0].replace("\u2009", ""))
    assert float(model.headline(window.model.snapshot).signals[0]) == pytest.approx(number / 1000, abs=1e-4)
    assert window.live.figures["kpa"].unit.text() == "bar"
    assert model.means()["s1_mv"] == pytest.approx(number, abs=0.06)
    assert model.text("temperature_degc", 20.0) == "68.00 \u00b0F"
    pages = [window.open_page(page).findChildren(PlotCard)[0] for page in (Tab.REPEATABILITY, Tab.OPTICS)]
    assert [card.theme.units.pressure for card in pages] == ["bar", "kPa"]
    panel.length.setText("50")
    QTest.keyClick(panel.length, "\r")
    shown = model.units.shown("mm")
    assert (shown.symbol, shown.value(1.0), window.model.unit_choice.units.voltage) == ("%", 2.0, "V")
    panel.length.setText("-3")
    QTest.keyClick(panel.length, "\r")
    assert "length at rest" in window.model.notices.current().cause
    assert panel.length.text() == "50"
