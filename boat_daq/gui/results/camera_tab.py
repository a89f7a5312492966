"""The camera's tab of the calibration page: hysteresis over elongation, dynamic error, figures beside the plateaus'."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtWidgets import QWidget

from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, Plot, Points, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.figure_table import FigureTable
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.results.camera import CameraResult


class ContinuousCard(PlotCard):
    """Loop over elongation, hysteresis of each cycle or dynamic error, of all sensors; the operator chooses."""

    def __init__(self) -> None:
        super().__init__("Continuous record", "Signal and elongation of every sample, in ramps too", show_title=False)
        self.loop = self.add("Signal less curve", "% FSO", x_title="Elongation", x_unit="mm")
        self.cycles = self.add("Hysteresis over elongation", "% FSO", x_title="Cycle")
        self.speed = self.add("Signal less branch", "mV", x_title="Speed", x_unit="mm/s")
        entries = (("Loop", self.loop), ("Hysteresis of each cycle", self.cycles), ("Dynamic error", self.speed))
        self.chosen = controls.choice("Plot of the continuous record", entries, lambda _: self._show_chosen())
        self.bar.insertWidget(0, self.chosen)
        self.view.setMinimumSize(*style.PLOT_MINIMUM)  # of the one that is shown
        self._lower = {plot: (plot.x_title, plot.x_unit) for plot in self.plots}
        self._show_chosen()
        self.layers: list[tuple[Curve, Points, Points]] = []  # of each sensor, in the plots' order
        for plot in (self.loop, self.speed):
            plot.line(lambda t: t.muted)

    def show_camera(self, result: CameraResult) -> None:
        """Draw every sensor."""
        for n in range(len(self.layers) + 1, len(result.loops) + 1):
            name, colour = f"Sensor {n}", sensor_colour(n)
            of_sensor = (
                self.loop.curve(name, colour, gaps=True),
                self.cycles.points(name, colour, size=6),
                self.speed.points(name, colour, size=6),
            )
            self.layers.append(of_sensor)
            for layer in of_sensor:
                layer.paint(self.theme)
        for plot in self.plots:
            plot.clear()
        drawn = zip(self.layers, result.loops, result.per_cycle, result.by_speed, strict=False)
        for (loop, cycles, speed), of_loop, per_cycle, by_speed in drawn:
            loop.set(*of_loop)
            cycles.set(result.cycles[: per_cycle.size], per_cycle)
            speed.set(*by_speed)
        self._show_chosen()

    def _show_chosen(self) -> None:
        """Show the plot that is chosen, with its own lower axis."""
        plot: Plot = self.chosen.currentData()
        self.show_only([plot])
        plot.label_x(*self._lower[plot])
        plot.fit()
        self.paint_theme(self.theme)


class CameraTab(QWidget):
    """Plots, figures and what is known of the camera."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("inside")
        self.card = ContinuousCard()
        self.text = controls.label("", "small", wrap=True, name="Frames, delay and scale of the camera")
        self.table = FigureTable("Figures of the continuous record, with those of the plateaus")
        self.setLayout(controls.column((self.card, 1), self.text, (self.table, 1), spacing=style.GAP))

    def show_camera(self, result: CameraResult | None, sensors: Sequence[str]) -> None:
        """Show a run with a camera; nothing of one without."""
        self.text.setText(result.text if result is not None else "")
        self.table.show_rows(result.rows if result is not None else (), sensors if result is not None else ())
        if result is None or not any(np.isfinite(y).any() for _, y in result.loops):
            self.card.clear()
            self.card.show_empty("No sensor is calibrated on the continuous record.")
            return
        self.card.show_empty("")
        self.card.show_camera(result)
