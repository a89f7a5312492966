"""The outlets beside the session in the window: LSL streams, and the SECoP node.

Rules: an outlet is open while a board sends. The switches are remembered; control by clients and the network are
allowed anew at each start. An outlet that cannot be opened is switched off, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from boat_daq.engine.snapshot import LinkState
from boat_daq.formatting import count, number
from boat_daq.viewmodels.live.unit_in_use import UnitInUse
from boat_daq.workflows.outlets import ADDRESS, NodeChoice, conversion_of, open_node, open_streams

if TYPE_CHECKING:
    from boat_daq.engine.outlets.lsl import LslOutlet
    from boat_daq.engine.outlets.secop_server import SecopServer
    from boat_daq.engine.plan import Plan
    from boat_daq.engine.session.session import Session
    from boat_daq.engine.snapshot import SessionSnapshot
    from boat_daq.viewmodels.common.preferences import Preferences
    from boat_daq.workflows.live_conversion import Conversion

STREAMS, NODE, NODE_ADDRESS = "lsl_streams", "secop_node", "secop_address"
OFF, WAITING = "Off", "Waiting for a board"
_OPEN = (LinkState.UP, LinkState.SILENT, LinkState.LOST)


@dataclass(frozen=True, slots=True)
class OutletsView:
    streams: str
    node: str
    badge: str
    short: str
    control: bool


class OutletsModel:
    def __init__(
        self,
        session: Session,
        preferences: Preferences,
        unit: UnitInUse,
        plans: Callable[[], Mapping[str, Plan]],
        recordings: Path,
    ) -> None:
        self._session, self._preferences, self._unit = session, preferences, unit
        self._plans, self._recordings = plans, recordings
        self.streams: LslOutlet | None = None
        self.node: SecopServer | None = None
        self.streaming = preferences.get(STREAMS, False)
        self.network = False
        self.serving = preferences.get(NODE, False)
        self.choice = NodeChoice(preferences.get(NODE_ADDRESS, ADDRESS))
        self._source: tuple[object, ...] | None = None  # what the outlets were opened for
        self._conversion: Conversion | None = None  # that of the streams

    def stream(self, wanted: bool, *, network: bool | None = None) -> None:
        """Switch the LSL streams; `network` lets other computers reach them."""
        self._close_streams()
        self.streaming = wanted
        self.network = self.network if network is None else network
        self._preferences.set(STREAMS, wanted and not self.network)

    def serve(self, wanted: bool, choice: NodeChoice | None = None) -> None:
        """Switch the SECoP node, and state how it is reached; without a choice as before."""
        choice = self.choice if choice is None else choice
        host, port = choice.host_and_port
        self._close_node()
        self.serving, self.choice = wanted, replace(choice, address=f"{host}:{port}")
        self._preferences.set(NODE, wanted and choice.token_file is None)
        if choice.token_file is None:
            self._preferences.set(NODE_ADDRESS, self.choice.address)

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Open what is switched on while a board sends, anew for another board or other channels."""
        source = self._source_of(snapshot)
        if source != self._source:
            self.close()
            self._source = source
        if source is None:
            return
        if self.streaming and self.streams is None:
            self.streaming = False  # unless it can be opened
            self._open_streams()
            self.streaming = True
        if self.streams is not None and self._in_force() is not self._conversion:
            self._conversion = self._in_force()
            convert = None if self._conversion is None else conversion_of(self._conversion)
            self.streams.use(convert, self._unit.calibration_id if convert is not None else "")
        if self.serving and self.node is None:
            self.serving = False
            self.node = open_node(
                self._session, self.choice, self._recordings, conversion=self._in_force, plans=self._plans
            )
            self.serving = True

    def view(self) -> OutletsView:
        streams, node, badge = OFF, OFF, []
        if self.streaming:
            streams = WAITING
        if self.streams is not None:
            reads = "read by a program" if self.streams.is_read else "no program reads them"
            streams = f"{number(self.streams.pushed, 0)} samples sent, {reads}"
            badge.append("LSL")
        if self.serving:
            node = WAITING
        if self.node is not None:
            clients = self.node.clients
            rights = "control allowed" if self.choice.control else "read-only"
            host = self.choice.host_and_port[0]
            node = f"{host}:{self.node.port}, {rights}, {count(clients, 'client')}"
            badge.append(f"SECoP {clients}")
        control = self.node is not None and self.choice.control
        short = "Control" if control else " \u00b7 ".join(name.split()[0] for name in badge)
        return OutletsView(streams, node, " \u00b7 ".join(badge + ["control"] * control), short, control)

    def close(self) -> None:
        """Close what is open; the switches stay."""
        self._close_streams()
        self._close_node()

    def _source_of(self, snapshot: SessionSnapshot) -> tuple[object, ...] | None:
        """Return what distinguishes the present board and its channels; None without samples."""
        ring = self._session.live.ring
        if snapshot.link not in _OPEN or snapshot.last is None or ring is None:
            return None
        board = snapshot.hello.board_id if snapshot.hello else ""
        return snapshot.port, board, len(snapshot.last.signal_mv), ring.others

    def _in_force(self) -> Conversion | None:
        """Return the conversion, where it is of the sensors of this board."""
        known, last = self._unit.conversion, self._session.snapshot().last
        return known if known is not None and last is not None and known.sensors == len(last.signal_mv) else None

    def _open_streams(self) -> None:
        known = self._conversion = self._in_force()
        named = self._unit.calibration_id if known is not None else ""
        self.streams = open_streams(self._session, network=self.network, conversion=known, calibration_id=named)

    def _close_streams(self) -> None:
        streams, self.streams = self.streams, None
        if streams is not None:
            streams.close()

    def _close_node(self) -> None:
        node, self.node = self.node, None
        if node is not None:
            node.close()
