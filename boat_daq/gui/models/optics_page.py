"""The optics page: a design in the state of a slider, the sweep over all designs, the search beyond them."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QSlider, QWidget

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.models.optics_plots import MapsCard, ParetoCard, ResponseCard, SceneCard
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.gui.widgets.layouts import ReflowingPage
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.models.optics import CAVITIES, CURVES, FACES, RAYS, STATES, STEPS_MM, OpticsModel

FROM_FILE = "file"
WHAT_COMES = (
    "\u201cSweep all designs\u201d simulates 648 designs in 15 states each and maps their merit; "
    "\u201cOptimise\u201d searches between and beyond them."
)


class OpticsPage(ReflowingPage):
    """The optics page.

    Parameters
    ----------
    model : the view model.
    services : of the window.
    """

    def __init__(self, model: OpticsModel, services: Services) -> None:
        super().__init__()
        self.model, self.services = model, services
        self._revision = -1
        self.scene, self.response = SceneCard(), ResponseCard()
        self.maps, self.pareto = MapsCard(self.model), ParetoCard(self.model)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setAccessibleName("State, from compressed to elongated")
        self.slider.setRange(0, STATES - 1)
        self.slider.setPageStep(1)
        self.slider.setValue(self.model.state)
        self.slider.valueChanged.connect(self._slide)
        self.first = self.slider
        head = self._head()
        states = widgets.row(widgets.label("compressed", "small"), self.slider, widgets.label("elongated", "small"))
        left = widgets.column((self.scene, 5), states, (self.response, 4), spacing=style.GAP)
        right = widgets.column((self.maps, 5), (self.pareto, 4), spacing=style.GAP)
        across = widgets.row((left, 1), (right, 1))
        layout = widgets.page_layout(self)
        layout.addWidget(head)
        layout.addLayout(across, 1)
        self.rows = (across, self.choices)
        self.tall = (self.scene, self.response, self.maps, self.pareto)

    def _head(self) -> QWidget:
        steps = [(f"{step:g}", step) for step in STEPS_MM]
        counts = [(str(n), n) for n in CAVITIES]
        self.fields = {"cavities": widgets.choice("Number of cavities", counts, self._choose)}
        for name in ("width", "depth", "spacing"):
            self.fields[name] = widgets.choice(f"{name.capitalize()} in mm", steps, self._choose)
        faces, tip = [(f"{face} face", face) for face in FACES], "The wall of the light guide with the cavities"
        self.face = widgets.choice("Face with the cavities", faces, self._choose, tip=tip)
        curves = [*((words, name) for name, words in CURVES.items()), ("From a file \u2026", FROM_FILE)]
        tip = "Shape of the actuator's wall in each state: computed, by a formula, or measured"
        self.curves = widgets.choice("Deformation curves", curves, self._choose_curves, tip=tip)
        rays = [(f"{n} rays" if n else "Rays: automatic", n) for n in RAYS]
        tip = "Automatic: by the precision that is chosen in the Models menu"
        self.rays = widgets.choice("Rays", rays, self.model.set_rays, tip=tip)
        design = (widgets.label(text, "muted") for text in ("Cavities", "Width, depth, spacing, mm"))
        cavities, *lengths = self.fields.values()
        left = widgets.row(next(design), cavities, next(design), *lengths, self.face, None)
        self.choices = widgets.row((left, 1), widgets.row(self.curves, self.rays, None))
        return widgets.card(self.choices, self._actions())[0]

    def _actions(self) -> QHBoxLayout:
        attempt = self.services.notices.attempt
        self.outcome = widgets.label("", "muted", wrap=True, name="Results of the sweep and the search")
        self.show_button = widgets.button("Show it", self.model.show_optimum, name="Show the optimised design")
        tip = "Search width, depth, spacing, count and face beyond the grid, under a minute"
        self.search_button = widgets.button("Optimise", partial(attempt, self.model.toggle_search), tip=tip)
        self.sweep_button = widgets.button("Sweep all designs", partial(attempt, self.model.toggle_sweep), "primary")
        return widgets.row((self.outcome, 1), self.show_button, self.search_button, self.sweep_button)

    def _choose(self, _: object) -> None:
        n, width, depth, spacing = (field.currentData() for field in self.fields.values())
        self.model.choose((int(n), float(width), float(depth), float(spacing)), str(self.face.currentData()))
        self._show_model()

    def _choose_curves(self, name: str) -> None:
        if name == FROM_FILE:
            self._show_choices()  # the choice before, until a file is chosen
            ask_open(self, self.services, "Open deformation curves", "csv txt", self.take_file)
        else:
            self.model.set_curves(name)

    def take_file(self, path: Path) -> None:
        """Use the deformation curves of a file."""
        self.model.set_curves(str(path))

    def _slide(self, state: int) -> None:
        self.model.state = state
        self.scene.show_state(self.model)
        if self.model.result is not None:
            self.response.now.setValue(self.model.result.elongation_mm[state])

    def _show_choices(self) -> None:
        for field, value in zip(self.fields.values(), self.model.values, strict=True):
            select(field, value, f"{value:.3g}")
        select(self.face, self.model.face, self.model.face)
        select(self.curves, self.model.curves, self.model.curves_text(self.model.curves))
        self.rays.setCurrentIndex(self.rays.findData(self.model.rays))

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show design, sweep and search where they have changed."""
        self._show_model()

    def _show_model(self) -> None:
        """Show what has changed; the first call traces the paper's design."""
        model = self.model
        if model.result is None and not model.running("optics") and not model.problem:
            model.choose(model.values)
        widgets.set_text(self.sweep_button, "Stop the sweep" if model.running("sweep") else "Sweep all designs")
        widgets.set_text(self.search_button, "Stop the search" if model.running("optimise") else "Optimise")
        if model.revision == self._revision:
            return
        self._revision = model.revision
        self._show_choices()
        found = "\n".join(filter(None, (model.sweep_text(), model.optimum_text())))
        self.outcome.setText(found or WHAT_COMES)
        self.show_button.setVisible(model.optimum is not None)
        self.scene.show_state(model)
        self.scene.plot.fit()
        self.response.show_result(model)
        self.maps.follow_design()
        self.pareto.show_sweep()


def select(field: QComboBox, value: object, text: str) -> None:
    """Select a value.

    Parameters
    ----------
    field : of the choices.
    value : one that is not offered is added at the end while it is selected.
    text : of an added value.
    """
    offered = int(field.property("offered") or field.count())
    field.setProperty("offered", offered)
    while field.count() > offered:
        field.removeItem(offered)
    if field.findData(value) < 0:
        field.addItem(text, value)
    field.setCurrentIndex(field.findData(value))
