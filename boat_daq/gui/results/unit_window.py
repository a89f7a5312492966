"""A unit over time, in a window of its own beside the program's. Not modal."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt, QTimerEvent
from PySide6.QtWidgets import QDialog, QGridLayout, QWidget

from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, Points, ramp_colour, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.repeat_page import FILLED, SYMBOLS
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_save
from boat_daq.gui.widgets.layouts import PageScroll
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.axis import number_labels
from boat_daq.viewmodels.results.unit_over_time import UnitOverTimeModel, check_point, history_headings, unit_rows
from boat_daq.workflows.unit_history import UnitOverTime
from protocol.base.arrays import FloatArray

_REFRESH_MS = 200
_SIZE = (1000, 720)
_LEAST_SHARE = 0.05  # of the values: less is not spread over the whole height
_AROUND = 0.1  # of the values: no point at the edge is cut
FINDING = 5  # column that takes the remaining width
_SINCE = "Since the first"
_CURVES_OF = "Curves of sensor {}"
CURVES_TITLE = "Calibration curves"
DIFFERENCES = "Difference from the first"
COEFFICIENT = "Coefficient b\u2081"
UNCERTAINTY_TITLE = "Uncertainty of an elongation"
EXPLANATIONS = {
    CURVES_TITLE: "The curve of each accepted calibration; the newest is the lightest",
    DIFFERENCES: "Each curve less the first one, where both are",
    COEFFICIENT: "Slope of the curve at 0 mm; surface: its expanded uncertainty, k = 2",
    UNCERTAINTY_TITLE: "U of one reading at the check point, k = 2",
}


class UnitWindow(QDialog):
    """Curves over each other, b1 and U over time, E_n, and when the unit is due again; plots as those of `like`."""

    def __init__(self, parent: QWidget, model: UnitOverTimeModel, services: Services, like: PlotCard) -> None:
        super().__init__(parent)
        self.model, self.services, self.theme = model, services, like.theme
        self._shown: UnitOverTime | None = None
        self.setWindowTitle(f"{model.title} over time")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        available = self.screen().availableSize()
        self.resize(min(_SIZE[0], available.width()), min(max(_SIZE[1], style.list_height(self)), available.height()))
        self.cards = {title: PlotCard(title, text) for title, text in EXPLANATIONS.items()}
        for title, name in ((CURVES_TITLE, "Signal"), (DIFFERENCES, "Difference")):
            self.cards[title].add(name, "mV", x_title="Elongation", x_unit="mm")
        self.cards[COEFFICIENT].add("b\u2081", "mV/mm", x_title=_SINCE, x_unit="d")
        self.cards[UNCERTAINTY_TITLE].add("U, k = 2", "mm", x_title=_SINCE, x_unit="d")
        self.numbers = self.cards[DIFFERENCES].plots[0].labels((0.5, 0.5), ground=True)
        grid = QGridLayout()
        grid.setSpacing(style.GAP)
        for place, card in enumerate(self.cards.values()):
            card.paint_theme(like.theme)
            card.setMinimumHeight(3 * style.STACKED_HEIGHT // 4)
            card.show_empty("Loading \u2026")
            grid.addWidget(card, place // 2, place % 2)
        self.due = controls.label("Reading the calibrations \u2026", "subtitle", wrap=True, name="When it is due again")
        self.sensor = controls.choice("Sensor of the curves", ((_CURVES_OF.format(1), 0),), self._draw_curves)
        self.table = DataTable(
            "Calibrations of the unit", history_headings(like.theme.units), stretched=FINDING, right=(2, 3, 4)
        )
        self.table.setMinimumHeight(5 * style.CONTROL_HEIGHT)
        self.save = controls.button("Report \u2026", self._report, tip="Save it as PDF or HTML")
        self.save.setEnabled(False)
        buttons = controls.row(controls.button("Close", self.close), None, self.save)
        self.simulated = controls.label("SIMULATED", "simulated", name="These calibrations are of a simulated unit")
        self.simulated.setVisible(model.units.simulated)
        head = controls.row(self.simulated, (self.due, 1), self.sensor)
        area = PageScroll()  # on a small screen; the buttons stay below it
        area.setWidget(controls.holder(controls.column((controls.holder(grid), 3), (self.table, 1), spacing=style.GAP)))
        self.setLayout(controls.column(head, (area, 1), buttons, spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4))
        self.startTimer(_REFRESH_MS)

    def timerEvent(self, event: QTimerEvent | None = None) -> None:
        found = self.model.found
        if self._shown is None and self.model.failed:
            self.due.setText(self.model.failed)
            self._say("Nothing to show.")
        if found is None or found is self._shown:
            return
        self._shown = found
        for card in self.cards.values():
            card.show_signals_in(found.signal_unit)
        units = self.theme.units.of_signals_in(found.signal_unit)
        self.table.set_headings(history_headings(units, found), stretched=FINDING, right=(2, 3, 4))
        self.due.setText(found.void or found.sentence)
        self.save.setEnabled(not found.void)
        self.table.fill(unit_rows(found, units))
        self.sensor.clear()
        for number in range(1, len(found.histories) + 1):
            self.sensor.addItem(_CURVES_OF.format(number), number - 1)
        self._say("No accepted calibration." if found.void else "")
        if found.void:
            return
        self._draw_curves(0)
        self._draw_times()

    def _say(self, text: str) -> None:
        for card in self.cards.values():
            card.show_empty(text)

    def _report(self) -> None:
        ask_save(self, self.services, f"{self.model.name} over time", "pdf html", self.model.report, done="")

    def _draw_curves(self, sensor: int) -> None:
        if self._shown is None or sensor is None or not 0 <= sensor < len(self._shown.histories):
            return
        curves = self._shown.histories[sensor].curves
        for title in (CURVES_TITLE, DIFFERENCES):
            card, plot = self.cards[title], self.cards[title].plots[0]
            plot.clear()
            lines = [layer for layer in plot.layers if isinstance(layer, Curve)]
            for k in range(len(lines), len(curves)):
                lines.append(plot.curve(f"Calibration {k + 1}", ramp_colour(k, len(curves))))
                lines[-1].paint(card.theme)
            for line, curve in zip(lines, curves, strict=False):
                line.set(*(curve.T if title == CURVES_TITLE else _less(curve, curves[0])))
            plot.fit()
            numbered = "; numbers as in the table" if title == DIFFERENCES else ""
            card.readout.setText(f"dark first, light last{numbered}")
        self.numbers.set(number_labels([(line.x, line.y) for line in lines[: len(curves)]]))

    def _draw_times(self) -> None:
        """Draw b1 and U of every sensor over the time since its first calibration."""
        assert self._shown is not None
        slope, spread = self.cards[COEFFICIENT].plots[0], self.cards[UNCERTAINTY_TITLE].plots[0]
        times, unit = self._shown.times()
        for sensor, history in enumerate(self._shown.histories):
            time, colour, name = times[sensor], sensor_colour(sensor + 1), f"Sensor {sensor + 1}"
            symbol = SYMBOLS[sensor % len(SYMBOLS)]
            if history.coefficients.shape[1] > 1:
                b1, u = history.coefficients[:, 1], 2.0 * history.std_errors[:, 1]
                known = np.isfinite(b1) & np.isfinite(u)
                band = slope.band(f"{name}, U", colour)
                band.fill(time[known], (b1 - u)[known], (b1 + u)[known])
                self._points(
                    slope.curve(name, colour), slope.points(name, colour, symbol=symbol), time[known], b1[known]
                )
                band.paint(self.theme)
            known = np.isfinite(history.expanded_mm)
            values, marks = history.expanded_mm[known], spread.points(name, colour, symbol=symbol)
            self._points(spread.curve(name, colour), marks, time[known], values)
        names = (f"{FILLED[n % len(FILLED)]} sensor {n + 1}" for n in range(len(times)))
        legend = "  ".join(names)
        self.cards[COEFFICIENT].readout.setText(legend)
        self.cards[UNCERTAINTY_TITLE].readout.setText(f"{check_point(self._shown, self.theme.units)}   {legend}")
        for plot in (slope, spread):
            plot.x_unit = unit
            plot.label_x(_SINCE, unit)
            plot.paint(self.theme)
            values = np.concatenate([layer.y for layer in plot.layers if layer.y.size] or [np.ones(1)])
            around = _AROUND * np.ptp(values)
            ends = (values.min() - around, values.max() + around)
            plot.fit(x_margin=_AROUND, smallest=_LEAST_SHARE * float(np.abs(values).max()), also_y=ends)

    def _points(self, curve: Curve, points: Points, x: FloatArray, y: FloatArray) -> None:
        for layer in (curve, points):
            layer.set(x, y)
            layer.paint(self.theme)


def _less(curve: FloatArray, first: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return x and a curve less the first one, where both are; arrays [points, 2]."""
    both = (curve[:, 0] >= first[0, 0]) & (curve[:, 0] <= first[-1, 0])
    return curve[both, 0], curve[both, 1] - np.interp(curve[both, 0], first[:, 0], first[:, 1])
