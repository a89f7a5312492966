"""The outlets of the window: open while a board sends, remembered without what reaches further than reading here."""

from __future__ import annotations

import dataclasses
import math
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.snapshot import LinkState
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.live import outlets
from boat_daq.workflows.outlets import NodeChoice, conversion_of, elongation_of
from protocol.base.errors import BoatDaqError, RequestError
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.viewmodels.helpers import Straight

HERE = NodeChoice("127.0.0.1:0")


class Streams:
    """In place of the LSL outlet: what it was opened with and told."""

    def __init__(self, **options: Any) -> None:
        self.options, self.used = options, list[tuple[bool, str]]()
        self.pushed, self.is_read, self.closed = 12_345, True, False

    def use(self, convert: Any, calibration_id: str) -> None:
        self.used.append((convert is not None, calibration_id))

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Streams]:
    """The streams that were opened, in order."""
    found: list[Streams] = []

    def open_streams(_: Any, **options: Any) -> Streams:
        found.append(Streams(**options))
        return found[-1]

    monkeypatch.setattr(outlets, "open_streams", open_streams)
    return found


def model_in(folder: Path, session: RecordedSession, unit: Any = None) -> outlets.OutletsModel:
    known = unit or SimpleNamespace(conversion=None, calibration_id="")
    return outlets.OutletsModel(session, Preferences(folder), known, built_in_plans, folder)


def ask(model: outlets.OutletsModel, *lines: str) -> list[str]:
    """Return the answers of the node."""
    assert model.node is not None
    with socket.create_connection(("127.0.0.1", model.node.port), timeout=10) as client, client.makefile("rw") as file:
        file.write("".join(f"{line}\n" for line in lines))
        file.flush()
        return [file.readline().strip() for _ in lines]


def test_outlets_are_open_while_a_board_sends(tmp_path: Path, opened: list[Streams]) -> None:
    """Switched on before a board is connected, opened with it, anew for another one, closed with the link."""
    session = RecordedSession(dataclasses.replace(connected(), link=LinkState.CLOSED))
    model = model_in(tmp_path, session)
    model.stream(True)
    model.serve(True, HERE)
    model.follow(session.snapshot())
    assert (model.view().streams, model.view().node, model.view().badge) == ("Waiting for a board",) * 2 + ("",)
    session.live.ring = filled_ring(1.0)
    session.change(link=LinkState.UP)
    model.follow(session.snapshot())
    view = model.view()
    assert view.streams == "12\u2009345 samples sent, read by a program"
    assert view.node.endswith("read-only, 0 clients")
    assert (view.badge, view.control) == ("LSL \u00b7 SECoP 0", False)
    model.follow(session.snapshot())
    assert len(opened) == 1
    session.change(port="/dev/pts/8")
    model.follow(session.snapshot())
    assert [stream.closed for stream in opened] == [True, False]
    session.change(link=LinkState.CLOSED)
    model.follow(session.snapshot())
    assert opened[-1].closed
    assert model.node is None


def test_clients_read_and_vent_and_control_only_where_it_is_allowed(tmp_path: Path) -> None:
    session = RecordedSession(connected(), filled_ring(1.0))
    model = model_in(tmp_path, session)
    model.serve(True, HERE)
    model.follow(session.snapshot())
    change = "change pressure:target 10"
    read, refused, vented = ask(model, "read pressure:value", change, "do vent:_vent")
    assert read.startswith("reply pressure:value [30.0")
    assert '"ReadOnly"' in refused
    assert vented.startswith("done vent:_vent")
    assert session.calls == ["vent"]
    model.serve(True, dataclasses.replace(HERE, control=True))
    model.follow(session.snapshot())
    path = model.choice.token_path
    assert path is not None
    token = path.read_text().strip()
    assert ask(model, f"_authenticate {token}", change)[1].startswith("changed pressure:target")
    assert session.calls == ["vent", "set_pressure"]
    assert model.view().control
    model.close()


