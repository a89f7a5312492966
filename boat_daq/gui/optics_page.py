"""The optics page: rays with a slider over the states, NDR, the maps of P, the Pareto front, the sweep."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QSlider, QVBoxLayout, QWidget

from boat_daq.engine.session import SessionSnapshot
from boat_daq.gui import style, widgets
from boat_daq.gui.plot import sensor_ink
from boat_daq.gui.plot_card import PlotCard
from boat_daq.gui.style import Theme
from boat_daq.viewmodels.desk import Desk
from boat_daq.viewmodels.optics import CAVITIES, RAYS, STATES, STEPS_MM, OpticsModel


class SceneCard(PlotCard):
    """The resin, the rays and the receiver of one state."""

    def __init__(self) -> None:
        super().__init__("Rays")
        self.plot = self.add("Across", "mm", x_title="Along the actuator", x_unit="mm")
        self.plot.item.getViewBox().setAspectLocked(True)
        self.outline = self.plot.curve("Guide", lambda t: t.muted, gaps=True)
        self.released = self.plot.curve("Released", lambda t: style.faint(t.sensors[0], style.RAY_ALPHA), gaps=True)
        self.secondary = self.plot.curve("Secondary", lambda t: style.faint(t.sensors[1], style.RAY_ALPHA), gaps=True)
        self.receiver = self.plot.curve("Receiver", lambda t: t.pressure)

    def show_state(self, model: OpticsModel) -> None:
        """Draw the state that the slider is on."""
        scene = model.scene()
        self.readout.setText(model.state_text())
        if scene is None:
            return
        for curve, line in (
            (self.outline, scene.outline), (self.released, scene.released), (self.secondary, scene.secondary),
            (self.receiver, scene.receiver),
        ):  # fmt: skip
            curve.set(line[:, 0], line[:, 1])

    def frame(self) -> None:
        """Show the whole guide."""
        self.plot.fit()


class ResponseCard(PlotCard):
    """NDR with its standard deviation, the cubic through it, and where the slider is."""

    def __init__(self) -> None:
        super().__init__("Detected rays over the states")
        self.plot = self.add("Detected", "of 250", x_title="Elongation", x_unit="mm")
        self.band = self.plot.band("NDR, one standard deviation", sensor_ink(1))
        self.andr = self.plot.curve("aNDR", lambda t: t.accent)
        self.ndr = self.plot.points("NDR", sensor_ink(1))
        self.now = self.plot.line(lambda t: t.muted, vertical=True)

    def show_result(self, model: OpticsModel) -> None:
        """Draw a design's response."""
        r = model.result
        self.readout.setText(model.design_text())
        if r is None:
            return
        self.ndr.set(r.elongation_mm, r.ndr)
        self.andr.set(r.elongation_mm, r.andr)
        self.band.set(r.elongation_mm, r.ndr - r.ndr_sd, r.ndr + r.ndr_sd)
        self.now.setValue(r.elongation_mm[model.state])
        self.plot.fit()


