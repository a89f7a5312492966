"""The panel for the layout of the live plots: where each quantity is shown. Not modal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from PySide6.QtWidgets import QCheckBox, QComboBox, QDialog, QGridLayout, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.layout import CAMERA, ELONGATION, PRESSURE, Layout, Layouts
from boat_daq.viewmodels.live.live_model import LiveModel
from protocol.base.units import as_text

OWN, HIDDEN = "", "hidden"  # places besides the plot of another quantity
AGAINST = {PRESSURE: "Pressure", ELONGATION: "Elongation", CAMERA: "Camera"}
_EXPLANATION = "Kept for this unit. Drag the border between two plots to change their heights (undo: Ctrl+Z)."


class LayoutPanel(QDialog):
    """Changes the layout; each change is seen at once."""

    def __init__(self, parent: QWidget, layouts: Layouts, live: LiveModel, services: Services) -> None:
        super().__init__(parent)
        self.layouts, self.live, self.attempt = layouts, live, services.notices.attempt
        self._shown: object = None
        self.setWindowTitle("Layout of the plots")
        self.setModal(False)
        self.setMinimumWidth(style.FORM_WIDTH)
        self.grid = QGridLayout()
        self.grid.setColumnStretch(0, 1)
        self.places: dict[str, QComboBox] = {}
        self.sides: dict[str, QComboBox] = {}
        self.against = {x: QCheckBox(text) for x, text in AGAINST.items()}
        for x, box in self.against.items():
            box.setAccessibleName(f"Signals against {AGAINST[x].lower()}")
            box.clicked.connect(self._set_against)
        usual = controls.button("Usual layout", lambda: self._change(Layout()))
        self.setLayout(
            controls.column(
                controls.label(_EXPLANATION, "muted", wrap=True),
                self.grid,
                controls.row(controls.label("Signals against"), *self.against.values(), None),
                controls.row(usual, None, controls.button("Close", self.close)),
                spacing=style.GAP,
                margins=(style.PAGE_MARGIN,) * 4,
            )
        )

    def open_fresh(self) -> None:
        """Show the panel."""
        self._shown = None
        self.refresh()
        self.show()
        self.raise_()

    def refresh(self) -> None:
        """Show the layout where it has changed, or what the board measures has."""
        wanted = (self.layouts.current, self.live.quantities())
        if self._shown is not None and (wanted == self._shown or not self.isVisible()):
            return
        self._shown = wanted
        layout, quantities = wanted
        for x, box in self.against.items():
            box.setChecked(x in layout.against)
        self._fill(layout.complete(quantities), quantities)

    def _fill(self, layout: Layout, quantities: list[str]) -> None:
        """Fill the grid with a row for each quantity, in the order of the plots."""
        controls.clear(self.grid)
        for k, text in enumerate(("Quantity", "Shown", "Axis", "")):
            self.grid.addWidget(controls.label(text, "muted"), 0, k)
        plots = layout.plots(quantities)
        shown = [q for plot in plots for q in plot.all]
        hosts = [plot.all[0] for plot in plots]
        self.places, self.sides = {}, {}
        for i, quantity in enumerate([*shown, *(q for q in quantities if q not in shown)], 1):
            plot, name = next((plot for plot in plots if quantity in plot.all), None), self.live.title(quantity)
            own = plot is None or len(plot.all) == 1 or quantity == plot.all[0]
            entries = [("in a plot of its own", OWN)]
            entries += [(f"with {self.live.title(host).lower()}", host) for host in hosts if host != quantity]
            place = self._choice(f"Place of {name}", [*entries, ("hidden", HIDDEN)], quantity, self._place)
            at = HIDDEN if plot is None else OWN if own else plot.all[0]
            place.setCurrentIndex(place.findData(at))
            side = self._choice(f"Axis of {name}", [("left", False), ("right", True)], quantity, self._side)
            side.setCurrentIndex(int(plot is not None and quantity in plot.right))
            controls.allow(side, "" if plot is not None and len(plot.all) > 1 else "It is alone in its plot.")
            up, down = (
                controls.button(sign, partial(self._move, quantity, by), "quiet", name=f"Move {name} {way}")
                for sign, by, way in (("\u2191", -1, "up"), ("\u2193", 1, "down"))
            )
            for button, end in ((up, hosts[:1]), (down, hosts[-1:])):
                button.setVisible(bool(own and plot is not None))
                controls.allow(button, "It is at the end already." if quantity in end else "")
            stored = self.live.unit(quantity)
            in_unit = f" ({as_text(self.live.units.shown(stored).symbol)})" if stored else ""
            cells = (controls.label(f"{name}{in_unit}"), place, side, up, down)
            for k, widget in enumerate(cells):
                self.grid.addWidget(widget, i, k)
            self.places[quantity], self.sides[quantity] = place, side

    def _choice(
        self, name: str, entries: list[tuple[str, object]], quantity: str, act: Callable[..., None]
    ) -> QComboBox:
        return controls.choice(name, entries, partial(act, quantity))

    def _complete(self) -> Layout:
        return self.layouts.current.complete(self.live.quantities())

    def _place(self, quantity: str, place: str) -> None:
        layout = self._complete()
        self._change(layout.without(quantity) if place == HIDDEN else layout.placed(quantity, place))

    def _side(self, quantity: str, right: bool) -> None:
        self._change(self._complete().with_axis(quantity, right=right))

    def _move(self, quantity: str, below: int) -> None:
        self._change(self._complete().moved(quantity, below, self.live.quantities()))

    def _set_against(self, *_: object) -> None:
        chosen = tuple(x for x, box in self.against.items() if box.isChecked())
        self._change(replace(self.layouts.current, against=chosen))

    def _change(self, layout: Layout) -> None:
        self.attempt(partial(self.layouts.change, layout))
        self._shown = None  # a refused choice is taken back
        self.refresh()
