"""The board link: bytes in, events out. No thread, no clock, no port, no window.

    link = Connection()
    port.write(link.send(Identify(), time.monotonic_ns()))
    while True:
        for event in link.receive(port.read(), time.monotonic_ns()):
            match event: ...
        lost, again = link.poll(time.monotonic_ns())
        port.write(again)

The contract of the bytes is SPEC.md beside this file.
"""

from types import ModuleType as _Module

from protocol.base.errors import BoatDaqError, ProfileError, RemoteError, RequestError
from protocol.link.bulk import Decoded, decode_chunks, decode_samples
from protocol.link.connection import Connection
from protocol.link.events import (
    BoardEventReceived,
    BoardRestarted,
    CommandDone,
    CommandLost,
    HelloReceived,
    Link,
    LinkEvent,
    LinkStatistics,
    SampleGap,
    Samples,
    WrongProtocol,
)
from protocol.link.messages import (
    AckStatus,
    BoardEvent,
    BootReason,
    ClearFault,
    Command,
    EventCode,
    Heartbeat,
    Hello,
    Identify,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    Vent,
)
from protocol.recording import BoardState, SampleFlag, sample_dtype
from protocol.text.connection import TextConnection
from protocol.text.profile import TextProfile, load_profile

# the names that scripts import
Gap, LocalError, ProtocolError = SampleGap, RequestError, BoatDaqError

__all__ = [name for name, value in list(globals().items()) if name[0].isalpha() and type(value) is not _Module]
