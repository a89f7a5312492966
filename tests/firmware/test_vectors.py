"""The firmware's framing and messages against vectors made without any of this code."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.firmware.firmware_build import FirmwareProcess

VECTORS = Path(__file__).resolve().parents[1] / "vectors"
MESSAGES, COBS, DAMAGED = (
    json.loads((VECTORS / name).read_text(encoding="utf-8")) for name in ("messages.json", "cobs.json", "damaged.json")
)
ACK_LENGTH = 11


def find(process: FirmwareProcess, wire: str) -> tuple[list[int], str]:
    """Return (frames, CRC errors, malformed, oversize) and the last good body, without its CRC."""
    *counts, body = f"{process.request(f'F {wire}')} ".split(" ")[:5]
    return [int(count) for count in counts], body


@pytest.mark.parametrize("case", MESSAGES, ids=lambda case: case["name"])
def test_every_message_is_found_in_its_bytes(process: FirmwareProcess, case: dict[str, Any]) -> None:
    """One good frame, and its type, seq and payload."""
    assert find(process, case["wire"]) == ([1, 0, 0, 0], case["body"][:-8])


@pytest.mark.parametrize("case", DAMAGED, ids=lambda case: case["name"])
def test_damage_is_counted_under_its_name(process: FirmwareProcess, case: dict[str, Any]) -> None:
    """Valid frames and errors are counted as in the vector; payloads are not interpreted."""
    (frames, *errors), _ = find(process, case["wire"])
    named = [case["counts"].get(name, 0) for name in ("crc_errors", "malformed", "oversize")]
    if case["name"] == "an ACK too short":  # a good frame; its payload is short
        named = [0, 0, 0]
    assert (frames, errors) == (case["frames"], named)


@pytest.mark.parametrize("case", [c for c in COBS if len(c["decoded"]) <= 16], ids=lambda case: case["decoded"])
def test_cobs_of_bodies_too_short_to_be_frames(process: FirmwareProcess, case: dict[str, Any]) -> None:
    """They fit COBS, so each fails at its length or at its checksum, and never as a good frame."""
    (frames, crc_errors, malformed, oversize), _ = find(process, case["encoded"] + "00")
    assert (frames, crc_errors + malformed, oversize) == (0, 1, 0)


@pytest.mark.parametrize("case", [c for c in MESSAGES if c["direction"] == "to_board"], ids=lambda case: case["name"])
def test_every_command_is_answered(process: FirmwareProcess, case: dict[str, Any]) -> None:
    """IDENTIFY with HELLO, each other with an ACK of its type and seq: 0, but 4 for CLEAR_FAULT without a fault."""
    process.boot()
    wire = process.receive(bytes.fromhex(case["wire"]))
    _, body = find(process, wire.hex())
    if case["name"] == "IDENTIFY":
        assert body.startswith("010201")
    else:
        assert len(wire) == ACK_LENGTH
        status = 4 if case["name"] == "CLEAR_FAULT" else 0
        assert body == f"0302{case['type']:02x}{case['seq']:02x}{status:02x}"


@pytest.mark.parametrize("n_sensors", [1, 2, 3, 4])
def test_samples_of_one_to_four_sensors(process: FirmwareProcess, n_sensors: int) -> None:
    """A SAMPLE has 14 + 4 n bytes of payload, and its HELLO reports n."""
    process.transmitted(f"N {n_sensors}")
    _, hello = find(process, process.boot()[:42].hex())
    assert hello[4:12] == f"010100{n_sensors:02x}"
    start = next(case["wire"] for case in MESSAGES if case["name"] == "START at 100 Hz")
    process.receive(bytes.fromhex(start))
    _, sample = find(process, process.transmitted("T 1000").hex())
    assert sample[:2] == "02"
    assert len(sample) == 2 * (2 + 14 + 4 * n_sensors)
