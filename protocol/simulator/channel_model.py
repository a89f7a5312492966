"""The channel model between virtual board and host: it changes bytes only where a fault is active.

Damage is drawn byte by byte in the order sent, independent of how the bytes are divided.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

OTHER_DEVICE = b"T=21.5 C RH=40 %\r\n"


class Channel:
    """Turns bytes as sent into bytes as received."""

    def __init__(self, seed: int) -> None:
        self._generators = {
            name: np.random.default_rng((seed, number)) for number, name in enumerate(("bit_flips", "drop_byte"), 101)
        }
        self._until: dict[str, int] = {}  # bytes until the next damage of that name
        self._which_bit = np.random.default_rng((seed, 104))
        self._sent_as_other = 0  # bytes of another device
        self._wrong_baud = np.random.default_rng((seed, 103))

    def carry(self, data: bytes, faults: Mapping[str, float]) -> bytes:
        """Return what arrives of `data` while `faults` are active."""
        if "silent" in faults or "unplug" in faults:
            return b""
        if "other_device" in faults:
            return self._other_text(len(data))
        if "wrong_baud" in faults:
            noise = (1 + 255 * self._wrong_baud.random(len(data))).astype(np.uint8)
            data = (np.frombuffer(data, np.uint8) ^ noise).tobytes()
        if "bit_flips" in faults:
            damaged = bytearray(data)
            for place in self._places("bit_flips", faults["bit_flips"], len(data)):
                damaged[place] ^= 1 << int(self._which_bit.integers(8))
            data = bytes(damaged)
        if "drop_byte" in faults:
            kept = bytearray(data)
            for place in reversed(self._places("drop_byte", faults["drop_byte"], len(data))):
                del kept[place]
            data = bytes(kept)
        return data

    def _other_text(self, length: int) -> bytes:
        """Return as many bytes of another device's text as the board would have sent."""
        start = self._sent_as_other % len(OTHER_DEVICE)
        self._sent_as_other += length
        return (OTHER_DEVICE * (length // len(OTHER_DEVICE) + 2))[start : start + length]

    def _places(self, name: str, chance: float, length: int) -> list[int]:
        """Return which of the next `length` bytes are damaged, each with the same probability."""
        generator = self._generators[name]
        chance = min(max(chance, 1e-12), 1.0)
        place = self._until[name] if name in self._until else int(generator.geometric(chance)) - 1
        places = []
        while place < length:
            places.append(place)
            place += int(generator.geometric(chance))
        self._until[name] = place - length
        return places
