"""Open a port together with its decoder: for a board, for firmware that prints text, or for a recording."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from boat_daq.engine.link.replay import ReplayTransport
from boat_daq.engine.link.transport import Transport
from boat_daq.engine.link.transports import open_transport
from boat_daq.engine.settings import Settings
from boat_daq.engine.toml_values import read_text
from protocol.link.connection import Connection
from protocol.link.events import Link
from protocol.recording import open_recording, read_session
from protocol.text.connection import TextConnection
from protocol.text.profile import load_profile


@dataclass(frozen=True, slots=True)
class OpenPort:
    """A port and its decoder.

    `profile` is the text profile's TOML, `replayed` the metadata of a replayed recording.
    """

    transport: Transport
    link: Link
    profile: str | None = None
    replayed: dict[str, Any] | None = None

    @property
    def can_command(self) -> bool:
        """Whether pressure can be commanded."""
        return self.transport.can_write and self.link.can_command

    @property
    def why_read_only(self) -> str:
        """Why it cannot; empty where it can."""
        if not self.transport.can_write:
            return "a replay takes no commands"
        return self.link.cannot_command_reason


def open_port(url: str, profile: str | None, settings: Settings) -> OpenPort:
    """Open a port and choose its decoder.

    Parameters
    ----------
    url : as `open_transport` takes it.
    profile : path or TOML of a text profile, None for the BOAT protocol.
    settings : baud rate, and whether remote ports are allowed.

    Raises
    ------
    DeviceError, OperatorError : the port or the profile's file cannot be opened.
    ProtocolError : the profile or the recording cannot be used.
    """
    text = profile if profile is None or "\n" in profile else read_text(Path(profile))
    link: Link = Connection(in_turn=True) if text is None else TextConnection(load_profile(text + "\n"))
    transport = open_transport(url, baud=settings.baud, allow_remote=settings.allow_remote)
    if not isinstance(transport, ReplayTransport):
        return OpenPort(transport, link, text)
    with closing(open_recording(transport.path)) as db:
        meta = read_session(db)
        first = db.execute("SELECT decoder FROM segment ORDER BY id LIMIT 1").fetchone()
    state = json.loads(first[0]) if first and first[0] else None
    return OpenPort(transport, open_link(meta, state), meta["profile"], meta)


def open_link(meta: dict[str, Any], decoder_state: dict[str, Any] | None) -> Link:
    """Return the link that decodes a recording's bytes, as it was at their beginning."""
    if meta["profile"]:
        return TextConnection(load_profile(meta["profile"]), decoder_state=decoder_state)
    if decoder_state is not None:
        return Connection(decoder_state=decoder_state)
    return Connection(n_sensors=meta["n_sensors"], adc_bits=meta["adc_bits"] or 16)
