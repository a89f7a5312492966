"""The live page before the first sample: what to do, in three steps."""

from __future__ import annotations

from functools import partial

from PySide6.QtWidgets import QFrame, QGridLayout, QScrollArea, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common.services import Panel, Services
from boat_daq.viewmodels.live.connection import ConnectionModel

STEPS = (
    (
        "Connect",
        "Plug in the board and choose its port, or start the virtual board: a simulated unit like SA1, for practice.",
    ),
    (
        "Run the plan",
        "Arm checks the limits, Start records and runs the cycles. At each plateau, type the elongation on the "
        "millimetre grid and press Enter.",
    ),
    (
        "Accept the calibration",
        "The Calibrate page fits the run and shows its bands and figures. Once accepted, the elongation is shown live "
        "in millimetres.",
    ),
)


class FirstSteps(QScrollArea):
    """Three steps from a board to a calibration."""

    def __init__(self, connection: ConnectionModel, services: Services) -> None:
        super().__init__()
        self.board = widgets.button("Connect a board …", partial(services.show, Panel.CONNECT))
        start = partial(services.notices.attempt, connection.start_virtual_board)
        self.virtual = widgets.button("Start the virtual board", start, "primary")
        self.plan = widgets.button("Show the plan", partial(services.show, Panel.PLAN))
        buttons = ((self.virtual, self.board), (self.plan,), ())
        steps = [self._step(str(i), *STEPS[i - 1], *each) for i, each in enumerate(buttons, 1)]
        frame, inside = widgets.card(widgets.label("From a board to a calibration", "title"), *steps)
        frame.setMaximumWidth(style.FORM_WIDTH + style.PANE_WIDTH)
        inside.setContentsMargins(*(6 * style.STEP,) * 4)
        inside.setSpacing(style.CARD_PADDING)
        across = widgets.row(None, (frame, 100), None)  # no alignment: an aligned frame does not wrap its text
        self.setWidgetResizable(True)
        self.setWidget(widgets.holder(widgets.column(None, across, None)))

    def _step(self, number: str, title: str, text: str, *buttons: QWidget) -> QFrame:
        grid = QGridLayout()
        grid.setColumnStretch(1, 1)
        grid.setHorizontalSpacing(style.CARD_PADDING)
        digit = widgets.label(number, "title")
        digit.setFixedWidth(6 * style.STEP)
        grid.addWidget(digit, 0, 0)
        grid.addWidget(widgets.label(title, "subtitle"), 0, 1)
        grid.addWidget(widgets.label(text, "muted", wrap=True), 1, 1)
        if buttons:
            grid.addLayout(widgets.row(*buttons, None), 2, 1)
        return widgets.card(grid)[0]
