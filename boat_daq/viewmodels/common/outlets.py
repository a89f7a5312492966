"""The outlets of a session, opened alike by a command and by the window: LSL streams, and the SECoP node.

Rules of the window: an outlet is open while a board sends. The switches are remembered; what reaches beyond reading on
this computer is not: control by clients and the network are allowed anew at each start. An outlet that cannot be opened
is switched off, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from boat_daq.engine.snapshot import LinkState
from boat_daq.formatting import count
from protocol.base.errors import RequestError

if TYPE_CHECKING:
    from boat_daq.engine.outlets.lsl import Convert, LslOutlet
    from boat_daq.engine.outlets.secop_node import Elongation
    from boat_daq.engine.outlets.secop_server import SecopServer
    from boat_daq.engine.plan import Plan
    from boat_daq.engine.session.session import Session
    from boat_daq.engine.snapshot import SessionSnapshot
    from boat_daq.viewmodels.common.preferences import Preferences
    from protocol.base.arrays import FloatArray

ADDRESS = "localhost:10767"
STREAMS, NODE, NODE_ADDRESS = "lsl_streams", "secop_node", "secop_address"
OFF, WAITING = "Off", "Waits for a board"
_OPEN = (LinkState.UP, LinkState.SILENT, LinkState.LOST)


class Converted(Protocol):
    """An elongation with its expanded uncertainty, [n] mm."""

    @property
    def mm(self) -> FloatArray: ...
    @property
    def expanded_mm(self) -> FloatArray: ...


Conversion = Callable[[Any], Converted]


class SensorsConversion(Protocol):
    """A conversion that states of how many sensors it is."""

    @property
    def sensors(self) -> int: ...
    def __call__(self, signal_mv: FloatArray, /) -> Converted: ...


class UnitInForce(Protocol):
    """What the outlets need of the unit on the bench."""

    @property
    def conversion(self) -> SensorsConversion | None: ...
    @property
    def calibration_id(self) -> str: ...


@dataclass(frozen=True, slots=True)
class NodeChoice:
    """A SECoP node as the operator states it.

    Attributes
    ----------
    address : HOST:PORT on which it listens.
    control : whether clients may do more than read and vent.
    token_file : file with what clients of other computers must send first; None on this computer alone.
    """

    address: str = ADDRESS
    control: bool = False
    token_file: Path | None = None

    @property
    def host_and_port(self) -> tuple[str, int]:
        """Return host and port.

        Raises
        ------
        RequestError : not an address.
        """
        host, colon, port = self.address.rpartition(":")
        if self.address.endswith("]") or not colon:
            host, port = self.address, ADDRESS.rpartition(":")[2]
        if not port.isdecimal() or int(port) > 65535:
            raise RequestError(f"{port!r} is no port", f"use an address such as {ADDRESS}")
        return host.strip("[] ") or "localhost", int(port)


def conversion_of(conversion: Conversion) -> Convert:
    """Return what converts signals [n, sensors] to elongation and its U, [n] mm each."""

    def convert(signal_mv: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = conversion(signal_mv)
        return found.mm, found.expanded_mm

    return convert


def elongation_of(conversion: Callable[[], Conversion | None]) -> Elongation:
    """Return what converts the signals of one sample, by the conversion in force then; NaN without one."""

    import numpy as np

    def elongation(signal_mv: tuple[float, ...]) -> tuple[float, float]:
        known = conversion()
        if known is None:
            return float("nan"), float("nan")
        found = known(np.array([signal_mv]))
        return float(found.mm[0]), float(found.expanded_mm[0])

    return elongation


def open_streams(session: Session, *, network: bool, conversion: Conversion | None, calibration_id: str) -> LslOutlet:
    """Stream a session over LSL.

    Parameters
    ----------
    session : with its board's samples arriving.
    network : whether other computers may reach the streams.
    conversion : to elongation; None without a calibration.

    Raises
    ------
    RequestError : pylsl or its library is not installed. RequestError : as `LslOutlet`.
    """
    from analysis.optional import optional
    from boat_daq.engine.outlets.lsl import LslOutlet
    from protocol.base.errors import RequestError

    try:
        pylsl = optional("pylsl")
    except RuntimeError as error:  # the module is there, its library is not
        raise RequestError(f"liblsl cannot be loaded: {error}", "Install liblsl of your system.") from error
    convert = None if conversion is None else conversion_of(conversion)
    return LslOutlet(session, pylsl, network=network, convert=convert, calibration_id=calibration_id)


def open_node(
    session: Session,
    choice: NodeChoice,
    recordings: Path,
    *,
    conversion: Callable[[], Conversion | None],
    plans: Callable[[], Mapping[str, Plan]],
) -> SecopServer:
    """Serve a session as a SECoP node.

    Parameters
    ----------
    session : with its board's samples arriving.
    recordings : folder of the recordings that a client starts.
    conversion : returns that in force, None without a calibration.
    plans : returns what a client may arm, by name.

    Raises
    ------
    RequestError : no address, one beyond this computer without a token, or it cannot be listened on.
    """
    from boat_daq.engine.outlets.secop_node import SecopNode
    from boat_daq.engine.outlets.secop_server import SecopServer, read_token

    token = read_token(choice.token_file) if choice.token_file is not None else ""
    node = SecopNode(
        session, recordings, allow_control=choice.control, elongation=elongation_of(conversion), plans=plans
    )
    return SecopServer(node, choice.host_and_port, token=token)


@dataclass(frozen=True, slots=True)
class OutletsView:
    """The state of the outlets as text."""

    streams: str
    node: str
    badge: str
    short: str
    control: bool


class OutletsModel:
    """The outlets beside the session.

    Parameters
    ----------
    preferences : keep the switches and the address.
    plans : returns the plans that a client may arm, by name.
    recordings : folder of the recordings that a client starts.
    """

    def __init__(
        self,
        session: Session,
        preferences: Preferences,
        unit: UnitInForce,
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
        self._conversion: SensorsConversion | None = None  # that of the streams

    # ---- the switches ----------------------------------------------------------------------------------------------

    def stream(self, wanted: bool, *, network: bool | None = None) -> None:
        """Switch the LSL streams; `network` lets other computers reach them."""
        self._close_streams()
        self.streaming = wanted
        self.network = self.network if network is None else network
        self._preferences.set(STREAMS, wanted and not self.network)

    def serve(self, wanted: bool, choice: NodeChoice | None = None) -> None:
        """Switch the SECoP node, and state how it is reached; without a choice as before.

        Raises
        ------
        RequestError : not an address.
        """
        choice = self.choice if choice is None else choice
        host, port = choice.host_and_port
        self._close_node()
        self.serving, self.choice = wanted, replace(choice, address=f"{host}:{port}")
        self._preferences.set(NODE, wanted and choice.token_file is None)
        if choice.token_file is None:
            self._preferences.set(NODE_ADDRESS, self.choice.address)

    # ---- what is open ----------------------------------------------------------------------------------------------

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Open what is switched on while a board sends, anew for another board or other channels.

        Raises
        ------
        BoatDaqError : an outlet cannot be opened; it is switched off.
        """
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
            self._open_node()
            self.serving = True

    def view(self) -> OutletsView:
        """Return what panel and header show now."""
        streams, node, badge = OFF, OFF, []
        if self.streaming:
            streams = WAITING
        if self.streams is not None:
            reads = "read by a program" if self.streams.is_read else "no program reads them"
            streams = f"{self.streams.pushed:,} samples sent, {reads}"
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

    # ---- inside ----------------------------------------------------------------------------------------------------

    def _source_of(self, snapshot: SessionSnapshot) -> tuple[object, ...] | None:
        """Return what distinguishes the present board and its channels; None without samples."""
        ring = self._session.ring
        if snapshot.link not in _OPEN or snapshot.last is None or ring is None:
            return None
        board = snapshot.hello.board_id if snapshot.hello else ""
        return snapshot.port, board, len(snapshot.last.signal_mv), ring.others

    def _in_force(self) -> SensorsConversion | None:
        """Return the conversion, where it is of the sensors of this board."""
        known, last = self._unit.conversion, self._session.snapshot().last
        return known if known is not None and last is not None and known.sensors == len(last.signal_mv) else None

    def _open_streams(self) -> None:
        known = self._conversion = self._in_force()
        named = self._unit.calibration_id if known is not None else ""
        self.streams = open_streams(self._session, network=self.network, conversion=known, calibration_id=named)

    def _open_node(self) -> None:
        self.node = open_node(
            self._session, self.choice, self._recordings, conversion=self._in_force, plans=self._plans
        )

    def _close_streams(self) -> None:
        streams, self.streams = self.streams, None
        if streams is not None:
            streams.close()

    def _close_node(self) -> None:
        node, self.node = self.node, None
        if node is not None:
            node.close()
