"""The panel for streams and remote control, and what the header shows of them."""

from __future__ import annotations

import dataclasses
import socket

from PySide6.QtWidgets import QApplication

from tests.boat_daq.gui.windows import NARROW, run_command


def test_a_node_is_switched_and_its_clients_are_seen(live):
    """On a free port, with a client; control is marked in the header; a wrong address is named and not taken."""
    run_command(live, "Streams and remote control …")
    panel, model, header = live.outlets_panel, live.model.outlets, live.header
    assert not header.outlets.isVisible()
    panel.address.setText("127.0.0.1:0")
    panel.address.editingFinished.emit()
    panel.serving.click()
    live.refresh()
    with socket.create_connection(("127.0.0.1", model.node.port), timeout=10) as client:
        client.sendall(b"ping x\n")
        assert client.recv(100).startswith(b"pong x")
        live.refresh()
        assert panel.node_state.text().endswith("read-only, 1 client")
        assert header.outlets.text() == "SECoP 1"
    panel.control.click()
    live.refresh()
    assert model.choice == dataclasses.replace(model.choice, address="127.0.0.1:0", control=True)
    assert header.outlets.property("state") == panel.node_state.property("state") == "warning"
    assert "control allowed" in header.outlets.toolTip()
    panel.address.setText("127.0.0.1:http")
    panel.address.editingFinished.emit()
    assert "'http' is not a port number" in live.model.notices.history_text()
    assert model.choice.address == panel.address.text() == "127.0.0.1:0"
    panel.serving.click()
    live.refresh()
    assert panel.node_state.text() == "Off"
    assert not header.outlets.isVisible()


def test_outlets_never_cut_the_header(live):
    """At each width their button is whole and nothing is cut: a port that fits goes before their short names."""
    model, head = live.model.outlets, live.header
    whole = model.view()
    badge = "LSL \u00b7 SECoP 8 \u00b7 control"
    model.view = lambda: dataclasses.replace(whole, badge=badge, short="Control", control=True)
    for width, port, text in (
        (NARROW, "/dev/serial/by-id/usb-FTDI_FT232R", "Control"), (NARROW, "/dev/pts/7", "\u21c4"),
        (1280, "/dev/pts/7", badge),
    ):  # fmt: skip
        live.model.session.change(port=port)
        live.resize(width, 800)
        live.refresh()
        QApplication.processEvents()
        assert head.outlets.text() == text
        for widget in (head.link, head.unit, head.vent, head.outlets):
            assert widget.width() >= widget.sizeHint().width(), (width, widget.text())
            assert head.rect().contains(widget.geometry()), width
