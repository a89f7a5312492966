"""The lab's derived channels: `derived.txt` beside the settings, one definition a line."""

from __future__ import annotations

from collections.abc import Sequence

from boat_daq.engine.settings import home
from boat_daq.engine.stored_file import read_stored, write_stored
from protocol.recording import DerivedChannel, parse_definition

_FILE = "derived.txt"
_HEAD = "# Derived channels, one a line: NAME [UNIT] = EXPRESSION\n"


def parse_lines(text: str) -> tuple[DerivedChannel, ...]:
    """Return the definitions of some lines; empty ones and those that begin with # are left out."""
    lines = (line.strip() for line in text.splitlines())
    return tuple(parse_definition(line) for line in lines if line and not line.startswith("#"))


def as_lines(channels: Sequence[DerivedChannel]) -> str:
    """Return the definitions as lines that `parse_lines` reads."""
    return "".join(f"{c.name}{f' [{c.unit}]' if c.unit else ''} = {c.expression}\n" for c in channels)


def load_derived() -> tuple[DerivedChannel, ...]:
    """Return the stored definitions."""
    return parse_lines(read_stored(home() / _FILE) or "")


def save_derived(channels: Sequence[DerivedChannel]) -> None:
    """Store definitions. StorageError: the folder cannot be written."""
    write_stored(home() / _FILE, _HEAD + as_lines(channels))
