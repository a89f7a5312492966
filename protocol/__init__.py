"""The board link: bytes in, events out. No thread, no clock, no port, no window.

    link = Connection()
    port.write(link.send(Identify(), time.monotonic_ns()))
    while True:
        for event in link.receive(port.read(), time.monotonic_ns()):
            match event: ...
        lost, again = link.poll(time.monotonic_ns())
        port.write(again)

Names are imported when they are first used, so that a part that needs few of them (the command line) starts at once.
The contract of the bytes is SPEC.md beside this file.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from protocol.base.errors import BoatDaqError as BoatDaqError
    from protocol.base.errors import BoatDaqError as ProtocolError
    from protocol.base.errors import ProfileError as ProfileError
    from protocol.base.errors import RemoteError as RemoteError
    from protocol.base.errors import RequestError as LocalError
    from protocol.base.errors import RequestError as RequestError
    from protocol.link.bulk import Decoded as Decoded
    from protocol.link.bulk import decode_chunks as decode_chunks
    from protocol.link.bulk import decode_samples as decode_samples
    from protocol.link.connection import Connection as Connection
    from protocol.link.events import BoardEventReceived as BoardEventReceived
    from protocol.link.events import BoardRestarted as BoardRestarted
    from protocol.link.events import ClockWentBack as ClockWentBack
    from protocol.link.events import CommandDone as CommandDone
    from protocol.link.events import CommandLost as CommandLost
    from protocol.link.events import HelloReceived as HelloReceived
    from protocol.link.events import Link as Link
    from protocol.link.events import LinkEvent as LinkEvent
    from protocol.link.events import LinkStatistics as LinkStatistics
    from protocol.link.events import SampleGap as Gap
    from protocol.link.events import SampleGap as SampleGap
    from protocol.link.events import Samples as Samples
    from protocol.link.events import WrongProtocol as WrongProtocol
    from protocol.link.messages import AckStatus as AckStatus
    from protocol.link.messages import BoardEvent as BoardEvent
    from protocol.link.messages import BootReason as BootReason
    from protocol.link.messages import ClearFault as ClearFault
    from protocol.link.messages import Command as Command
    from protocol.link.messages import EventCode as EventCode
    from protocol.link.messages import Heartbeat as Heartbeat
    from protocol.link.messages import Hello as Hello
    from protocol.link.messages import Identify as Identify
    from protocol.link.messages import SetLimits as SetLimits
    from protocol.link.messages import SetPressure as SetPressure
    from protocol.link.messages import Start as Start
    from protocol.link.messages import Stop as Stop
    from protocol.link.messages import Vent as Vent
    from protocol.recording import BoardState as BoardState
    from protocol.recording import SampleFlag as SampleFlag
    from protocol.recording import sample_dtype as sample_dtype
    from protocol.text.connection import TextConnection as TextConnection
    from protocol.text.profile import TextProfile as TextProfile
    from protocol.text.profile import load_profile as load_profile

_NAMES = {  # by module
    "base.errors": ("BoatDaqError", "ProfileError", "RemoteError", "RequestError"),
    "link.bulk": ("Decoded", "decode_chunks", "decode_samples"),
    "link.connection": ("Connection",),
    "link.events": (
        "BoardEventReceived",
        "BoardRestarted",
        "ClockWentBack",
        "CommandDone",
        "CommandLost",
        "HelloReceived",
        "Link",
        "LinkEvent",
        "LinkStatistics",
        "SampleGap",
        "Samples",
        "WrongProtocol",
    ),
    "link.messages": (
        "AckStatus",
        "BoardEvent",
        "BootReason",
        "ClearFault",
        "Command",
        "EventCode",
        "Heartbeat",
        "Hello",
        "Identify",
        "SetLimits",
        "SetPressure",
        "Start",
        "Stop",
        "Vent",
    ),
    "recording": ("BoardState", "SampleFlag", "sample_dtype"),
    "text.connection": ("TextConnection",),
    "text.profile": ("TextProfile", "load_profile"),
}
_MODULES = {name: f"protocol.{module}" for module, names in _NAMES.items() for name in names}
_OLD_NAMES = {"Gap": "SampleGap", "LocalError": "RequestError", "ProtocolError": "BoatDaqError"}  # that scripts import
__all__ = list(_MODULES | _OLD_NAMES)


def __getattr__(name: str) -> Any:
    if (current := _OLD_NAMES.get(name, name)) in _MODULES:
        return getattr(importlib.import_module(_MODULES[current]), current)
    raise AttributeError(f"module 'protocol' has no attribute {name!r}")
