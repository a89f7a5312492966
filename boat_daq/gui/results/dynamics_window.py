"""The dynamics of a run under control, in a window of its own beside the program's. Not modal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, QTimerEvent
from PySide6.QtWidgets import QDialog, QWidget

from analysis.elongation_control.dynamic_figures import BODE_HEADINGS, STEP_HEADINGS, DynamicCalibration
from boat_daq.gui import style
from boat_daq.gui.plotting.axes import LogAxis, TickAxis
from boat_daq.gui.plotting.plot import Plot, PlotBox, ThemeColour, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_save
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.results.dynamics import DynamicsModel

_REFRESH_MS = 200
_SIZE = (1060, 720)
LEAST_DB, LEAST_DEG = 1.0, 10.0  # heights of the plots: less is not spread over them
EDGE_DB = -3.0
STEP_COLOURS: tuple[ThemeColour, ...] = (  # told apart in either theme
    sensor_colour(1), sensor_colour(2), lambda t: t.elongation, lambda t: t.pressure
)  # fmt: skip
SHOWN_ROWS = 4  # of a table, before it is scrolled
SETTLED_TIP = "Distance from its end within which a step counts as settled, any number of mm. Automatic: 0.05 mm"
_STEPS = "Mean response to the steps of each size"
BODE = "Measured elongation over its setpoint; surface: U, k = 2"


class BodeCard(PlotCard):
    """Gain above phase over the logarithm of the frequency."""

    def __init__(self) -> None:
        super().__init__("Bode plot", BODE)
        self.shown: Columns = {}
        self.gain = self._add("Gain", "dB", "")
        self.phase = self._add("Phase", "\u00b0", "Frequency")
        self.phase.x_unit = "Hz"
        self.link_x()
        self.gain.line(lambda t: t.muted, at=EDGE_DB, label="\u22123 dB")
        self.layers = [
            (plot.band("U", sensor_colour(1)), plot.curve(plot.title, sensor_colour(1)),
             plot.points("Sines", sensor_colour(1)))
            for plot in self.plots
        ]  # fmt: skip

    def _add(self, title: str, unit: str, x_title: str) -> Plot:
        bottom = LogAxis("bottom", lambda hz: f"{hz:g}")
        axes = {"left": TickAxis("left"), "bottom": bottom}
        item = pg.PlotItem(viewBox=PlotBox(), axisItems=axes, enableMenu=False)
        self.view.addItem(item, row=len(self.plots), col=0)
        plot = Plot(item, title, unit, x_title=x_title, x_unit="Hz" if x_title else "")
        self.plots.append(plot)
        return plot

    def columns(self) -> Columns:
        """Return the sines with gain, phase and U: the plot's own axis is a logarithm."""
        return self.shown

    def show_bode(self, found: DynamicCalibration) -> None:
        """Draw the sines."""
        x = np.log10([p.frequency_hz for p in found.bode])
        gain = np.array([(p.gain_db, 2 * p.u_gain_db) for p in found.bode]).T
        phase = np.array([(p.phase_deg, 2 * p.u_phase_deg) for p in found.bode]).T
        for (band, curve, points), (y, u) in zip(self.layers, (gain, phase), strict=True):
            band.fill(x, y - u, y + u)
            curve.set(x, y)
            points.set(x, y)
        self.shown = {
            "Frequency (Hz)": 10.0**x,
            **{"Gain (dB)": gain[0], "U of the gain (dB)": gain[1]},
            **{"Phase (\u00b0)": phase[0], "U of the phase (\u00b0)": phase[1]},
        }
        self.gain.fit(smallest=LEAST_DB)
        self.phase.fit(smallest=LEAST_DEG)
        self.paint_theme(self.theme)


