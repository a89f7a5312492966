"""The shadow page: the actuator, elongation over pressure on its nominal band, figures of each cycle, alarms."""

from __future__ import annotations

import math

import numpy as np
from PySide6.QtCore import Qt, QTimerEvent
from PySide6.QtWidgets import QWidget

from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.layouts import ReflowingPage, Shares
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live import axis
from boat_daq.viewmodels.live.shadow_live import PRESSURES_KPA, SERIES, ShadowLive, ShadowMonitor

FRAME_MS = 16
ALARM_SIZE, ALARM_LINES = 16, 4
_MARGIN = 0.1  # of the span of a figure, for the marks at its ends
ALARM_HEADINGS = ("What", "Since", "Found", "False alarm once in", "Seen in")

_POINTS = "Each cycle of the run is shown here as a point"
NO_CYCLES = f"{_POINTS}, once it is complete."
NOT_CALIBRATED = f"{_POINTS}. Accept a calibration of the unit on Results first."
_CYCLES = "One figure of each cycle of the run; a drift shows a change of the actuator."
NOMINAL = "Model: healthy actuators of this design (band: 95 %, with hysteresis); measured: this unit, last minute"


class NominalCard(PlotCard):
    """Measured elongation over pressure, over the nominal curve with its band."""

    def __init__(self) -> None:
        super().__init__("Elongation over pressure", NOMINAL)
        self.plot = self.add("Elongation", "mm", x_title="Pressure", x_unit="kPa")
        self.band = self.plot.band("Model, band", lambda t: t.target)
        self.nominal = self.plot.curve("Model", lambda t: t.target, pen_style=Qt.PenStyle.DashLine)
        self.trace = self.plot.curve("Measured", lambda t: t.elongation, gaps=True)
        self.now = self.plot.points("Measured now", lambda t: t.elongation)
        self.plot.x_range(*PRESSURES_KPA)
        self.plot.y_range(-5.0, 5.0)
        self._framed = False

    def show_model(self, model: ShadowLive) -> None:
        """Draw the nominal curve once it is known, and the path of the last minute."""
        nominal = model.nominal_curve()
        if nominal is None:
            self.readout.setText("preparing the shadow …")
            return
        pressure, mm, low, high = nominal
        if not self._framed:
            self._framed = True
            self.band.fill(pressure, low, high)
            self.nominal.set(pressure, mm)
            self.plot.fit()
        kpa, measured = model.trace()
        self.trace.set(kpa, measured)
        self.now.set(kpa[-1:], measured[-1:])
        head = "- - model with its band" + ("   — measured, last minute" if np.isfinite(measured).any() else "")
        known = math.isfinite(model.error_mm)  # once the mesh is prepared
        self.readout.setText(f"{head}   numerical error {1e3 * model.error_mm:.1g} \u00b5m" if known else head)


class CyclesCard(PlotCard):
    def __init__(self, monitor: ShadowMonitor) -> None:
        super().__init__("Cycle by cycle", _CYCLES)
        self.monitor, self.calibrated = monitor, True
        figures = [(s.title, name) for name, s in SERIES.items()]
        self.figure = controls.choice("Figure of each cycle", figures, lambda _: self.show_cycles())
        self.bar.insertWidget(1, self.figure)
        self.plot = self.add("Deviation", "mm", x_title="Cycle")
        self.points = self.plot.points("Each cycle", lambda t: t.elongation)
        self.alarms = self.plot.points("Alarm", lambda t: t.warn, filled=False, symbol="t1", size=ALARM_SIZE)
        self.plot.x_range(0.0, 10.0)
        self.plot.y_range(-1.0, 1.0)

    def show_cycles(self) -> None:
        name = str(self.figure.currentData())
        x, y = self.monitor.series(name)
        known = np.isfinite(y)
        x, y = x[known], y[known]
        alarmed = np.isin(x, self.monitor.alarm_cycles())
        self.points.set(x, y)
        self.alarms.set(x[alarmed], y[alarmed])
        self.plot.set_title(SERIES[name].axis, SERIES[name].unit)
        self.readout.setText("\u25b3 alarm" if alarmed.any() else "")
        self.show_empty("" if x.size else NO_CYCLES if self.calibrated else NOT_CALIBRATED)
        if x.size:
            self.plot.x_range(0.0, max(10.0, float(x.max()) + 1.0))
            low, high = axis.padded(float(y.min()), float(y.max()), _MARGIN)
            self.plot.y_range(*axis.framed(low, high, smallest=SERIES[name].smallest))


class ShadowPage(ReflowingPage):
    def __init__(self, model: ShadowLive, monitor: ShadowMonitor, services: Services) -> None:
        super().__init__()
        self.model, self.monitor = model, monitor
        self._revision: tuple[int, bool] | None = None
        self.pane = ShadowPane(model, services)
        self.pane.setContentsMargins(0, -style.GAP, 0, 0)
        self.nominal, self.cycles = NominalCard(), CyclesCard(monitor)
        plots = Shares("shadow plots", services.preferences, (self.nominal, 4), (self.cycles, 3))
        right = controls.holder(controls.column((plots, 1), self._alarms(), spacing=style.GAP))
        across = Shares("shadow", services.preferences, (self.pane, 2), (right, 3), beside=True)
        controls.page_layout(self).addWidget(across)
        self.rows, self.tall = (across,), (self.pane.view, self.nominal, self.cycles)
        self.startTimer(FRAME_MS)

    def _alarms(self) -> QWidget:
        self.verdict = controls.label("", "muted", name="State of the monitor", wrap=True)
        self.alarms = DataTable("Alarms of the monitor, the newest on top", ALARM_HEADINGS)
        self.alarms.setFixedHeight(ALARM_LINES * style.CONTROL_HEIGHT)
        return controls.card(controls.row(controls.label("Alarms", "subtitle"), (self.verdict, 1)), self.alarms)[0]

    def timerEvent(self, event: QTimerEvent) -> None:
        self.pane.draw()

    def refresh(self, snapshot: SessionSnapshot) -> None:
        self.model.prepare()
        self.pane.refresh(snapshot)
        self.nominal.show_model(self.model)
        self.cycles.calibrated = snapshot.link is not LinkState.UP or self.model.calibrated
        if (self.monitor.revision, self.cycles.calibrated) != self._revision:
            self._revision = (self.monitor.revision, self.cycles.calibrated)
            self.cycles.show_cycles()
            rows = self.monitor.rows()
            self.alarms.fill([[(text, text) for text in (f"\u25b2 {what}", *cells)] for what, *cells in rows])
            self.alarms.setVisible(bool(rows))
            self.verdict.setText(self.monitor.verdict())
