"""The optics page: a design in the state of a slider, and the sweep over all designs.

Its plots are the rays of a state, NDR over the states, the designs by merit, and the maps of P.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QComboBox, QGridLayout, QHBoxLayout, QSlider, QWidget

from analysis.optics.scene.parameters import STATES, STEPS_MM
from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.formatting import number
from boat_daq.gui import style
from boat_daq.gui.plotting.axes import fixed_plot, paint_axis
from boat_daq.gui.plotting.plot import sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.layouts import ReflowingPage, Shares
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live import axis
from boat_daq.viewmodels.models.optics import (
    CAVITIES,
    FACE_NAMES,
    MAPPED_FACE,
    OpticsModel,
    SweepSummary,
    shipped_sweep,
)
from protocol.base.arrays import FloatArray

_COLUMNS = 3  # of maps
SHADES = 64
SCALE_WIDTH = 68
ON_GRID_MM = 1e-6
MARK = 10  # pixels: about as high as a cell on a small page
CORNERS = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])  # of a cell, from its middle
_STRIP_MARGIN = 0.02  # of the strip, for the marks at its ends
RELATIVE = "P / best P"
SWEEP_FIRST = "Press \u201cSweep all designs\u201d to "

SCENE = "Rays from the emitter (left) to the receiver (right); 250 at most are drawn, all are counted"
RESPONSE = "Points: detected rays (NDR); band: k = 2; line: their cubic; P = range / (increases × rms residual)"
MERIT = "P = range / (increases × rms residual), relative to the best; click a cell to show its design"
STRIP = "Designs by falling figure of merit; filled: cannot be told from the best; click one to show it"
WHAT_COMES = "Press \u201cSweep all designs\u201d to find which of 648 designs is best, and how sure that is."
RUNNING = "Under pressure: nothing is traced until the run has ended and the unit is vented."


def designs(sweep: SweepSummary) -> dict[str, Any]:
    """Return every design of a sweep with its figures, as columns named with their units."""
    names = ("cavities", "width (mm)", "depth (mm)", "spacing (mm)")
    columns = {name: sweep.values[:, i] for i, name in enumerate(names)}
    found = sweep.merit
    figures = {
        "range Delta (rays)": found.delta,
        "increases n_sign": found.n_sign,
        "rms residual RMSE (rays)": found.rmse,
    }
    return columns | figures


class SceneCard(PlotCard):
    """The light guide, the rays and the receiver of one state."""

    def __init__(self) -> None:
        super().__init__("Rays", SCENE)
        self.plot = self.add("Across", "mm", x_title="Along the actuator", x_unit="mm")
        self.plot.item.getViewBox().setAspectLocked(True)
        self.curves = (  # in the order of `StateScene`
            self.plot.curve("Guide", lambda t: t.muted, gaps=True),
            self.plot.curve("Released", lambda t: style.faint(t.sensors[0], style.RAY_ALPHA), gaps=True, thin=True),
            self.plot.curve("Secondary", lambda t: style.faint(t.sensors[1], style.RAY_ALPHA), gaps=True, thin=True),
            self.plot.curve("Receiver", lambda t: t.pressure),
        )
        self.drawn = self.plot.corner_text()

    def show_state(self, model: OpticsModel) -> None:
        scene = model.scene()
        waits = model.waiting_text("The light guide and its rays")
        self.show_empty("" if scene is not None else waits)
        self.show_stale(stale=model.outdated)
        self.drawn.set(model.drawn_text())
        self.readout.setText(model.state_text())
        for curve, line in zip(self.curves, scene or (), strict=False):
            curve.set(*line.T)


class ResponseCard(PlotCard):
    """NDR with its error (k = 2), the cubic through it, and the state of the slider."""

    def __init__(self) -> None:
        super().__init__("Detected rays", RESPONSE)
        self.plot = self.add("Detected", "of 250", x_title="Elongation", x_unit="mm")
        self.band = self.plot.band("Detected rays (NDR), error (k = 2) about", sensor_colour(1))
        self.andr = self.plot.curve("Smooth curve (aNDR)", lambda t: t.accent)
        self.ndr = self.plot.points("Detected rays (NDR)", sensor_colour(1))
        self.now = self.plot.line(lambda t: t.muted, vertical=True)

    def show_result(self, model: OpticsModel) -> None:
        r = model.result
        waits = model.waiting_text("The detected rays in each state")
        self.show_empty("" if r is not None else waits)
        self.show_stale(stale=model.outdated)
        self.readout.setText(model.design_text())
        if r is None:
            return
        self.ndr.set(r.elongation_mm, r.ndr)
        self.andr.set(r.elongation_mm, r.merit.andr)
        self.band.fill(r.elongation_mm, r.ndr - r.error, r.ndr + r.error)
        self.now.setValue(r.elongation_mm[model.state])
        self.plot.fit()


class MeritMap:
    """P over spacing and depth for one width; a click shows that design."""

    def __init__(self, card: MapsCard, place: int, model: OpticsModel) -> None:
        self.model, self.width_mm = model, STEPS_MM[place]
        self.row, self.column = divmod(place, _COLUMNS)
        self.item = fixed_plot()
        card.view.addItem(self.item, row=self.row, col=self.column)
        self.image = pg.ImageItem(lut=card.shades)
        self.marks = pg.ScatterPlotItem(pen=pg.mkPen(style.LIGHT.surface, width=1), brush=None)
        self.shown = pg.PlotCurveItem(pen=pg.mkPen(style.LIGHT.surface, width=1))  # about its cell: within the map
        for drawn in (self.image, self.shown, self.marks):
            self.item.addItem(drawn)
        marks = [(i + 0.5, f"{step:g}") for i, step in enumerate(STEPS_MM)]
        for side in ("left", "bottom"):
            ruler = self.item.getAxis(side)
            ruler.setTicks([marks[1::2], [(at, "") for at, _ in marks]])
            ruler.setStyle(tickLength=style.STEP)  # outside
            ruler.setZValue(-1)  # else its line covers that of a mark
        self.item.setRange(xRange=(0, len(STEPS_MM)), yRange=(0, len(STEPS_MM)), padding=0)
        box = self.item.getViewBox()
        box.setFlag(box.GraphicsItemFlag.ItemClipsChildrenToShape, False)  # marks in the outer cells are whole

    def clicked(self, event: Any, cavities: int) -> None:
        box = self.item.getViewBox()
        if box.sceneBoundingRect().contains(event.scenePos()):
            at = box.mapSceneToView(event.scenePos())
            self.model.pick(cavities, self.width_mm, at.x(), at.y())

    def show_sweep(self, sweep: SweepSummary, cavities: int) -> None:
        """Draw one map and mark the best design, the paper's optimum and the one shown, where they are in it."""
        self.image.setImage(sweep.grid(cavities, self.width_mm, STEPS_MM), levels=(0.0, 1.0))
        marked = [(sweep.values[sweep.best], "star")]
        if sweep.paper >= 0:
            marked.append((sweep.values[sweep.paper], "o"))
        places = [(self._place(cavities, values), symbol) for values, symbol in marked]
        self.marks.setData([{"pos": at, "symbol": symbol, "size": MARK} for at, symbol in places if at])
        mapped = self.model.face == MAPPED_FACE
        cell = self._place(cavities, np.array(self.model.values)) if mapped else ()
        x, y = (np.array(cell) + CORNERS).T if cell else (np.zeros(0), np.zeros(0))
        self.shown.setData(x, y)

    def _place(self, cavities: int, values: FloatArray) -> tuple[float, ...]:
        """Return the cell of a design in this map; empty when it is in another one, or off the grid."""
        if values[0] != cavities or abs(values[1] - self.width_mm) > ON_GRID_MM:
            return ()
        near = np.abs(np.array(STEPS_MM) - values[[3, 2], None]) < ON_GRID_MM  # [spacing and depth, steps]
        return tuple((near.argmax(axis=1) + 0.5).tolist()) if near.any(axis=1).all() else ()

    def paint_theme(self, theme: Theme) -> None:
        paint_axis(self.item, "left", theme, "Depth (mm)" if self.column == 0 else "")
        lowest = self.row == (len(STEPS_MM) - 1) // _COLUMNS
        paint_axis(self.item, "bottom", theme, "Spacing (mm)" if lowest else "")
        self.item.setTitle(f"width {self.width_mm:g} mm", color=theme.muted, size=f"{style.FONT_SMALL}px")


