"""The shadow's page: the actuator large, elongation over pressure on its nominal band, deviation over cycles."""

from __future__ import annotations

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from boat_daq.engine.session import SessionSnapshot
from boat_daq.gui import style, widgets
from boat_daq.gui.plot_card import PlotCard
from boat_daq.gui.shadow_pane import ShadowPane
from boat_daq.viewmodels.desk import Desk
from boat_daq.viewmodels.shadow_live import PRESSURES_KPA

FRAME_MS = 33


class NominalCard(PlotCard):
    """Measured elongation over pressure, over the nominal curve with its band."""

    def __init__(self) -> None:
        super().__init__("Elongation over pressure")
        self.plot = self.add("Elongation", "mm", x_title="Pressure", x_unit="kPa")
        self.band = self.plot.band("Nominal, k = 2", lambda t: t.target)
        self.nominal = self.plot.curve("Nominal", lambda t: t.target, dashed=True)
        self.trace = self.plot.curve("Measured", lambda t: t.elongation, gaps=True)
        self.plot.x_range(*PRESSURES_KPA)
        self.plot.y_range(-5.0, 5.0)
        self._framed = False

    def show_desk(self, desk: Desk) -> None:
        """Draw the nominal curve once it is known, and the last seconds' way."""
        nominal = desk.shadow.nominal_curve()
        if nominal is None:
            self.readout.setText("preparing the shadow …" if not desk.shadow.problem else desk.shadow.problem)
            return
        pressure, mm, low, high = nominal
        if not self._framed:
            self._framed = True
            self.band.set(pressure, low, high)
            self.nominal.set(pressure, mm)
            self.plot.fit()
        self.trace.set(*desk.shadow.trace())
        self.readout.setText("- - nominal with its band (k = 2)   — measured, last minute")


class DeviationCard(PlotCard):
    """Mean deviation of each cycle from nominal."""

    def __init__(self) -> None:
        super().__init__("Deviation of each cycle")
        self.plot = self.add("Deviation", "mm", x_title="Cycle")
        self.points = self.plot.points("Deviation", lambda t: t.elongation)
        self.plot.line(lambda t: t.muted)
        self.plot.x_range(0.0, 10.0)
        self.plot.y_range(-1.0, 1.0)

    def show_desk(self, desk: Desk) -> None:
        """Draw the cycles that were watched."""
        x, y = desk.monitor.deviations()
        self.points.set(x, y)
        self.readout.setText("" if x.size else "fills while a calibrated unit runs cycles")
        self.plot.fit()


class ShadowPage(QWidget):
    """The shadow's page on a `Desk`."""

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.desk = desk
        self._revision = -1
        self.pane = ShadowPane(desk)
        self.pane.setContentsMargins(0, -style.GAP, 0, 0)
        self.nominal, self.deviation = NominalCard(), DeviationCard()
        self.alarms = widgets.label("", wrap=True, name="Alarms of the monitor")
        frame, inside = widgets.card()
        inside.addWidget(widgets.label("Alarms", "subtitle"))
        inside.addWidget(self.alarms)
        right = QVBoxLayout()
        right.setSpacing(style.GAP)
        right.addWidget(self.nominal, 4)
        right.addWidget(self.deviation, 3)
        right.addWidget(frame)
        across = QHBoxLayout()
        across.setSpacing(style.GAP)
        across.addWidget(self.pane, 2)
        across.addLayout(right, 3)
        widgets.page_layout(self).addLayout(across)
        self.timer = QTimer(self)
        self.timer.timeout.connect(self.draw)
        self.timer.start(FRAME_MS)

    def draw(self) -> None:
        """Draw one frame, where the page is seen."""
        if self.isVisible():
            self.pane.draw()

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show figures, trace and alarms."""
        self.desk.shadow.prepare()
        self.pane.refresh(snapshot)
        self.nominal.show_desk(self.desk)
        if self.desk.monitor.revision != self._revision:
            self._revision = self.desk.monitor.revision
            self.deviation.show_desk(self.desk)
            alarms = "\n".join(f"\u25b2 {sentence}" for sentence in self.desk.monitor.alarms)
            self.alarms.setText(alarms or "None. One false alarm in 1 000 healthy cycles is allowed.")
