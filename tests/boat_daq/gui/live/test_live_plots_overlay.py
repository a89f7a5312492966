"""The last cycles overlaid."""

from __future__ import annotations

from PySide6.QtWidgets import QPushButton

from boat_daq.engine.plan import StepMark
from boat_daq.gui.live.live_plots import OverlayPlots
from boat_daq.viewmodels.live.live_model import OverlayModel
from protocol.recording import channels_of
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring


def test_last_cycles_are_overlaid(make):
    """From their beginnings; the button over them leads back to the plots."""
    session = RecordedSession(connected(), filled_ring(120.0))
    session.marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in (1, 2)
    )
    marks, session.marks = session.marks, ()
    window = make(session)
    window.live.toggle_overlay()
    window.refresh()
    assert window.live.overlay.isVisible()
    assert window.live.overlay.empty_text.isVisible()  # and no axes, before a cycle has begun
    session.marks = marks
    window.refresh()
    assert not window.live.overlay.empty_text.isVisible()
    assert window.live.overlay.readout.text() == "2 of the last 5 cycles, earlier ones grey"
    assert window.live.overlay.curves[0][-1].x.size > 100
    (back,) = (b for b in window.live.overlay.findChildren(QPushButton) if b.text() == "Back to the plots")
    back.click()
    window.refresh()
    assert window.live.plots.isVisible()


def test_an_extra_channel_is_plotted_measured_and_overlaid(make):
    """A plot of its own with its unit, a row of the statistics, a column of the CSV, and a plot of the last cycles."""
    session = RecordedSession(connected(), filled_ring(120.0, channels=channels_of([("load", "N")])))
    session.marks = (StepMark(1, 1, "unloading", 0.0, 10.0, 0, ended_us=int(36e6)),)
    window = make(session)
    window.resize(1280, 1000)
    window.refresh()
    window.draw()
    plots = window.live.plots
    assert "Load" in [plot.title for plot in plots.rows]
    for which in ("a", "b"):
        plots.place_cursor(which)
    rows = {span.name: span for span in window.model.live.statistics()}
    assert 19 < rows["Load"].mean < 24
    assert 19 < plots.columns()["load_n"].mean() < 24
    window.live.toggle_overlay()
    window.refresh()
    overlaid = window.live.overlay.others["load_n"][-1]
    assert overlaid.x.size > 100
    assert window.live.overlay._plots["load_n"].unit == "N"


def test_extra_channels_are_overlaid_too(qtbot):
    """Behind the sensors, three of them here; a field without numbers has no plot."""
    channels = channels_of([("temperature", "degC"), ("tag", "")])
    ring = filled_ring(72.0, sensors=3, channels=channels)
    step = StepMark(1, 1, "unloading", 0.0, 10.0, int(36e6), ended_us=int(72e6))
    overlay = OverlayPlots(OverlayModel(lambda: ring, lambda: (step,), ring.time_of))
    qtbot.addWidget(overlay)
    overlay.draw()
    assert [plot.title for plot in overlay.plots] == ["Sensor 1", "Sensor 2", "Sensor 3", "Temperature"]
    assert overlay.plots[-1].left.labelText == "Temperature (\u00b0C)"
    assert overlay.others["temperature_degc"][-1].x.size > 100
