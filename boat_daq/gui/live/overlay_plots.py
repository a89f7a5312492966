"""The last cycles overlaid: each signal over the time since its cycle began, the newest in colour."""

from __future__ import annotations

from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.viewmodels.live.overlay import KEPT, OverlayModel


class OverlayPlots(PlotCard):
    """Two plots: sensor 1 and sensor 2 over the time in the cycle."""

    def __init__(self, model: OverlayModel) -> None:
        super().__init__("Last cycles overlaid")
        self.model = model
        self.curves: list[list[Curve]] = []
        for number in (1, 2):
            last = number == 2
            plot = self.add(
                f"Signal {number}", "mV", x_title="Time in the cycle" if last else "", x_unit="min:s", time=True
            )
            faint = [plot.curve(f"{n} cycles ago", lambda t: t.line) for n in range(KEPT - 1, 0, -1)]
            self.curves.append([*faint, plot.curve("This cycle", sensor_colour(number))])
        self.link_x()
        self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)

    def draw(self) -> None:
        """Draw the cycles there are."""
        cycles = self.model.cycles()
        text = f"{len(cycles)} of the last {KEPT} cycles" if cycles else "shown once a cycle has begun"
        self.readout.setText(text)
        for sensor, curves in enumerate(self.curves):
            for place, curve in enumerate(reversed(curves)):
                if place < len(cycles):
                    curve.set(cycles[-1 - place].time_s, cycles[-1 - place].signals[sensor])
        if cycles:
            for plot in self.plots:
                plot.fit(x_margin=0.0)