def test_control_and_network_are_not_remembered(tmp_path: Path, opened: list[Streams]) -> None:
    """The switches and the address are; what reaches further is allowed anew at each start."""
    session = RecordedSession(connected(), filled_ring(1.0))
    token = tmp_path / "token"
    token.write_text("0123456789abcdef\n")
    token.chmod(0o600)
    first = model_in(tmp_path, session)
    first.stream(True)
    first.serve(True, NodeChoice("localhost:0", control=True))
    second = model_in(tmp_path, session)
    assert (second.streaming, second.network, second.serving) == (True, False, True)
    assert second.choice == NodeChoice("localhost:0")
    second.stream(True, network=True)
    second.serve(True, NodeChoice("0.0.0.0:0", control=True, token_file=token))
    second.follow(session.snapshot())
    assert opened[0].options["network"]
    assert second.view().node.startswith("0.0.0.0:")
    second.close()
    third = model_in(tmp_path, session)
    assert (third.streaming, third.serving, third.choice) == (False, False, NodeChoice("localhost:0"))


def test_an_outlet_that_cannot_be_opened_is_switched_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An address in use, one beyond this computer without a token, no liblsl: the reason once, and no other attempt."""
    session = RecordedSession(connected(), filled_ring(1.0))
    model = model_in(tmp_path, session)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        model.serve(True, NodeChoice(f"127.0.0.1:{taken.getsockname()[1]}"))
        with pytest.raises(RequestError, match="cannot be listened on"):
            model.follow(session.snapshot())
        assert not model.serving
        model.follow(session.snapshot())
    model.serve(True, NodeChoice("0.0.0.0:0"))
    with pytest.raises(RequestError, match="can be reached from other computers"):
        model.follow(session.snapshot())
    with pytest.raises(RequestError, match="is not a port number"):
        model.serve(True, NodeChoice("localhost:x"))

    def no_library(*_: Any, **__: Any) -> Any:
        raise RequestError("pylsl is not installed", "install it")

    monkeypatch.setattr(outlets, "open_streams", no_library)
    model.stream(True)
    with pytest.raises(BoatDaqError, match="not installed"):
        model.follow(session.snapshot())
    assert (model.view().streams, model.view().node) == ("Off", "Off")


def test_streams_follow_the_calibration_in_force(tmp_path: Path, opened: list[Streams]) -> None:
    """Another calibration is used at once; one of another number of sensors is not used."""
    session = RecordedSession(connected(), filled_ring(1.0))
    unit = SimpleNamespace(conversion=None, calibration_id="")
    model = model_in(tmp_path, session, unit)
    model.stream(True)
    model.follow(session.snapshot())
    for sensors, name in ((2, "SA1 first"), (2, "SA1 second"), (1, "SA1 of one sensor")):
        unit.conversion, unit.calibration_id = Straight(), name
        unit.conversion.sensors = sensors
        model.follow(session.snapshot())
        model.follow(session.snapshot())
    assert opened[0].options["conversion"] is None
    assert opened[0].used == [(True, "SA1 first"), (True, "SA1 second"), (False, "")]


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("localhost:10767", ("localhost", 10767)), ("127.0.0.1", ("127.0.0.1", 10767)), (":8000", ("localhost", 8000)),
        ("[::1]:8000", ("::1", 8000)), ("[::1]", ("::1", 10767)), ("0.0.0.0:0", ("0.0.0.0", 0)),
    ],
)  # fmt: skip
def test_an_address_is_host_and_port(address: str, expected: tuple[str, int]) -> None:
    assert NodeChoice(address).host_and_port == expected


@pytest.mark.parametrize("address", ["localhost:x", "localhost:70000", "localhost:-1", "localhost:", "::1:"])
def test_an_address_without_a_usable_port_is_refused(address: str) -> None:
    with pytest.raises(RequestError, match="is not a port number"):
        NodeChoice(address).host_and_port  # noqa: B018 - the refusal is what is tested


def test_one_sample_is_converted_as_a_block_is() -> None:
    """By the conversion in force at that moment; not a number where there is none."""
    in_force: list[Straight | None] = [Straight(), None]
    mm, u_mm = conversion_of(Straight())(np.array([[1732.0, 0.0]]))
    elongation = elongation_of(lambda: in_force[0])
    assert elongation((1732.0, 0.0)) == (mm[0], u_mm[0], False) == (2.0, 0.3, False)
    in_force.pop(0)
    assert all(math.isnan(value) for value in elongation((1732.0, 0.0))[:2])