class Map:
    """P over spacing and depth for one width; a click looks at that design."""

    def __init__(self, card: PlotCard, place: int, model: OpticsModel) -> None:
        self.model, self.width_mm = model, STEPS_MM[place]
        self.item = card.view.addPlot(row=place // 3, col=place % 3, title=f"width {self.width_mm:g} mm")
        self.item.setMenuEnabled(False)
        self.item.hideButtons()
        self.item.setMouseEnabled(False, False)
        self.image = pg.ImageItem()
        self.item.addItem(self.image)
        marks = [(i + 0.5, f"{step:g}") for i, step in enumerate(STEPS_MM)]
        for side in ("left", "bottom"):
            self.item.getAxis(side).setTicks([marks])
        self.item.setRange(xRange=(0, len(STEPS_MM)), yRange=(0, len(STEPS_MM)), padding=0)
        self.best = pg.ScatterPlotItem(size=12, symbol="star", pen="w", brush=None)
        self.paper = pg.ScatterPlotItem(size=12, symbol="o", pen="w", brush=None)
        self.item.addItem(self.best)
        self.item.addItem(self.paper)

    def clicked(self, event: Any, cavities: int) -> None:
        """Look at the design under the mouse."""
        if self.item.sceneBoundingRect().contains(event.scenePos()):
            at = self.item.getViewBox().mapSceneToView(event.scenePos())
            self.model.pick(cavities, self.width_mm, at.x(), at.y())

    def show_sweep(self, cavities: int, table: np.ndarray[Any, Any]) -> None:
        """Draw one map, with the best and the paper's optimum where they are in it."""
        sweep = self.model.sweep
        assert sweep is not None
        self.image.setImage(sweep.grid(cavities, self.width_mm, STEPS_MM), levels=(0.0, 1.0))
        self.image.setLookupTable(table)
        for item, index in ((self.best, sweep.best), (self.paper, sweep.paper)):
            here = index >= 0 and (int(sweep.values[index][0]), float(sweep.values[index][1])) == (
                cavities,
                self.width_mm,
            )
            item.setData(
                x=[self._place(sweep.values[index][3])] if here else [],
                y=[self._place(sweep.values[index][2])] if here else [],
            )

    @staticmethod
    def _place(step_mm: float) -> float:
        return STEPS_MM.index(round(float(step_mm), 1)) + 0.5

    def paint_theme(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        for side in ("left", "bottom"):
            ruler = self.item.getAxis(side)
            ruler.setPen(theme.line)
            ruler.setTextPen(theme.muted)
            ruler.setStyle(tickFont=style.small_font())
        self.item.setTitle(f"width {self.width_mm:g} mm", color=theme.muted, size=f"{style.FONT_SMALL}px")


class MapsCard(PlotCard):
    """The maps of P for all widths, as in the paper's figure 3D."""

    def __init__(self, model: OpticsModel) -> None:
        super().__init__("Maps of P")
        self.model = model
        self.cavities = widgets.choice("Cavities of the maps", [(f"{n} cavities", n) for n in CAVITIES])
        self.cavities.setCurrentIndex(1)
        self.cavities.activated.connect(lambda _: self.show_sweep())
        self.bar.insertWidget(1, self.cavities)
        self.maps = [Map(self, place, model) for place in range(len(STEPS_MM))]
        self.view.scene().sigMouseClicked.connect(self._clicked)
        self.columns_of = self._columns
        self.table = np.zeros((0, 3))

    def _columns(self) -> dict[str, Any]:
        sweep = self.model.sweep
        if sweep is None:
            return {}
        names = ("cavities", "width_mm", "depth_mm", "spacing_mm")
        figures = {
            "p_normalised": sweep.p,
            "delta": sweep.delta,
            "n_sign": sweep.n_sign,
            "rmse": sweep.rmse,
            "rank": sweep.ranks,
        }
        return {name: sweep.values[:, i] for i, name in enumerate(names)} | figures

    def _clicked(self, event: Any) -> None:
        for shown in self.maps:
            shown.clicked(event, int(self.cavities.currentData()))

    def show_sweep(self) -> None:
        """Draw the maps of the chosen number of cavities."""
        if self.model.sweep is not None:
            for shown in self.maps:
                shown.show_sweep(int(self.cavities.currentData()), self.table)
            self.readout.setText("spacing across, depth up, mm   \u2606 best   \u25cb paper's")

    def paint_theme(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        super().paint_theme(theme)
        steps = [QColor(style.sequential(style.LIGHT, i, 64)) for i in range(64)]
        self.table = np.array([[c.red(), c.green(), c.blue()] for c in steps], dtype=np.ubyte)
        for shown in self.maps:
            shown.paint_theme(theme)
        self.show_sweep()


class ParetoCard(PlotCard):
    """Delta against RMSE of all designs; the front is filled."""

    def __init__(self) -> None:
        super().__init__("Range against smoothness")
        self.plot = self.add("\u0394", "rays", x_title="RMSE", x_unit="rays")
        self.all = self.plot.points("Designs", lambda t: t.target, filled=False, size=5)
        self.front = self.plot.points("Pareto front", lambda t: t.accent)
        self.paper = self.plot.points("Paper's optimum", sensor_ink(2), symbol="d", size=12)

    def show_sweep(self, model: OpticsModel) -> None:
        """Draw the sweep."""
        s = model.sweep
        if s is None:
            return
        self.all.set(s.rmse, s.delta)
        self.front.set(s.rmse[s.front], s.delta[s.front])
        chosen = [s.paper] if s.paper >= 0 else []
        self.paper.set(s.rmse[chosen], s.delta[chosen])
        self.readout.setText("\u25cf not beaten in \u0394, RMSE, n_sign   \u25c6 paper's")
        self.plot.fit()


class OpticsPage(QWidget):
    """The optics page on a `Desk`."""

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.desk, self.model = desk, desk.optics
        self._revision = -1
        self.scene, self.response = SceneCard(), ResponseCard()
        self.maps, self.pareto = MapsCard(self.model), ParetoCard()
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setAccessibleName("State, from compressed to elongated")
        self.slider.setRange(0, STATES - 1)
        self.slider.setValue(self.model.state)
        self.slider.valueChanged.connect(self._slide)
        layout = widgets.page_layout(self)
        layout.addWidget(self._head())
        left, right = QVBoxLayout(), QVBoxLayout()
        for column, upper, lower in ((left, self.scene, self.response), (right, self.maps, self.pareto)):
            column.setSpacing(style.GAP)
            column.addWidget(upper, 5)
            column.addWidget(lower, 4)
        left.insertLayout(
            1, widgets.row(widgets.label("compressed", "small"), self.slider, widgets.label("elongated", "small"))
        )
        across = QHBoxLayout()
        across.setSpacing(style.GAP)
        across.addLayout(left, 1)
        across.addLayout(right, 1)
        layout.addLayout(across, 1)

    def _head(self) -> QWidget:
        frame, inside = widgets.card()
        steps = [(f"{step:g}", step) for step in STEPS_MM]
        self.fields = {
            "cavities": widgets.choice("Number of cavities", [(str(n), n) for n in CAVITIES]),
            **{name: widgets.choice(f"{name} in mm", steps) for name in ("width", "depth", "spacing")},
        }  # fmt: skip
        grid = QGridLayout()
        for i, (name, field) in enumerate(self.fields.items()):
            unit = "" if name == "cavities" else ", mm"
            grid.addWidget(widgets.label(f"{name.capitalize()}{unit}", "muted"), 0, 2 * i)
            grid.addWidget(field, 0, 2 * i + 1)
            field.activated.connect(lambda _: self._choose())
        self.rays = widgets.choice("Rays", [(f"{n} rays", n) for n in RAYS])
        self.rays.activated.connect(lambda _: self.model.set_rays(int(self.rays.currentData())))
        self.sweep_button = widgets.button(
            "Sweep all designs", partial(self.desk.notices.attempt, self.model.toggle_sweep), "primary"
        )
        self.outcome = widgets.label("", "muted")
        line = widgets.row(None)
        line.insertLayout(0, grid)
        line.addWidget(self.rays)
        line.addWidget(self.sweep_button)
        inside.addLayout(line)
        inside.addWidget(self.outcome)
        return frame

    def _choose(self) -> None:
        n, width, depth, spacing = (field.currentData() for field in self.fields.values())
        self.model.choose((int(n), float(width), float(depth), float(spacing)))
        self.refresh(self.desk.snapshot)

    def _slide(self, state: int) -> None:
        self.model.state = state
        self.scene.show_state(self.model)
        if self.model.result is not None:
            self.response.now.setValue(self.model.result.elongation_mm[state])

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show design and sweep where they have changed; the first look traces the paper's design."""
        if self.model.result is None and not self.model.tracing and not self.model.problem:
            self.model.choose(self.model.values)
        widgets.set_text(self.sweep_button, "Stop the sweep" if self.model.sweeping else "Sweep all designs")
        if self.model.revision == self._revision:
            return
        self._revision = self.model.revision
        for field, value in zip(self.fields.values(), self.model.values, strict=True):
            field.setCurrentIndex(field.findData(value))
        self.outcome.setText(
            self.model.sweep_text()
            or "A sweep simulates 648 designs in 15 states each and draws the maps and the front."
        )
        self.scene.show_state(self.model)
        self.scene.frame()
        self.response.show_result(self.model)
        self.maps.show_sweep()
        self.pareto.show_sweep(self.model)
