"""Write the test vectors of the protocol: `python tests/vectors/make_vectors.py`.

Made with `cobs`, `zlib` and `struct` alone, never with the package, so that the package can be tested against them.
All bytes are hexadecimal strings, all numbers plain, so that a firmware's own tests can read them in C.
"""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

from cobs import cobs

FOLDER = Path(__file__).resolve().parent
Entry = dict[str, Any]


def wire(body: bytes) -> bytes:
    """A frame's bytes from its body without the checksum."""
    return cobs.encode(body + struct.pack("<I", zlib.crc32(body))) + b"\0"


def message(name: str, type_: int, layout: str, fields: Entry, seq: int = 0) -> Entry:
    """One message: its fields, its payload, and the bytes on the wire."""
    values: list[Any] = []
    for value in fields.values():
        values += value if isinstance(value, list) else [value.encode() if isinstance(value, str) else value]
    payload = struct.pack("<" + layout, *values)
    body = bytes((type_, seq)) + payload
    crc = struct.pack("<I", zlib.crc32(body))
    return {
        "name": name,
        "direction": "to_host" if type_ < 0x80 else "to_board",
        "type": type_,
        "seq": seq,
        "fields": fields,
        "payload": payload.hex(),
        "body": (body + crc).hex(),
        "wire": wire(body).hex(),
    }


HELLO = {
    "protocol": 1, "fw_major": 2, "fw_minor": 7, "n_sensors": 2, "rate_max_hz": 1000, "adc_bits": 12, "boot_reason": 0,
    "vref_mv": 3300, "pressure_min_pa": -60000, "pressure_max_pa": 80000, "board_id": "SIMULATED-SA1",
}  # fmt: skip


CHANNELS = "temperature:degC;flow:L/min"  # exact in binary below, so that the numbers are plain


def sample(
    seq: int,
    index: int,
    time_us: int,
    pressure_pa: int,
    counts: list[int],
    *,
    state: int = 2,
    flags: int = 0,
    channel: tuple[float, ...] = (),
) -> Entry:
    """A SAMPLE; `counts` are lit and dark of sensor 1, lit and dark of sensor 2, and so on."""
    head = {"index": index, "time_us": time_us, "pressure_pa": pressure_pa, "state": state, "flags": flags}
    name = f"SAMPLE of {len(counts) // 2} sensor(s), index {index}"
    fields = {**head, "counts": counts}
    if channel:
        name += f", {len(channel)} channels"
        fields["channel"] = list(channel)
    return message(name, 0x02, f"IIiBB{len(counts)}H{len(channel)}f", fields, seq)


def messages() -> list[Entry]:
    """Every message of both directions, extremes included."""
    full = {
        **HELLO,
        "board_id": "0123456789ABCDEF",
        "n_sensors": 4,
        "adc_bits": 16,
        "boot_reason": 4,
        "rate_max_hz": 65535,
    }
    return [
        message("HELLO", 0x01, "BBBBHBBHii16s", HELLO),
        message("HELLO, identity of all 16 bytes", 0x01, "BBBBHBBHii16s", full, 255),
        message(
            "HELLO with a table of two channels",
            0x01,
            f"BBBBHBBHii16s{len(CHANNELS)}s",
            {**HELLO, "channels": CHANNELS},
        ),
        sample(1, 0, 0, 0, [0, 0, 0, 0], state=0),
        sample(2, 1, 10_000, -40_000, [2100, 40, 1990, 37]),
        sample(3, 2**32 - 1, 2**32 - 1, 2**31 - 1, [65535, 65535, 65535, 65535], state=4, flags=0x1F),
        sample(4, 256, 65536, -(2**31), [1, 2]),
        sample(5, 7, 70_000, 50_000, [1, 2, 3, 4, 5, 6]),
        sample(6, 8, 80_000, 50_000, [1, 2, 3, 4, 5, 6, 7, 8], state=1),
        sample(9, 9, 90_000, 50_000, [1, 2, 3, 4], channel=(23.5, -1.25)),
        message("ACK of START: done", 0x03, "BBB", {"command_type": 0x82, "command_seq": 4, "status": 0}, 7),
        message(
            "ACK of SET_PRESSURE: out of limits", 0x03, "BBB", {"command_type": 0x84, "command_seq": 9, "status": 3}, 8
        ),
        message("EVENT booted by the watchdog", 0x04, "IBi", {"time_us": 12, "code": 1, "value": 1}, 9),
        message("EVENT under-pressure, vented", 0x04, "IBi", {"time_us": 2**32 - 1, "code": 3, "value": -62_345}, 10),
        message("IDENTIFY", 0x81, "", {}, 0),
        message("START at 100 Hz", 0x82, "H", {"rate_hz": 100}, 1),
        message("STOP", 0x83, "", {}, 2),
        message("SET_PRESSURE -40 kPa at 10 kPa/s", 0x84, "iI", {"target_pa": -40_000, "ramp_pa_per_s": 10_000}, 3),
        message("VENT", 0x85, "", {}, 4),
        message("HEARTBEAT 2 s", 0x86, "H", {"timeout_ms": 2000}, 5),
        message("CLEAR_FAULT", 0x87, "", {}, 6),
        message("SET_LIMITS", 0x88, "ii", {"min_pa": -45_000, "max_pa": 55_000}, 255),
    ]