class MapsCard(PlotCard):
    """The maps of P for all widths, as in the paper's figure 3D."""

    def __init__(self, model: OpticsModel) -> None:
        super().__init__("Figure of merit P", MERIT)
        self.model = model
        counts = [(f"{n} cavities", n) for n in CAVITIES]
        self.cavities = controls.choice("Cavities of the maps", counts, lambda _: self.show_sweep())
        self.cavities.setCurrentIndex(1)
        self.bar.insertWidget(1, self.cavities)
        shades = [QColor(style.sequential(i, SHADES)) for i in range(SHADES)]
        self.shades = np.array([[c.red(), c.green(), c.blue()] for c in shades], dtype=np.ubyte)
        self.maps = [MeritMap(self, place, model) for place in range(len(STEPS_MM))]
        self.scale = self._scale()
        self.view.scene().sigMouseClicked.connect(self._clicked)

    def _scale(self) -> Any:
        item = fixed_plot()
        self.view.addItem(item, row=0, col=_COLUMNS, rowspan=2)
        item.showAxes((False, False, True, False), showValues=(False, False, True, False))
        item.setMaximumWidth(SCALE_WIDTH)
        item.setRange(xRange=(0, 1), yRange=(0, 1), padding=0)
        item.getAxis("right").setTicks([[(i / 5, f"{i / 5:g}" if i else "\u2264 0") for i in range(6)]])
        item.layout.setContentsMargins(0, style.GAP, 0, style.GAP)
        item.addItem(pg.ImageItem(np.linspace(0, 1, SHADES)[None, :], rect=(0, 0, 1, 1), lut=self.shades))
        return item

    def columns(self) -> Columns:
        """Return every design of the sweep with its merit and rank."""
        sweep = self.model.sweep
        return (
            {}
            if sweep is None
            else designs(sweep) | {"merit P, best = 1": sweep.merit.p_normalised, "rank": sweep.ranks}
        )

    def _clicked(self, event: Any) -> None:
        for shown in self.maps:
            shown.clicked(event, int(self.cavities.currentData()))

    def follow_design(self) -> None:
        """Show the maps of the shown design's number of cavities, where there are some."""
        at = self.cavities.findData(self.model.values[0])
        if at >= 0:
            self.cavities.setCurrentIndex(at)
        self.show_sweep()

    def show_sweep(self) -> None:
        sweep = self.model.sweep
        self.show_empty("" if sweep is not None else f"{SWEEP_FIRST}map the merit of each design.")
        self.cavities.setVisible(sweep is not None)
        self.readout.setText("" if sweep is None else "\u2606 best   \u25cb paper's   \u25a1 shown")
        if sweep is not None:
            for shown in self.maps:
                shown.show_sweep(sweep, int(self.cavities.currentData()))

    def paint_theme(self, theme: Theme) -> None:
        super().paint_theme(theme)
        paint_axis(self.scale, "right", theme, RELATIVE)
        for shown in self.maps:
            shown.paint_theme(theme)
        self.show_sweep()


