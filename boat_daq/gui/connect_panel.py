"""The ways to connect: a board at a port, another firmware through a profile, the virtual board. Not modal."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QDialog, QGridLayout, QPlainTextEdit, QVBoxLayout, QWidget

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.status_strip import sentence
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.viewmodels.common.notices import Notice
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.connection import VIRTUAL_UNITS, ConnectionModel

SPEEDS = (("real time", 1.0), ("5 times faster", 5.0), ("20 times faster", 20.0))


class ConnectPanel(QDialog):
    """Choose a port and connect."""

    def __init__(self, parent: QWidget, connection: ConnectionModel, services: Services) -> None:
        super().__init__(parent)
        self.connection, self.services = connection, services
        self.setWindowTitle("Connect")
        self.setModal(False)
        self.setMinimumWidth(style.FORM_WIDTH)
        self.port = QComboBox()
        self.port.setEditable(True)
        self.port.setAccessibleName("Port")
        typed = widgets.field("Port", placeholder="a port, socket://HOST:PORT or replay:FILE")
        typed.returnPressed.connect(self.connect_board)
        self.port.setLineEdit(typed)
        self.unit = widgets.field("Unit on the bench", connection.unit, width=3 * style.CONTROL_HEIGHT)
        self.profile = QPlainTextEdit()
        self.profile.setAccessibleName("Profile of another firmware")
        self.profile.setPlaceholderText(
            "Empty for a BOAT board. Else paste an RX8 line of Bridge Control Panel here, "
            "or a profile: its TOML text, or the path of its file."
        )
        self.profile.setTabChangesFocus(True)
        self.profile.setProperty("role", "paste")  # its height is the sheet's, which knows no other
        self.profile.setPlainText(connection.profile)
        self.virtual_unit = widgets.choice("Unit of the virtual board", [(u, u) for u in VIRTUAL_UNITS])
        self.speed = widgets.choice("Speed of the virtual board", list(SPEEDS))
        layout = QVBoxLayout(self)
        layout.setSpacing(style.CARD_PADDING)
        layout.addWidget(self._board())
        layout.addWidget(self._virtual())

    def _board(self) -> QWidget:
        frame, inside = widgets.card()
        inside.addWidget(widgets.label("A board", "subtitle"))
        inside.addWidget(
            widgets.label(
                "It is recognised by what it says of itself, whatever its port is called.", "muted", wrap=True
            )
        )
        self.none = widgets.label("\u25b2 No port is there. Plug in the board, then look again.", "muted", wrap=True)
        inside.addWidget(self.none)
        grid = QGridLayout()
        grid.addWidget(widgets.label("Port"), 0, 0)
        grid.addWidget(self.port, 0, 1)
        grid.addWidget(widgets.button("Look again", self.look_again), 0, 2)
        grid.addWidget(widgets.label("Unit"), 1, 0)
        grid.addWidget(self.unit, 1, 1)
        grid.addWidget(widgets.label("Other firmware"), 2, 0, Qt.AlignmentFlag.AlignTop)
        grid.addWidget(self.profile, 2, 1)
        grid.addWidget(widgets.button("Open …", self._open_profile), 2, 2, Qt.AlignmentFlag.AlignTop)
        grid.setColumnStretch(1, 1)
        inside.addLayout(grid)
        self.connect_button = widgets.button("Connect", self.connect_board, "primary")
        self.disconnect_button = widgets.button("Disconnect", self.disconnect_board)
        self._complaint: Notice | None = None
        self.refused = widgets.label("", "", wrap=True, name="Why it was not connected")
        widgets.set_state(self.refused, "fault")
        self.refused.hide()
        inside.addWidget(self.refused)
        inside.addLayout(widgets.row(None, self.disconnect_button, self.connect_button))
        return frame

    def _virtual(self) -> QWidget:
        frame, inside = widgets.card()
        inside.addWidget(widgets.label("The virtual board", "subtitle"))
        inside.addWidget(
            widgets.label(
                "A simulated unit, pump and board, to learn and to try. All it gives is marked SIMULATED.",
                "muted",
                wrap=True,
            )
        )
        self.virtual_button = widgets.button("Start the virtual board", self.start_virtual)
        inside.addLayout(widgets.row(self.virtual_unit, self.speed, None, self.virtual_button))
        return frame

    def open_fresh(self) -> None:
        """Look for ports and show the panel."""
        self.look()
        self.connection.ask_boards()
        self.unit.setText(self.connection.unit)
        self.refused.hide()
        self.show()
        self.raise_()
        self.port.setFocus()

    def look_again(self) -> None:
        """Look for ports, and ask them who they are."""
        self.look()
        self.connection.ask_boards()

    def look(self) -> None:
        """Look for ports again."""
        typed = self.port.currentText() or self.connection.last_port
        self.port.clear()
        ports = self.connection.ports()
        for found in ports:
            self.port.addItem(found.text, found.port)
        self.none.setVisible(not ports)
        self.adjustSize()
        self.port.setEditText(typed)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show which ports have said that they are boards, and whether there is a link to close."""
        widgets.allow(self.disconnect_button, "" if snapshot.port is not None else "Nothing is connected.")
        if self.isVisible() and self.connection.heard_boards():
            self.look()

    def connect_board(self) -> None:
        """Connect to the port that is chosen or typed."""
        text = self.port.currentText()
        known = self.port.findText(text)
        port = str(self.port.itemData(known)) if known >= 0 else text

        def deed() -> None:
            self.connection.set_unit(self.unit.text())
            self.connection.connect(port, self.profile.toPlainText().strip())

        if self._complaint is not None:  # what was wrong is mended, or said anew
            self.services.notices.dismiss(self._complaint)
        if self.services.notices.attempt(deed):
            self._complaint = None
            self.refused.hide()
            self.hide()
        else:  # what was typed stays here, with what is wrong with it
            notice = self._complaint = self.services.notices.history[-1]
            self.refused.setText("\u25b2 " + " ".join(map(sentence, filter(None, (notice.cause, notice.remedy)))))
            self.refused.show()
            self.adjustSize()

    def disconnect_board(self) -> None:
        """Vent and close the link."""
        self.services.notices.attempt(self.connection.disconnect)

    def start_virtual(self) -> None:
        """Start a virtual board and connect to it."""
        unit, speed = str(self.virtual_unit.currentData()), float(self.speed.currentData())
        if self.services.notices.attempt(lambda: self.connection.start_virtual_board(unit, speed)):
            self.hide()

    def _open_profile(self) -> None:
        ask_open(self, self.services, "Open a profile", "toml", lambda path: self.profile.setPlainText(str(path)))
