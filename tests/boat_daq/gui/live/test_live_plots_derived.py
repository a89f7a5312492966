"""Derived channels in the window: their plots, values, statistics, and the panel that defines them."""

from __future__ import annotations

from boat_daq.engine.derived_store import load_derived
from boat_daq.gui.widgets.text_dialog import TextDialog
from protocol.recording import DerivedColumns, channel_units, parse_definition
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import run_shortcut


def test_the_panel_takes_definitions_and_names_what_it_refuses(live, tmp_path, monkeypatch):
    """A line that is refused leaves the panel open and the stored definitions as they were."""
    monkeypatch.setattr("boat_daq.engine.derived_store.home", lambda: tmp_path)  # else later sessions would have them
    run_shortcut(live, "Ctrl+Alt+H")
    dialog = live.findChild(TextDialog)
    dialog.field.setPlainText("ratio = s1_mv /")
    dialog.button.click()
    assert dialog.isVisible()
    assert "incomplete" in live.model.notices.current().cause
    dialog.field.setPlainText("# note\nratio = s1_mv / s2_mv")
    dialog.button.click()
    assert not dialog.isVisible()
    assert [channel.name for channel in load_derived()] == ["ratio"]
    assert live.model.session.calls[-1] == "set_derived"


def test_a_derived_channel_has_a_plot_and_a_value(make):
    """Its unit is that of its expression; a number without one stands alone."""
    units = channel_units(2, "signal")
    derived = DerivedColumns.of(
        [parse_definition("gain = s1_mv / pressure_kpa"), parse_definition("r = s1_mv / s2_mv")], units
    )
    window = make(RecordedSession(connected(), filled_ring(60.0, derived=derived)))
    window.resize(1280, 1600)
    window.refresh()
    window.draw()
    assert [plot.left.labelText for plot in window.live.plots.rows[-2:]] == ["gain (mV/kPa)", "r"]
    assert window.model.live.text("gain", 2.5) == "2.50 mV/kPa"
