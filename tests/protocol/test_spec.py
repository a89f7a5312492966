"""SPEC.md: every worked example is right, the sizes are those of the code, and its C runs on the vectors."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import zlib
from pathlib import Path

import pytest
from cobs import cobs

import protocol
from protocol.link.framing import Frame, FrameReader
from protocol.link.messages import (
    COMMAND_TYPES,
    Ack,
    AckStatus,
    BoardEvent,
    EventCode,
    Hello,
    Sample,
    decode_command,
    decode_message,
    encode_message,
)
from tests.protocol.link.streams import HELLO

SPEC = (Path(protocol.__file__).parent / "SPEC.md").read_text(encoding="utf-8")
VECTORS = Path(__file__).resolve().parents[1] / "vectors"
EXAMPLES = [block for block in re.findall(r"```\n(.*?)```", SPEC, re.DOTALL) if "wire" in block]

HARNESS = r"""
#include <stdio.h>
#include <string.h>
int main(void)
{
    static char line[4096];
    boat_receiver receiver = {0};
    while (fgets(line, sizeof line, stdin)) {
        uint8_t body[256], wire[256];
        size_t n = 0, length;
        unsigned byte;
        int encode = line[0] == 'E', frames = 0;
        for (char *at = line + 1; sscanf(at, "%2x", &byte) == 1; at += 2) {
            if (encode) { body[n++] = (uint8_t)byte; continue; }
            length = boat_receive(&receiver, (uint8_t)byte);
            if (length) { frames++; memcpy(body, receiver.data, length); n = length; }
        }
        if (encode) {
            length = boat_encode(body, n, wire);
            for (size_t i = 0; i < length; i++) printf("%02x", wire[i]);
        } else {
            printf("%d ", frames);
            for (size_t i = 0; i < n; i++) printf("%02x", body[i]);
        }
        printf("\n");
    }
    return 0;
}
"""


def parse(block: str) -> tuple[str, dict[str, bytes]]:
    title, *lines = block.strip().splitlines()
    return title, {line.split()[0]: bytes.fromhex(" ".join(line.split()[1:])) for line in lines}


@pytest.mark.parametrize("block", EXAMPLES, ids=lambda block: block.split(",")[0][:30])
def test_every_line_of_an_example_follows_from_those_above_it(block: str) -> None:
    """The crc is that of type, seq and payload; the wire is the COBS of all of it, and 00."""
    title, part = parse(block)
    body = part["type"] + part["seq"] + part["payload"]
    assert part["crc"] == zlib.crc32(body).to_bytes(4, "little")
    assert part["wire"] == cobs.encode(body + part["crc"]) + b"\0"
    assert FrameReader().receive(part["wire"]) == [Frame(part["type"][0], part["seq"][0], part["payload"])]
    assert re.search(rf"seq {part['seq'][0]}\b", title)


def test_examples_decode_to_their_titles() -> None:
    """Decoded, the examples are the messages of their titles."""
    decoded = []
    for block in EXAMPLES:
        (frame,) = FrameReader().receive(parse(block)[1]["wire"])
        decoded.append(decode_message(frame, 2) if frame.type < 0x80 else decode_command(frame))
    hello, *others = decoded
    assert isinstance(hello, Hello)
    assert (hello.n_sensors, hello.adc_bits, hello.pressure_min_pa, hello.pressure_max_pa) == (2, 12, -60_000, 80_000)
    assert others == [
        Sample(1, 10_000, -40_000, 2, 0, (2100, 1990), (40, 37)),
        Ack(0x82, 4, AckStatus.DONE),
        BoardEvent(2**32 - 1, EventCode.UNDER_PRESSURE, -62_345),
        protocol.Identify(),
        protocol.Start(100),
        protocol.SetPressure(-40_000, 10_000),
        protocol.Vent(),
    ]


def test_the_sizes_on_the_page_are_those_of_the_code() -> None:
    """HELLO, SAMPLE, ACK and EVENT have the number of bytes in their headings."""
    messages = {"HELLO": HELLO, "ACK": Ack(0, 0, 0), "EVENT": BoardEvent(0, 1, 0)}
    for name, message in messages.items():
        (frame,) = FrameReader().receive(encode_message(message, 0))
        assert f"{name} ({len(frame.payload)} bytes)" in SPEC
    (frame,) = FrameReader().receive(encode_message(Sample(0, 0, 0, 0, 0, (1, 2, 3), (1, 2, 3), (20.5, 1.0)), 0))
    assert len(frame.payload) == 14 + 4 * 3 + 4 * 2
    assert "SAMPLE (14 + 4 n_sensors + 4 n_channels bytes)" in SPEC


def test_the_page_lists_every_command_status_and_event() -> None:
    """No code of the program is missing on the page."""
    for type_ in COMMAND_TYPES.values():
        assert f"| 0x{type_:02X} | {type_.name} |" in SPEC
    for status in AckStatus:
        assert f"{status.value} {status.name.lower().replace('_', ' ')}" in SPEC
    for code in EventCode:
        assert f"| {code.value} | " in SPEC


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
def test_the_c_of_the_page_agrees_with_the_vectors(tmp_path: Path) -> None:
    """Compiled without a warning, it makes every message's bytes, and finds exactly the good frames."""
    (listing,) = re.findall(r"```c\n(.*?)```", SPEC, re.DOTALL)
    source, program = tmp_path / "boat.c", tmp_path / "boat"
    source.write_text(listing + HARNESS, encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", *flags, str(source), "-o", str(program)], check=True)
    messages = json.loads((VECTORS / "messages.json").read_text(encoding="utf-8"))
    damaged = json.loads((VECTORS / "damaged.json").read_text(encoding="utf-8"))
    lines = [f"E{case['body'][:-8]}" for case in messages] + [f"D{case['wire']}" for case in [*messages, *damaged]]
    run = subprocess.run([str(program)], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True)
    output = run.stdout.splitlines()
    assert output[: len(messages)] == [case["wire"] for case in messages]
    assert output[len(messages) : 2 * len(messages)] == [f"1 {case['body'][:-8]}" for case in messages]
    assert [int(line.split()[0]) for line in output[2 * len(messages) :]] == [case["frames"] for case in damaged]
