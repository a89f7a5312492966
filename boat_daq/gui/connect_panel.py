"""The connect panel: a board at a port, another firmware through a profile, the virtual board. Not modal."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QDialog, QPlainTextEdit, QWidget

from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.viewmodels.common.notices import Notice
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.connection import ENDED, VIRTUAL_SENSORS, VIRTUAL_UNITS, ConnectionModel, link_text

_SPEEDS = [("real time", 1.0), ("5 times faster", 5.0), ("20 times faster", 20.0)]
_SENSORS = [(f"{n} sensor{'s' * (n != '1')}", ending) for n, ending in VIRTUAL_SENSORS.items()]
IDENTITY = "Known boards are found automatically. Choose the port of a new one."
PROFILE_HINT = "Empty for a BOAT board; else an RX8 line of Bridge Control Panel, a TOML profile, or its path"


class ConnectPanel(QDialog):
    def __init__(self, parent: QWidget, connection: ConnectionModel, services: Services) -> None:
        super().__init__(parent)
        self.connection, self.services = connection, services
        self._refusal: Notice | None = None
        self.setWindowTitle("Connect")
        self.setMinimumWidth(style.FORM_WIDTH)
        self.port = QComboBox()
        self.port.setEditable(True)
        self.port.setAccessibleName("Port")
        hint = "a port, or socket://HOST:PORT"
        self.address = controls.field("Port", on_enter=self.connect_board, placeholder=hint)
        self.port.setLineEdit(self.address)
        self.port.activated.connect(lambda _: self._propose_unit())
        self.unit = controls.field("Unit connected to the board", connection.bench_unit, width=3 * style.CONTROL_HEIGHT)
        last = str(services.preferences.get("profile", ""))  # empty for a board that speaks the BOAT protocol
        self.profile = QPlainTextEdit(last, tabChangesFocus=True, placeholderText=PROFILE_HINT)
        self.profile.setAccessibleName("Profile of another firmware")
        self.profile.setProperty("role", "paste")  # its height is set in the style sheet
        self.virtual_unit = controls.choice("Unit of the virtual board", [(u, u) for u in VIRTUAL_UNITS])
        self.sensors = controls.choice("Number of sensors of the virtual board", _SENSORS)
        self.speed = controls.choice("Speed of the virtual board", _SPEEDS)
        self.setLayout(controls.column(self._board(), self._virtual(), spacing=style.CARD_PADDING))

    def _board(self) -> QWidget:
        self.identity = controls.label(IDENTITY, "muted", wrap=True)
        self.none = controls.label("\u25b2 No port found. Plug in the board, then rescan.", "muted", wrap=True)
        self.connect_button = controls.button("Connect", self.connect_board, "primary")
        self.disconnect_button = controls.button(
            "Disconnect", lambda: self.services.notices.attempt(self.connection.disconnect)
        )
        self.refused = controls.label("", "", wrap=True, name="Why it is not connected")
        controls.set_state(self.refused, "warning")
        self.refused.hide()
        grid, top = controls.grid(), Qt.AlignmentFlag.AlignTop
        for i, (text, control) in enumerate(
            (("Port", self.port), ("Unit", self.unit), ("Other firmware", self.profile))
        ):
            name = controls.label(text)
            grid.addWidget(name, i, 0, top if control is self.profile else Qt.AlignmentFlag(0))
            if control is self.profile:  # level with its first line
                name.setFixedHeight(style.CONTROL_HEIGHT)
            grid.addWidget(control, i, 1, top if control is self.profile else Qt.AlignmentFlag(0))
            if control is self.port:  # in its place in the order of Tab
                grid.addWidget(controls.button("Rescan", self.rescan), i, 2)
        grid.addLayout(controls.column(controls.button("Open …", self._open_profile), None), 2, 2)
        grid.setColumnStretch(1, 1)
        return controls.card(
            controls.label("Board", "subtitle"),
            self.identity,
            self.none,
            grid,
            self.refused,
            controls.row(None, self.disconnect_button, self.connect_button),
        )[0]

    def _virtual(self) -> QWidget:
        explanation = "A simulated unit, pump and board for practice. Data are marked SIMULATED."
        self.virtual_button = controls.button("Start the virtual board", self.start_virtual)
        return controls.card(
            controls.label("Virtual board", "subtitle"),
            controls.label(explanation, "muted", wrap=True),
            controls.row(self.virtual_unit, self.sensors, self.speed, None),
            controls.row(None, self.virtual_button),
        )[0]

    def open_fresh(self) -> None:
        self.rescan()
        self.unit.setText(self.connection.bench_unit)
        self.refused.hide()
        self.show()
        self.raise_()
        self.port.setFocus()

    def rescan(self) -> None:
        """List the ports, and query the boards used before in the background."""
        self.list_ports()
        self.connection.query_boards()

    def list_ports(self) -> None:
        """List the ports; what was selected or typed stays, also where its description is another one now."""
        typed, chosen = self.port.currentText() or str(self.services.preferences.get("port", "")), self._chosen()
        ports = self.connection.ports()
        self.port.clear()
        for text, port in ports:
            self.port.addItem(text, port)
        self.none.setVisible(not ports)
        self._fit()
        listed = next((text for text, port in ports if port == chosen), "")
        self.port.setEditText(listed or typed)
        if listed:
            self.address.setCursorPosition(0)  # else its begin, the port, is cut where it is long

    def _chosen(self) -> str:
        """Return the port that is selected, or what was typed."""
        text = self.port.currentText()
        known = self.port.findText(text)
        return str(self.port.itemData(known)) if known >= 0 else text

    def _propose_unit(self) -> None:
        """Propose the unit that the selected board was used with last."""
        unit = self.connection.unit_at(self._chosen())
        if unit:
            self.unit.setText(unit)

    def _fit(self) -> None:
        """Take the height of what is shown; Qt's `adjustSize` takes no more than two thirds of the screen's."""
        width = max(self.width(), self.minimumWidth())
        self.resize(width, self.heightForWidth(width))

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the boards that have answered, which one was lost, and whether there is a link to close."""
        lost = snapshot.link is LinkState.LOST
        gone = f"\u25b2 {link_text(snapshot).who} was disconnected. It connects again once it is found."
        controls.set_text(self.identity, gone if lost else IDENTITY)
        connected = snapshot.link not in ENDED or self.connection.starting
        controls.allow(self.disconnect_button, "" if connected else "Nothing is connected.")
        if self.isVisible() and self.connection.take_answers():
            self.list_ports()

    def connect_board(self) -> None:
        """Connect to the port that is selected or typed; what was typed stays here if it is refused."""
        port = self._chosen()

        def connect() -> None:
            self.connection.set_unit(self.unit.text())
            self.connection.connect(port, self.profile.toPlainText().strip())

        notices = self.services.notices
        notices.dismiss(self._refusal)
        self._refusal = None
        connected = notices.attempt(connect)
        if not connected:
            self._refusal = notices.history[-1]
            self.refused.setText(f"\u25b2 {self._refusal.sentences}")
        self.refused.setVisible(not connected)
        self._fit()
        if connected:
            self.hide()

    def start_virtual(self) -> None:
        unit = f"{self.virtual_unit.currentData()}{self.sensors.currentData()}"
        speed = float(self.speed.currentData())
        if self.services.notices.attempt(lambda: self.connection.start_virtual_board(unit, speed)):
            self.hide()

    def _open_profile(self) -> None:
        ask_open(self, self.services, "Open a profile", "toml", lambda path: self.profile.setPlainText(str(path)))
