"""The shadow's page: the actuator large, elongation over pressure on its nominal band, cycle by cycle,
the alarms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.reflow import ReflowingPage
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live import axis
from boat_daq.viewmodels.live.shadow_live import PRESSURES_KPA, ShadowLive
from boat_daq.viewmodels.live.shadow_monitor import SERIES, AlarmRow, ShadowMonitor

FRAME_MS = 16
ALARM_SIZE, ALARM_LINES = 16, 4
MARGIN = 0.1  # of the span of a figure, for the marks at its ends


NO_CYCLES = "Each cycle of a run comes here as a point, once the unit has an accepted calibration. Then start a plan."
NOMINAL = (
    "Nominal: what a healthy actuator of this design does, computed by the shadow (a finite-element model); its band "
    "holds about 95 % of them (k = 2). Measured: this unit in the last minute, by its calibration."
)


class NominalCard(PlotCard):
    """Measured elongation over pressure, over the nominal curve with its band."""

    def __init__(self) -> None:
        super().__init__("Elongation over pressure")
        self.heading.explain(NOMINAL)
        self.plot = self.add("Elongation", "mm", x_title="Pressure", x_unit="kPa")
        self.band = self.plot.band("Nominal, k = 2", lambda t: t.target)
        self.nominal = self.plot.curve("Nominal", lambda t: t.target, dashed=True)
        self.trace = self.plot.curve("Measured", lambda t: t.elongation, gaps=True)
        self.plot.x_range(*PRESSURES_KPA)
        self.plot.y_range(-5.0, 5.0)
        self._framed = False

    def show_model(self, model: ShadowLive) -> None:
        """Draw the nominal curve once it is known, and the last seconds' way."""
        nominal = model.nominal_curve()
        if nominal is None:
            self.readout.setText("preparing the shadow …" if not model.problem else model.problem)
            return
        pressure, mm, low, high = nominal
        if not self._framed:
            self._framed = True
            self.band.fill(pressure, low, high)
            self.nominal.set(pressure, mm)
            self.plot.fit()
        self.trace.set(*model.trace())
        self.readout.setText("- - nominal with its band (k = 2)   — measured, last minute")


class CyclesCard(PlotCard):
    """One figure of every cycle, and where the alarms stand in it."""

    def __init__(self, monitor: ShadowMonitor) -> None:
        super().__init__("Cycle by cycle")
        self.heading.explain("One figure of each cycle of the run: where it drifts, something has changed.")
        self.monitor = monitor
        self.figure = widgets.choice("Figure of each cycle", [(s.title, name) for name, s in SERIES.items()])
        self.figure.activated.connect(lambda _: self.show_cycles())
        self.bar.insertWidget(1, self.figure)
        self.plot = self.add("Deviation", "mm", x_title="Cycle")
        self.points = self.plot.points("Each cycle", lambda t: t.elongation)
        self.alarms = self.plot.points("Alarm", lambda t: t.warn, filled=False, symbol="t1", size=ALARM_SIZE)
        self.plot.x_range(0.0, 10.0)
        self.plot.y_range(-1.0, 1.0)

    def show_cycles(self) -> None:
        """Draw the cycles that were watched."""
        name = str(self.figure.currentData())
        x, y = self.monitor.series(name)
        known = np.isfinite(y)
        x, y = x[known], y[known]
        alarmed = np.isin(x, self.monitor.alarm_cycles())
        self.points.set(x, y)
        self.alarms.set(x[alarmed], y[alarmed])
        self.plot.set_title(SERIES[name].axis, SERIES[name].unit)
        words = "\u25b3 alarm found here" if alarmed.any() else ""
        self.readout.setText(words)
        self.show_empty("" if x.size else NO_CYCLES)
        if x.size:
            self.plot.x_range(0.0, max(10.0, float(x.max()) + 1.0))
            low, high = axis.padded(float(y.min()), float(y.max()), MARGIN)
            self.plot.y_range(*axis.framed(low, high, smallest=SERIES[name].smallest))


class AlarmTable(QTableWidget):
    """The alarms of the run: what, since when, found when, how sure, by which figure; the newest on top."""

    COLUMNS = ("What", "Since", "Found", "False alarm once in", "Seen in")

    def __init__(self) -> None:
        super().__init__(0, len(self.COLUMNS))
        self.setAccessibleName("Alarms of the monitor: what, since when, how sure")
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setShowGrid(False)
        self.setWordWrap(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(style.CONTROL_HEIGHT - style.STEP)
        self.setHorizontalHeaderLabels(list(self.COLUMNS))
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(len(self.COLUMNS) - 1, QHeaderView.ResizeMode.Stretch)

    def show_rows(self, rows: Sequence[AlarmRow]) -> None:
        """Show the alarms."""
        self.setRowCount(len(rows))
        for i, row in enumerate(rows):
            for k, text in enumerate((f"\u25b2 {row.what}", row.since, row.found, row.sure, row.why)):
                cell = QTableWidgetItem(text)
                cell.setToolTip(text)
                self.setItem(i, k, cell)


class ShadowPage(ReflowingPage):
    """The shadow's page."""

    def __init__(self, model: ShadowLive, monitor: ShadowMonitor, services: Services) -> None:
        super().__init__()
        self.model, self.monitor = model, monitor
        self._revision = -1
        self.pane = ShadowPane(model, services)
        self.pane.setContentsMargins(0, -style.GAP, 0, 0)
        self.nominal, self.cycles = NominalCard(), CyclesCard(monitor)
        right = QVBoxLayout()
        right.setSpacing(style.GAP)
        right.addWidget(self.nominal, 4)
        right.addWidget(self.cycles, 3)
        right.addWidget(self._alarms())
        across = QHBoxLayout()
        across.setSpacing(style.GAP)
        across.addWidget(self.pane, 2)
        across.addLayout(right, 3)
        widgets.page_layout(self).addLayout(across)
        self.rows, self.tall = (across,), (self.pane.view, self.nominal, self.cycles)
        self.timer = QTimer(self)
        self.timer.timeout.connect(self.draw)
        self.timer.start(FRAME_MS)

    def _alarms(self) -> QWidget:
        frame, inside = widgets.card()
        self.verdict = widgets.label("", "muted", name="What the monitor says", wrap=True)
        self.alarms = AlarmTable()
        self.alarms.setFixedHeight(ALARM_LINES * style.CONTROL_HEIGHT)
        line = widgets.row(widgets.label("Alarms", "subtitle"), self.verdict)
        line.setStretchFactor(self.verdict, 1)
        inside.addLayout(line)
        inside.addWidget(self.alarms)
        return frame

    def draw(self) -> None:
        """Draw one frame, where the page is seen."""
        if self.isVisible():
            self.pane.draw()

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show figures, trace and alarms."""
        self.model.prepare()
        self.pane.refresh(snapshot)
        self.nominal.show_model(self.model)
        if self.monitor.revision != self._revision:
            self._revision = self.monitor.revision
            self.cycles.show_cycles()
            rows = self.monitor.rows()
            self.alarms.show_rows(rows)
            self.alarms.setVisible(bool(rows))
            self.verdict.setText(self.monitor.verdict())
