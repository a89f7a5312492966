"""Open a port together with its decoder: for a board, or for firmware that prints text.

Identify the board on a port, with IDENTIFY and no other command; the port is closed afterwards.

A board is recognised by the identity in its HELLO, never by the name of its port, which changes with every plug. Other
instruments have ports, too: nothing is sent to a port, and no port is opened, unless its USB serial number is that of a
board used before (stored with the unit), or the operator has chosen it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from boat_daq.engine.link.ports import Transport, list_ports, open_transport
from boat_daq.engine.settings import Settings
from boat_daq.engine.toml_values import read_text
from protocol.base.errors import DeviceError
from protocol.link.connection import Connection
from protocol.link.events import Link, WrongProtocol
from protocol.link.messages import Hello, Identify
from protocol.recording import session_channels
from protocol.text.connection import TextConnection
from protocol.text.profile import TextProfile, load_profile


@dataclass(frozen=True, slots=True)
class OpenPort:
    """A port and its decoder.

    `profile` is the text profile's TOML; `simulated` is what it states of the device.
    """

    transport: Transport
    link: Link
    profile: str | None = None
    simulated: bool = False


def open_port(url: str, profile: str | None, settings: Settings) -> OpenPort:
    """Open a port and choose its decoder."""
    text = profile if profile is None or "\n" in profile else read_text(Path(profile))
    stated = None if text is None else load_profile(text + "\n")
    link: Link = Connection(in_turn=True) if stated is None else TextConnection(stated)
    transport = open_transport(url, baud=settings.baud, allow_remote=settings.allow_remote)
    return OpenPort(transport, link, text, simulated=stated is not None and stated.simulated)


def open_link(meta: dict[str, Any], decoder_state: dict[str, Any] | None) -> Link:
    """Return the link that decodes a recording's bytes, as it was at their beginning."""
    if meta["profile"]:
        profile = _profile_in(meta["profile"])
        if meta.get("channels") is None:  # recorded before there were channels: its samples have none
            profile = profile.without_channels()
        return TextConnection(profile, decoder_state=decoder_state)
    if decoder_state is not None:
        return Connection(decoder_state=decoder_state)
    return Connection(n_sensors=meta["n_sensors"], adc_bits=meta["adc_bits"] or 16, channels=session_channels(meta))


@lru_cache(maxsize=1)  # a recording has a link for each of its segments, and one profile
def _profile_in(text: str) -> TextProfile:
    return load_profile(text + "\n")  # never a path: a recording is not trusted


def listen(url: str, seconds: float) -> tuple[bytes, float]:
    """Return what a device sends in some time, and the seconds in which it came; nothing is sent."""
    settings = Settings()
    data, times = bytearray(), []
    end_s = time.monotonic() + seconds
    with closing(open_transport(url, baud=settings.baud, allow_remote=settings.allow_remote)) as transport:
        while time.monotonic() < end_s:
            if came := transport.read():
                data += came
                times.append(time.monotonic())
    return bytes(data), times[-1] - times[0] if times else 0.0


_ANSWER_S = 1.0
NOT_QUERIED = "not queried"


@dataclass(frozen=True, slots=True)
class PortIdentity:
    """What was found on a port.

    `hello` is None where no BOAT board answered, and `problem` is why. `usb_serial` is the device's, `unit` the unit it
    was used with; `queried` is False where the port was not opened.
    """

    port: str
    description: str
    hello: Hello | None
    problem: str
    usb_serial: str = ""
    unit: str = ""
    queried: bool = True


def identify_port(url: str, description: str = "") -> PortIdentity:
    """Open a port, identify the board there, and close it. Never raises for what the port does."""
    try:
        with closing(open_transport(url)) as transport:
            return _identify(transport, url, description)
    except DeviceError as error:
        return PortIdentity(url, description, None, error.cause)


def listed_ports(unit_of: Mapping[str, str]) -> list[PortIdentity]:
    """Return the serial ports of this machine without opening one.

    `unit_of`: unit by the USB serial number of the board used with it (`UnitLibrary.boards`). A number that several
    devices have identifies none.
    """
    ports = list_ports()
    devices = Counter((port.usb_serial, port.interface) for port in ports)
    known = [unit_of.get(p.usb_serial, "") if devices[p.usb_serial, p.interface] == 1 else "" for p in ports]
    return [
        PortIdentity(port.port, port.description, None, NOT_QUERIED, port.usb_serial, unit, queried=False)
        for port, unit in zip(ports, known, strict=True)
    ]


def identify_known(
    listed: Sequence[PortIdentity], *, progress: Callable[[float, float], None] = lambda done, of: None
) -> list[PortIdentity]:
    """Return the listed ports, those of boards used before queried, the others untouched."""
    answers = []
    for done, port in enumerate(listed):
        progress(done, len(listed))
        answer = identify_port(port.port, port.description) if port.unit else port
        answers.append(replace(answer, usb_serial=port.usb_serial, unit=port.unit))
    return answers


def _identify(transport: Transport, url: str, description: str) -> PortIdentity:
    """Send IDENTIFY until a HELLO comes or the time is over. A board that boots as its port opens sends it first."""
    link = Connection()
    end_s = time.monotonic() + _ANSWER_S
    received = 0
    transport.write(link.send(Identify(), time.monotonic_ns()))
    while time.monotonic() < end_s:
        data = transport.read()
        received += len(data)
        events = link.receive(data, time.monotonic_ns())
        if link.hello is not None:
            return PortIdentity(url, description, link.hello, "")
        for event in events:
            if isinstance(event, WrongProtocol):
                return PortIdentity(url, description, None, f"a BOAT board of protocol version {event.board_version}")
        _, again = link.poll(time.monotonic_ns())
        if again:
            transport.write(again)
    problem = "no answer" if not received else "not a BOAT board (or another baud rate)"
    return PortIdentity(url, description, None, problem)
