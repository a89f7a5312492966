"""Extra channels: what a device measures beside pressure and sensors, such as a temperature, in its own unit."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

from protocol.base.units import in_a_name

CHANNELS_MAX = 32
_NAME_MAX, _UNIT_MAX = 40, 20  # characters
RESERVED: Final = re.compile(  # columns with a meaning of their own
    r"index|time(_s)?|pressure(_kpa)?|target(_kpa)?|state|flags|segment|s\d(_(mv|lit|dark|signal))?|host_ns"
    r"|elongation(_mm|_valid|_expanded_mm|_beyond)?|u_mm|camera(_u)?_mm"
)


class ExtraChannel(NamedTuple):
    """An extra channel; `unit` is empty where none is stated."""

    name: str
    unit: str = ""

    @property
    def column(self) -> str:
        """Its column in tables and files: name and unit, in small letters."""
        words = (re.sub(r"\W+", "_", self.name, flags=re.ASCII).strip("_").lower(), in_a_name(self.unit))
        name = "_".join(word for word in words if word)
        return name if name[:1].isalpha() else f"channel_{name}"

    @property
    def quantity(self) -> str:
        """Its name and unit in a text: `temperature [degC]`."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def title(self) -> str:
        """Its name as a label: the first letter is a capital."""
        return self.name[:1].upper() + self.name[1:]


def channels_of(stated: Iterable[tuple[str, str]]) -> tuple[ExtraChannel, ...]:
    """Return channels for (name, unit), shortened if too long; names already used are numbered."""
    channels: list[ExtraChannel] = []
    taken: set[str] = set()
    for name, unit in stated:
        first = ExtraChannel(_plain(name, _NAME_MAX) or "channel", _plain(unit, _UNIT_MAX))
        channel, number = first, 1
        while channel.column in taken or RESERVED.fullmatch(channel.column):
            number += 1
            channel = ExtraChannel(f"{first.name} {number}", first.unit)
        channels.append(channel)
        taken.add(channel.column)
    return tuple(channels)


def _plain(text: str, most: int) -> str:
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())[:most].strip()


def are_channels(value: Any) -> bool:
    """Return whether a session's `channels` are a list of names and units."""
    return (
        isinstance(value, list)
        and len(value) <= CHANNELS_MAX
        and all(isinstance(entry, list) and len(entry) == 2 for entry in value)
        and all(isinstance(text, str) for entry in value for text in entry)
    )


def session_channels(meta: Mapping[str, Any]) -> tuple[ExtraChannel, ...]:
    """Return the channels of a recording; none for one that was made before there were any."""
    return channels_of((str(name), str(unit)) for name, unit in meta.get("channels") or ())