class DynamicsWindow(QDialog):
    """Step response, Bode plot and figures.

    Parameters
    ----------
    like : a card of the window: theme, and what its menu does.
    """

    def __init__(self, parent: QWidget, model: DynamicsModel, services: Services, like: PlotCard) -> None:
        super().__init__(parent)
        self.model, self.services = model, services
        self._shown: DynamicCalibration | None = None
        self.setWindowTitle(f"Dynamics of {model.path.stem}")
        self.setModal(False)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        available = self.screen().availableSize()
        self.resize(min(_SIZE[0], available.width()), min(_SIZE[1], available.height()))
        self.steps, self.bode = PlotCard("Step response", _STEPS), BodeCard()
        plot = self.steps.add("Elongation", "% of the step", x_title="Since the setpoint changed", x_unit="s")
        plot.line(lambda t: t.muted, at=100.0)
        self.legend = controls.label("", "small", wrap=True, name="Legend of the steps")
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.steps.inside.addWidget(self.legend)
        for card in (self.steps, self.bode):
            card.copy_wanted.connect(like.copy_wanted)
            card.save_wanted.connect(like.save_wanted)
            card.paint_theme(like.theme)
        self.verdict = controls.label("Computing \u2026", "subtitle", wrap=True, name="Settling and bandwidth")
        self.simulated = controls.label("SIMULATED", "simulated", name="This run is of a simulated unit")
        self.simulated.hide()
        self.step_table = DataTable("Figures of the steps", _shown((STEP_HEADINGS,))[0])
        self.bode_table = DataTable("Gain and phase of the sines", _shown((BODE_HEADINGS,))[0])
        self.save = controls.button("Report \u2026", self._report, tip="Save it as PDF or HTML")
        self.save.setEnabled(False)
        self.settling = controls.typed("Settled within", model.settling, services.notices.attempt, tip=SETTLED_TIP)
        settling = controls.label("Settled within", "muted"), self.settling
        head = controls.row(self.simulated, (self.verdict, 1), *settling)
        plots = controls.row((self.steps, 1), (self.bode, 1))
        tables = controls.row((self.step_table, 3), (self.bode_table, 2))
        self.of_steps, self.of_bode = (self.steps, self.step_table), (self.bode, self.bode_table)
        buttons = controls.row(controls.button("Close", self.close), None, self.save)
        parts = (head, (plots, 2), (tables, 1), buttons)
        self.setLayout(controls.column(*parts, spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4))
        self.startTimer(_REFRESH_MS)

    def timerEvent(self, event: QTimerEvent | None = None) -> None:
        """Show the dynamics once they are computed."""
        self.settling.follow()
        found = self.model.found
        if self._shown is None and self.model.failed:
            self.verdict.setText(self.model.failed)
        if found is None or found is self._shown:
            return
        self._shown = found
        self.verdict.setText(_shown(((found.verdict,),))[0][0])
        self.simulated.setVisible(found.simulated)
        self.save.setEnabled(True)
        for parts, shown in ((self.of_steps, found.steps), (self.of_bode, found.bode)):
            for part in parts:
                part.setVisible(bool(shown))
        self.step_table.fill(_shown(found.step_rows()))
        self.bode_table.fill(_shown(found.bode_rows()))
        for table in (self.step_table, self.bode_table):
            rows = min(table.rowCount(), SHOWN_ROWS) * table.verticalHeader().defaultSectionSize()
            others = (table.horizontalHeader(), table.horizontalScrollBar())
            table.setMinimumHeight(rows + sum(one.sizeHint().height() for one in others) + 2 * table.frameWidth())
        if found.steps:
            self._draw_steps(found)
        if found.bode:
            self.bode.show_bode(found)

    def _draw_steps(self, found: DynamicCalibration) -> None:
        """Draw the mean response to the steps of each size."""
        plot = self.steps.plots[0]
        if plot.layers:  # the same run: only the tolerance of settling has changed
            return
        for place, (size, (time_s, share)) in enumerate(found.responses.items()):
            curve = plot.curve(f"{size:g} mm", _step_colour(place), gaps=True)
            curve.set(time_s, 100.0 * share)
            curve.paint(self.steps.theme)
        plot.fit()
        ground = self.steps.theme.surface
        self.legend.setText(
            "  ".join(
                style.swatch(_step_colour(n)(self.steps.theme), ground, f"{size:g} mm")
                for n, size in enumerate(found.responses)
            )
        )

    def _report(self) -> None:
        ask_save(self, self.services, f"{self.model.path.stem} dynamics", "pdf html", self.model.report, done="")


def _step_colour(place: int) -> ThemeColour:
    """Return the colour of the steps of one size, from the smallest."""
    return STEP_COLOURS[place % len(STEP_COLOURS)]


def _shown(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return texts as the window writes them: a capital at the start, a typographic minus."""
    return [tuple((text[:1].upper() + text[1:]).replace("-", "\u2212") for text in row) for row in rows]