class StripCard(PlotCard):
    """All designs by falling figure of merit: best and paper's marked, those that cannot be told apart filled."""

    def __init__(self, model: OpticsModel) -> None:
        super().__init__("Designs by figure of merit", STRIP)
        self.model = model
        self.plot = self.add(RELATIVE, "", x_title="Place by merit")
        self.plot.item.setMouseEnabled(False, False)
        self.tied_band = self.plot.band("Cannot be told from the best, area", lambda t: t.accent)
        self.others = self.plot.points("Other designs", lambda t: t.target, filled=False, size=4)
        self.tied = self.plot.points("Cannot be told from the best", lambda t: t.accent, size=4)
        self.best = self.plot.points("Best", lambda t: t.text, filled=False, symbol="star", size=14)
        self.paper = self.plot.points("Paper's", sensor_colour(2), symbol="d", size=12)
        self.view.scene().sigMouseClicked.connect(self._clicked)
        self.setMaximumHeight(style.STRIP_PLOT_HEIGHT)

    def _clicked(self, event: Any) -> None:
        box = self.plot.item.getViewBox()
        if box.sceneBoundingRect().contains(event.scenePos()):
            self.model.show_place(round(box.mapSceneToView(event.scenePos()).x()))

    def show_sweep(self) -> None:
        s = self.model.sweep
        self.show_empty("" if s is not None else f"{SWEEP_FIRST}see all designs in their order.")
        if s is None:
            self.clear()
            return
        order, merit = s.strip()
        place, tied = np.arange(1.0, len(order) + 1.0), np.asarray(s.tied, dtype=bool)[order]
        edges = np.repeat(place, 2) + np.tile([-0.5, 0.5], len(place))  # no area of others between them
        self.tied_band.fill(edges, np.zeros(len(edges)), np.repeat(np.where(tied, merit, 0.0), 2))
        for layer, chosen in (
            (self.tied, tied), (self.others, ~tied), (self.best, order == s.best), (self.paper, order == s.paper),
        ):  # fmt: skip
            layer.set(place[chosen], merit[chosen])
        self.readout.setText("\u2606 best   \u25c6 paper's   filled: cannot be told from the best")
        self.plot.x_range(*axis.padded(1.0, float(len(order)), _STRIP_MARGIN))
        self.plot.y_range(min(0.0, float(merit.min())) - _STRIP_MARGIN, 1.0 + 8 * _STRIP_MARGIN)

    def columns(self) -> Columns:
        """Return every design of the sweep with its merit, rank, and whether it can be told from the best."""
        s = self.model.sweep
        if s is None:
            return {}
        found = {"merit P, best = 1": s.merit.p_normalised, "rank": s.ranks}
        return designs(s) | found | {"like the best (flags)": np.asarray(s.tied, dtype=int)}


