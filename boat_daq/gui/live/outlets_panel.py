"""The panel for LSL streams and the SECoP node. Not modal; each choice takes effect at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QCheckBox, QDialog, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.outlets import OutletsModel

_EXPLANATION = "Sends the board's data to other programs."
_NETWORK = "LSL has no access control: anyone on the network can read the data."
CONTROL = "Without it clients only read and vent; with it they also run and record."
_TOKEN = "Required for control, and for all requests from other computers."  # noqa: S105 - an explanation


class OutletsPanel(QDialog):
    def __init__(self, parent: QWidget, model: OutletsModel, services: Services) -> None:
        super().__init__(parent)
        self.model, self.services = model, services
        self.setWindowTitle("Streams and remote control")
        self.setMinimumWidth(style.FORM_WIDTH)
        self.streaming = _check("Stream over LSL (Lab Streaming Layer)", self._switch_streams)
        self.network = _check("For other computers, too", self._switch_streams)
        self.streams_state = controls.label("", "muted", name="State of the streams")
        self.serving = _check("Serve as a SECoP node", self._switch_node)
        self.address = controls.field("Address of the node", on_enter=self._switch_node)
        self.address.editingFinished.connect(self._switch_node)
        self.control = _check("Allow control", self._switch_node)
        self.token = controls.label("", "muted", name="Token file", elide=True)
        self.choose = controls.button("Choose \u2026", self._choose_token, name="Choose the token file")
        self.forget = controls.button("Remove", lambda: self._use_token(None), name="Use no token file")
        self.node_state = controls.label("", "muted", name="State of the node")
        streams, _ = controls.card(
            self.streaming,
            self.streams_state,
            self.network,
            controls.label(_NETWORK, "small", wrap=True),
        )
        token = controls.row(controls.label("Token file"), (self.token, 1), self.choose, self.forget)
        node, _ = controls.card(
            self.serving,
            self.node_state,
            self.control,
            controls.label(CONTROL, "small", wrap=True),
            controls.row(controls.label("Address"), (self.address, 1)),
            token,
            controls.label(_TOKEN, "small", wrap=True),
        )
        close = controls.button("Close", self.close)
        words = controls.label(_EXPLANATION, "muted", wrap=True)
        self.setLayout(controls.column(words, streams, node, None, controls.row(None, close), spacing=style.GAP))
        self.refresh()

    def showEvent(self, event: QShowEvent) -> None:
        """Take the height that the texts need, which is known once they have their font."""
        super().showEvent(event)
        self.resize(self.width(), self.heightForWidth(self.width()))

    def refresh(self) -> None:
        model, view = self.model, self.model.view()
        for box, value in (
            (self.streaming, model.streaming),
            (self.network, model.network),
            (self.serving, model.serving),
            (self.control, model.choice.control),
        ):
            if box.isChecked() != value:
                box.setChecked(value)
        if not self.address.hasFocus():
            controls.set_text(self.address, model.choice.address)
        file = model.choice.token_path
        controls.set_text(self.token, str(file) if file is not None else "none")
        self.forget.setEnabled(model.choice.token_file is not None)
        controls.set_text(self.streams_state, view.streams)
        controls.set_text(self.node_state, view.node)
        controls.set_state(self.node_state, "warning" if view.control else "")

    def _switch_streams(self) -> None:
        wanted, network = self.streaming.isChecked(), self.network.isChecked()
        if (wanted, network) != (self.model.streaming, self.model.network):
            self.model.stream(wanted, network=network)
        self.refresh()

    def _switch_node(self) -> None:
        choice = replace(self.model.choice, address=self.address.text().strip(), control=self.control.isChecked())
        wanted = self.serving.isChecked()
        if (wanted, choice) != (self.model.serving, self.model.choice):
            self.services.notices.attempt(lambda: self.model.serve(wanted, choice))
            controls.set_text(self.address, self.model.choice.address)
        self.refresh()

    def _choose_token(self) -> None:
        ask_open(self, self.services, "A file with the token, one line", "txt token", self._use_token)

    def _use_token(self, path: Path | None) -> None:
        self.model.serve(self.model.serving, replace(self.model.choice, token_file=path))
        self.refresh()


def _check(text: str, changed: Callable[[], None]) -> QCheckBox:
    box = QCheckBox(text)
    box.setAccessibleName(text)
    box.clicked.connect(lambda *_: changed())
    return box
