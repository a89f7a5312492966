"""The outlets of a session: LSL streams and the SECoP node, with the elongation by the calibration in force."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from boat_daq.engine.settings import home
from protocol.base.errors import RequestError

if TYPE_CHECKING:
    from boat_daq.engine.outlets.lsl import Convert, LslOutlet
    from boat_daq.engine.outlets.secop_node import Elongation
    from boat_daq.engine.outlets.secop_server import SecopServer
    from boat_daq.engine.plan import Plan
    from boat_daq.engine.session.session import Session
    from boat_daq.workflows.live_conversion import Conversion
    from protocol.base.arrays import FloatArray

ADDRESS = "localhost:10767"
HOLD_S = 30.0


@dataclass(frozen=True, slots=True)
class NodeChoice:
    """A SECoP node; clients that control it, or come from other computers, must send a token first."""

    address: str = ADDRESS  # HOST:PORT on which it listens
    control: bool = False  # whether clients that send the token may do more than read and vent
    token_file: Path | None = None  # file of the token; None for one of this user, on this computer alone
    hold_s: float = HOLD_S  # how long a pressure is held after the client that set it has left, s; inf holds it

    @property
    def token_path(self) -> Path | None:
        """The file that clients take the token from; None where they need none."""
        from boat_daq.engine.outlets.secop_server import is_loopback

        own = self.control and is_loopback(self.host_and_port[0])
        return self.token_file or (home() / "secop-token" if own else None)

    @property
    def host_and_port(self) -> tuple[str, int]:
        host, colon, port = self.address.rpartition(":")
        if self.address.endswith("]") or not colon:
            host, port = self.address, ADDRESS.rpartition(":")[2]
        if not port.isdecimal() or int(port) > 65535:
            raise RequestError(f"{port!r} is not a port number", f"use an address such as {ADDRESS}")
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

    def elongation(signal_mv: tuple[float, ...]) -> tuple[float, float, bool]:
        known = conversion()
        if known is None:
            return float("nan"), float("nan"), False
        found = known(np.array([signal_mv]))
        return float(found.mm[0]), float(found.expanded_mm[0]), bool(found.stand_in)

    return elongation


def open_streams(session: Session, *, network: bool, conversion: Conversion | None, calibration_id: str) -> LslOutlet:
    """Stream a session over LSL. `conversion`: None without a calibration."""
    from boat_daq.engine.outlets.lsl import LslOutlet
    from protocol.base.errors import RequestError
    from protocol.base.optional import optional

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
    """Serve a session as a SECoP node. `conversion`: returns the conversion in force; None without a calibration."""
    from boat_daq.engine.outlets.secop_node import SecopNode
    from boat_daq.engine.outlets.secop_server import SecopServer, own_token, read_token

    token = ""
    if choice.token_file is not None:
        token = read_token(choice.token_file)
    elif choice.token_path is not None:
        token = own_token(choice.token_path)
    node = SecopNode(
        session, recordings, allow_control=choice.control, elongation=elongation_of(conversion), plans=plans
    )
    return SecopServer(node, choice.host_and_port, token=token, hold_s=choice.hold_s)
