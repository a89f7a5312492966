"""Derived channels in the window: their plots, values, statistics, and the panel that defines them."""

from __future__ import annotations

from boat_daq.engine.derived_store import load_derived
from boat_daq.gui.widgets.text_dialog import TextDialog
from tests.boat_daq.gui.windows import run_command


def test_the_panel_takes_definitions_and_names_what_it_refuses(live, tmp_path, monkeypatch):
    """A line that is refused leaves the panel open and the stored definitions as they were."""
    monkeypatch.setattr("boat_daq.engine.derived_store.home", lambda: tmp_path)  # else later sessions would have them
    run_command(live, "Derived channels …")
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