def cobs_cases() -> list[Entry]:
    """COBS alone, edges included; bodies of this protocol never reach the 254 bytes where a second block begins."""
    numbers = bytes(range(1, 255))
    cases = [
        b"\0", b"\0\0", b"\0\x11\0", b"\x11\x22\0\x33", b"\x11\x22\x33\x44", b"\x11\0\0\0",
        numbers, b"\0" + numbers, numbers + b"\xff", numbers[1:] + b"\xff\0", numbers[2:] + b"\xff\0\x01",
    ]  # fmt: skip
    return [{"decoded": case.hex(), "encoded": cobs.encode(case).hex()} for case in cases]


def damaged() -> list[Entry]:
    """Damaged bytes that a receiver must tolerate; `counts` is what it counts, `frames` the good frames."""
    good = bytes.fromhex(sample(2, 1, 10_000, -40_000, [2100, 40, 1990, 37])["wire"])
    ack = bytes((3, 7, 0x82, 4, 0))
    flipped = bytearray(good)
    flipped[5] ^= 0x10
    swapped = cobs.encode(ack + struct.pack(">I", zlib.crc32(ack))) + b"\0"
    long_ack, crc, short = ack + b"x" * 191, {"crc_errors": 1}, {"malformed": 1}
    cases: list[tuple[str, bytes, int, dict[str, int]]] = [
        ("empty frames", b"\0\0" + good + b"\0", 1, {}),
        ("one bit flipped", bytes(flipped), 0, crc),
        ("a byte lost", good[:8] + good[9:] + good, 1, crc),
        ("the 00 between two frames lost", good[:-1] + good + good, 1, crc),
        ("a body of five bytes", wire(b"\x03"), 0, short),
        ("a checksum of nothing", wire(b""), 0, short),
        ("a body of 200 bytes", wire(long_ack), 1, {}),
        ("a body of 201 bytes", wire(long_ack + b"x"), 0, short),
        ("210 bytes without a 00", b"A" * 210 + b"\0", 0, short),
        ("211 bytes without a 00", b"A" * 211 + b"\0", 0, {"oversize": 1}),
        ("600 bytes without a 00", b"A" * 600 + b"\0" + good, 1, {"oversize": 1}),
        ("an unknown type", wire(b"\x7f\x01\x02"), 1, {"unknown": 1}),
        ("an ACK with more than we know", wire(ack + b"newer"), 1, {}),
        ("an ACK too short", wire(ack[:-1]), 1, short),
        ("a checksum with its bytes swapped", swapped, 0, crc),
    ]
    return [
        {"name": name, "wire": data.hex(), "frames": frames, "counts": counts} for name, data, frames, counts in cases
    ]


def session() -> Entry:
    """A short stream with its samples: a gap, a repeat, a clock that wraps."""
    frames = [
        message("HELLO", 0x01, "BBBBHBBHii16s", HELLO),
        message("ACK of START: done", 0x03, "BBB", {"command_type": 0x82, "command_seq": 1, "status": 0}, 1),
        sample(2, 0, 2**32 - 20_000, 0, [2100, 40, 1990, 37]),
        sample(3, 1, 2**32 - 10_000, 0, [2100, 40, 1990, 37]),
        sample(3, 1, 2**32 - 10_000, 0, [2100, 40, 1990, 37]),
        sample(4, 2, 0, 0, [2100, 40, 1990, 37]),
        sample(5, 10, 80_000, 5_000_000, [2100, 40, 1990, 37]),
    ]
    return {
        "wire": "".join(frame["wire"] for frame in frames),
        "index": [0, 1, 2, 10],
        "time_us": [2**32 - 20_000, 2**32 - 10_000, 2**32, 2**32 + 80_000],
        "flags": [0, 0, 0, 0x0300],
        "gaps": [{"lost": 7, "before_index": 10}],
        "counts": {"samples": 4, "lost": 7, "duplicates": 1},
    }


def vectors() -> dict[str, Any]:
    """File name -> content."""
    return {
        "messages.json": messages(),
        "cobs.json": cobs_cases(),
        "damaged.json": damaged(),
        "session.json": session(),
    }


if __name__ == "__main__":
    for name, content in vectors().items():
        (FOLDER / name).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
