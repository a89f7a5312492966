"""The head of the window: who is connected and how well, which unit, and VENT. Always there, on every page."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QSizePolicy, QWidget

from boat_daq.engine.session import SessionSnapshot
from boat_daq.gui import style, widgets
from boat_daq.viewmodels.connection import link_text
from boat_daq.viewmodels.desk import Desk

FIGURES = 4


class Header(QWidget):
    """The head of the window; `refresh` shows a snapshot."""

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.desk = desk
        self.setObjectName("header")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.setFixedHeight(style.HEADER_HEIGHT)
        self.simulated = widgets.label("SIMULATED", "simulated", name="This board is simulated")
        self.link = widgets.button("", desk.ask_connect, name="Connection", tip="Choose the port (Ctrl+K)")
        self.figures = [widgets.label("", "muted") for _ in range(FIGURES)]
        self.unit = widgets.button(
            "", desk.show_unit, name="Unit and calibration", tip="Unit on the bench and its calibration"
        )
        self.vent = vent_button(desk)
        layout = self.line = QHBoxLayout(self)
        layout.setContentsMargins(style.PAGE_MARGIN, 0, style.PAGE_MARGIN, 0)
        layout.setSpacing(style.CARD_PADDING)
        self.brand = widgets.label("boat-daq", "brand")
        for widget in (self.brand, self.simulated, self.link, *self.figures):
            layout.addWidget(widget, 0, Qt.AlignmentFlag.AlignVCenter)
        layout.addStretch(1)
        layout.addWidget(self.unit)
        layout.addWidget(self.vent)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave the program's name out on a narrow window: it stands in the title, and VENT must be whole."""
        narrow = self.width() < style.NARROW_BELOW
        self.brand.setVisible(not narrow)
        self.line.setSpacing(style.GAP if narrow else style.CARD_PADDING)
        super().resizeEvent(event)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the link, its figures, the unit."""
        text = link_text(snapshot)
        words = text.word if not text.who else f"{text.who}  {text.word}"
        widgets.set_text(
            self.link,
            f"{text.shape}  {words}"
            if not self.desk.connection.starting
            else "\u25d4  starting the virtual board \u2026",
        )
        widgets.set_state(self.link, text.state)
        self.simulated.setVisible(snapshot.simulated)
        for i, label in enumerate(self.figures):
            figure, state = text.figures[i] if i < len(text.figures) else ("", "")
            widgets.set_text(label, figure)
            widgets.set_state(label, state)
            label.setVisible(bool(figure))
        widgets.set_text(self.unit, self.desk.unit_text(snapshot))


def vent_button(desk: Desk) -> QPushButton:
    """Return the big red button; it acts on the press, not on the release."""
    button = QPushButton("VENT   Esc")
    button.setObjectName("vent")
    button.setAccessibleName("Vent the actuator now")
    button.setToolTip("Vent now, in any state (Esc)")
    button.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    button.pressed.connect(desk.vent)
    return button