class OpticsPage(ReflowingPage):
    """The optics page: which design is best and how sure that is, and one design in its states."""

    def __init__(self, model: OpticsModel, services: Services) -> None:
        super().__init__()
        self.model, self.services = model, services
        self._revision = -1
        self.scene, self.response = SceneCard(), ResponseCard()
        self.strip, self.maps = StripCard(model), MapsCard(model)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setAccessibleName("State, from compressed to elongated")
        self.slider.setRange(0, STATES - 1)
        self.slider.setPageStep(1)
        self.slider.setValue(self.model.state)
        self.slider.valueChanged.connect(self._slide)
        self.first = self.slider
        states = controls.row(controls.label("compressed", "small"), self.slider, controls.label("elongated", "small"))
        keep = services.preferences
        shown = controls.holder(controls.column(self._design(), (self.scene, 1), states, spacing=style.GAP))
        self.ranks = controls.label("", "muted", wrap=True, name="Ranks, turns of the fan and errors of the sweep")
        self.details = controls.inside(controls.column(self.ranks))
        self.details.hide()
        left = Shares("maps", keep, (self.strip, 2), (self.maps, 5))
        right = Shares("rays", keep, (shown, 5), (self.response, 4))
        across = Shares("optics", keep, (left, 1), (right, 1), beside=True)
        layout = controls.page_layout(self)
        layout.addWidget(controls.card(self._answer(), self.details)[0])
        layout.addWidget(across, 1)
        self.rows = (across,)
        self.tall = (self.maps, self.scene, self.response)
        model.show_shipped(shipped_sweep)

    def reflow(self) -> None:
        """Give the maps, in two rows, the height of the titles of their axes."""
        super().reflow()
        if self.narrow:
            self.maps.setMinimumHeight(style.STACKED_HEIGHT + 2 * style.PLOT_MORE)

    def _answer(self) -> QHBoxLayout:
        """Return which design is best, the paper's, how sure that is, and the buttons for more."""
        attempt = self.services.notices.attempt
        self.best, self.paper = controls.label("", "subtitle", wrap=True), controls.label("", wrap=True)
        self.certainty = controls.label("", "muted", wrap=True, name="How sure the best design is")
        self.outcome = controls.label("", "muted", wrap=True, name="Why there is no sweep")
        texts = controls.column(self.best, self.paper, self.certainty, self.outcome)
        self.sweep_button = controls.button("Sweep all designs", lambda: attempt(self._sweep), "primary")
        self.details_button = controls.button("Details", self._toggle_details, tip="Ranks, turns, errors")
        self.details_button.setCheckable(True)
        self.best_button = controls.button("Show best", self.model.show_best)
        self.paper_button = controls.button("Show paper's", self.model.show_paper)
        buttons = QGridLayout()
        four = self.best_button, self.paper_button, self.sweep_button, self.details_button
        for i, button in enumerate(four):
            buttons.addWidget(button, i // 2, i % 2)
        return controls.row((texts, 1), buttons)

    def _sweep(self) -> None:
        self.model.toggle_sweep(self.model.more_rays)

    def _toggle_details(self) -> None:
        self.details.setVisible(self.details_button.isChecked())

    def _design(self) -> QWidget:
        """Return the design that is shown, a labelled choice for each of its values."""
        steps = [(f"{step:g}", step) for step in STEPS_MM]
        counts = [(str(n), n) for n in CAVITIES]
        self.fields = {"cavities": controls.choice("Number of cavities", counts, self._choose)}
        for name in ("width", "depth", "spacing"):
            self.fields[name] = controls.choice(f"{name.capitalize()} in mm", steps, self._choose)
        faces = [(words, face) for face, words in FACE_NAMES.items()]
        tip = "The wall of the light guide with the cavities, or voids on its midline"
        self.face = controls.choice("Face with the cavities", faces, self._choose, tip=tip)
        names = ("Cavities", "Width, mm", "Depth, mm", "Spacing, mm", "Face")
        return controls.inside(labelled(zip(names, (*self.fields.values(), self.face), strict=True)))

    def _choose(self, _: object) -> None:
        n, width, depth, spacing = (field.currentData() for field in self.fields.values())
        self.model.choose((int(n), float(width), float(depth), float(spacing)), str(self.face.currentData()))
        self.refresh()

    def _slide(self, state: int) -> None:
        self.model.state = state
        self.scene.show_state(self.model)
        if self.model.result is not None:
            self.response.now.setValue(self.model.result.elongation_mm[state])

    def _show_choices(self) -> None:
        for field, value in zip(self.fields.values(), self.model.values, strict=True):
            select(field, value, f"{value:.3g}")
        select(self.face, self.model.face, self.model.face)

    def refresh(self, snapshot: SessionSnapshot | None = None) -> None:
        """Show design and sweep where they have changed; the first call traces the paper's design."""
        model = self.model
        if snapshot is not None:
            held = snapshot.link is LinkState.UP and snapshot.commanded  # by hand, beside an armed plan, too
            model.blocked = RUNNING if held or snapshot.under_way else ""
        first = model.result is None and not model.running("optics") and not model.problem
        if first or (model.waits and not model.blocked):
            model.choose(model.values)
        self._show_buttons()
        if model.running("optics"):
            controls.set_text(self.response.readout, model.design_text())  # how much is done
            if model.result is None:
                self.scene.show_state(model)
                self.response.show_result(model)
        if model.revision == self._revision:
            return
        self._revision = model.revision
        self._show_choices()
        self._show_answer()
        self.scene.show_state(model)
        self.scene.plot.fit()
        self.response.show_result(model)
        self.maps.follow_design()
        self.strip.show_sweep()

    def _show_buttons(self) -> None:
        model = self.model
        more = f"Trace {number(model.more_rays, 0)} rays" if model.more_rays else "Sweep all designs"
        controls.set_text(self.sweep_button, "Stop the sweep" if model.running("sweep") else more)
        controls.set_state(self.sweep_button, "" if model.more_rays else "primary", "role")
        controls.allow(self.sweep_button, "" if model.running("sweep") else model.blocked)
        for button in (self.best_button, self.paper_button):
            controls.allow(button, model.blocked)

    def _show_answer(self) -> None:
        """Show which design is best, and how sure that is."""
        model = self.model
        best, paper = model.best_text(), model.paper_text()
        self.best.setText(f"Best: {best}" if best else WHAT_COMES)
        self.paper.setText(f"Paper: {paper}")
        self.certainty.setText(model.certainty_text())
        self.outcome.setText(f"\u25b2 {model.sweep_problem}" if model.sweep_problem else "")
        self.ranks.setText(model.sweep_text() or "Ranks are shown here once all designs are swept.")
        for label, shown in (
            (self.paper, bool(paper)),
            (self.certainty, bool(best)),
            (self.outcome, bool(self.outcome.text())),
        ):
            label.setVisible(shown)
        for button, shown in ((self.best_button, bool(best)), (self.paper_button, bool(paper))):
            button.setVisible(shown)


def labelled(fields: Iterable[tuple[str, QWidget]]) -> QGridLayout:
    """Return fields side by side, each below its name."""
    grid = controls.grid()
    grid.setVerticalSpacing(0)
    for k, (name, field) in enumerate(fields):
        grid.addWidget(controls.label(name, "small"), 0, k)
        grid.addWidget(field, 1, k)
    grid.setColumnStretch(grid.columnCount(), 1)
    return grid


def select(field: QComboBox, value: object, text: str) -> None:
    """Select a value; one that is not offered is added at the end while it is selected."""
    offered = int(field.property("offered") or field.count())
    field.setProperty("offered", offered)
    while field.count() > offered:
        field.removeItem(offered)
    if field.findData(value) < 0:
        field.addItem(text, value)
    field.setCurrentIndex(field.findData(value))
