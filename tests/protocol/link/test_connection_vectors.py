"""The test vectors, made without the package, against the package."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from cobs import cobs

from protocol import Connection, SampleGap, Samples
from protocol.link.framing import FrameReader, encode_frame
from protocol.link.messages import MessageType, decode_command, decode_message, encode_command, encode_message
from tests.protocol.link.streams import HELLO, stream
from tests.vectors.make_vectors import vectors

FOLDER = Path(__file__).resolve().parents[2] / "vectors"


def load(name: str) -> Any:
    return json.loads((FOLDER / name).read_text(encoding="utf-8"))


def fields_of(message: Any) -> dict[str, Any]:
    """A message's fields as the vectors write them: lit and dark in one list, channels where there are some."""
    fields = asdict(message)
    if not fields.get("channels"):
        fields.pop("channels", None)
    else:
        fields["channels"] = ";".join(":".join(channel) for channel in fields["channels"])
    channel = fields.pop("channel", ())
    fields |= {"channel": list(channel)} if channel else {}
    if "lit" in fields:
        lit, dark = fields.pop("lit"), fields.pop("dark")
        fields["counts"] = [count for pair in zip(lit, dark, strict=True) for count in pair]
    return fields


@pytest.mark.parametrize("name", list(vectors()))
def test_vectors_are_those_of_their_generator(name: str) -> None:
    """No vector was edited manually."""
    assert load(name) == json.loads(json.dumps(vectors()[name]))


@pytest.mark.parametrize("case", load("messages.json"), ids=lambda case: case["name"])
def test_every_message_decodes_to_its_fields_and_encodes_to_its_bytes(case: dict[str, Any]) -> None:
    """Both directions, both ways, extremes included."""
    (frame,) = FrameReader().receive(bytes.fromhex(case["wire"]))
    assert (frame.type, frame.seq, frame.payload.hex()) == (case["type"], case["seq"], case["payload"])
    assert encode_frame(frame.type, frame.seq, frame.payload).hex() == case["wire"]
    if case["direction"] == "to_host":
        fields = case["fields"]
        n_sensors, n_channels = len(fields.get("counts", [0, 0])) // 2, len(fields.get("channel", []))
        message: Any = decode_message(frame, n_sensors, n_channels)
        again = encode_message(message, case["seq"])
    else:
        message = decode_command(frame)
        again = encode_command(message, case["seq"])
    assert fields_of(message) == case["fields"]
    assert again.hex() == case["wire"]


def test_the_messages_cover_every_type() -> None:
    """No message type is without a vector."""
    assert {case["type"] for case in load("messages.json")} == set(MessageType)


@pytest.mark.parametrize("case", load("cobs.json"), ids=lambda case: case["decoded"][:16])
def test_cobs_cases_are_those_of_its_definition(case: dict[str, str]) -> None:
    """The encoded form has no 00, is at most one byte in 254 longer, and decodes back."""
    encoded, decoded = bytes.fromhex(case["encoded"]), bytes.fromhex(case["decoded"])
    assert 0 not in encoded
    assert len(encoded) - len(decoded) <= 1 + len(decoded) // 254
    assert cobs.decode(encoded) == decoded


@pytest.mark.parametrize("case", load("damaged.json"), ids=lambda case: case["name"])
def test_damaged_bytes_are_counted_as_in_the_vectors(case: dict[str, Any]) -> None:
    """Each kind of damage has one counter, and the good frames around it are found."""
    link = Connection()
    link.receive(stream(HELLO), 0)
    before = asdict(link.statistics)
    link.receive(bytes.fromhex(case["wire"]), 0)
    after = asdict(link.statistics)
    names = ("crc_errors", "malformed", "oversize", "unknown")
    assert {name: after[name] - before[name] for name in names} == {name: case["counts"].get(name, 0) for name in names}
    assert after["frames"] - before["frames"] == case["frames"]


def test_the_sessions_samples_gaps_and_counts() -> None:
    """A gap, a repeat and a wrap of the clock are decoded as in the vector."""
    case, link = load("session.json"), Connection()
    events = link.receive(bytes.fromhex(case["wire"]), 0)
    rows = next(event.array for event in events if isinstance(event, Samples))
    assert rows["index"].tolist() == case["index"]
    assert rows["time_us"].tolist() == case["time_us"]
    assert rows["flags"].tolist() == case["flags"]
    gaps = [{"lost": e.lost, "before_index": e.before_index} for e in events if isinstance(e, SampleGap)]
    assert gaps == case["gaps"]
    assert {name: getattr(link.statistics, name) for name in case["counts"]} == case["counts"]
