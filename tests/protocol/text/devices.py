"""Devices that the shipped profiles describe, and one of lines with a signal."""

from __future__ import annotations

import struct
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np

import protocol
from protocol import (
    Samples,
)
from protocol.link.events import LinkEvent

SHIPPED = Path(protocol.__file__).parent / "profiles"


LINES = SHIPPED / "delimited_lines.toml"


RX8 = SHIPPED / "bridge_control_panel.toml"


SIGNAL = """
name = "one sensor"
kind = "lines"
[device]
n_sensors = 1
rate_hz = 10
[lines]
delimiter = ";"
decimal = ","
checksum = "nmea"
fields = ["tag", { name = "time", unit = "s" }, { name = "pressure", unit = "psi" }, { name = "s1_signal", unit = "V" }]
"""


def rows_of(events: list[LinkEvent]) -> np.ndarray:
    return np.concatenate([event.array for event in events if isinstance(event, Samples)])


def line(n: int, *, time_ms: int | None = None) -> bytes:
    """The n-th line of a device as the shipped profile describes it."""
    return f"{10 * n if time_ms is None else time_ms},{n},{n / 10},{2000 + n % 90},40,1990,37,23.4\r\n".encode()


def packet(n: int) -> bytes:
    """Return the n-th packet of the shipped RX8 profile; its data sometimes contain the header's byte 0x43."""
    return b"\x43" + struct.pack(">HhHH", 10 * n % 65_536, -4000 + n, 0x4343, n % 4096) + b"\0"


def nmea(text: str) -> bytes:
    return f"${text}*{reduce(xor, text.encode(), 0):02X}\r\n".encode()
