"""Every decoder takes any bytes or refuses them with a cause; every earlier finding of the fuzzers is tried again."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.faults.decoders import DECODERS
from tests.faults.seeds import seeds

FINDINGS = sorted((Path(__file__).parent / "findings").iterdir())
SLOW = {"recording": 6, "cells": 10, "mesh": 20, "csv": 40, "elongation": 40, "compression": 30, "sweep": 20}


def mutated(seed: bytes, rng: random.Random) -> bytes:
    """Return a valid input with a few bytes changed, removed, repeated or cut off."""
    data = bytearray(seed)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(data) + 1)
        match rng.randrange(5):
            case 0 if at < len(data):
                data[at] = rng.randrange(256)
            case 1:
                del data[at : at + rng.randrange(9)]
            case 2:
                data[at:at] = data[at : at + rng.randrange(60)]
            case 3:
                data[at:at] = rng.choice([b"\0", b"\xff" * 4, b"1e999", b"-", b'"', b"nan", b"=[", b"9" * 30, b"\n"])
            case _ if rng.random() < 0.2:
                del data[at:]
    return bytes(data)


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.name)
def test_earlier_findings_cause_no_traceback(path: Path) -> None:
    """Inputs that once caused a traceback or an endless loop."""
    assert DECODERS[path.name.rsplit("-", 1)[0].replace("_", " ")](path.read_bytes()) is None


@pytest.mark.parametrize("name", sorted(DECODERS))
def test_mutated_inputs_cause_no_traceback(name: str) -> None:
    """Valid inputs are used, mutated ones used or refused, without a traceback."""
    rng = random.Random(name)
    good = seeds(name)
    for seed in good:
        assert DECODERS[name](seed) is None
    for _ in range(SLOW.get(name, 60)):
        assert DECODERS[name](mutated(rng.choice(good), rng)) is None


@pytest.mark.parametrize("name", sorted(set(DECODERS) - set(SLOW)))
@given(data=st.binary(max_size=200))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_random_bytes_cause_no_traceback(name: str, data: bytes) -> None:
    """Random bytes are used or refused, without a traceback."""
    assert DECODERS[name](data) is None


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", sorted(DECODERS))
def test_many_mutated_inputs_cause_no_traceback(name: str) -> None:
    """The same with a hundred times as many."""
    rng = random.Random(f"{name} at night")
    good = seeds(name)
    for _ in range(100 * SLOW.get(name, 60)):
        assert DECODERS[name](mutated(rng.choice(good), rng)) is None
