"""Search of commands by a few letters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")


def ranked(typed: str, items: Iterable[T], text: Callable[[T], str]) -> list[T]:
    """Return the items that match `typed`, best first: whole words' beginnings before letters in order.

    An empty `typed` returns all, in their order.
    """
    words = typed.lower().split()
    scored = [(score(words, text(item).lower()), i, item) for i, item in enumerate(items)]
    return [item for value, _, item in sorted((s for s in scored if s[0] is not None), key=lambda s: (s[0], s[1]))]


def score(words: list[str], text: str) -> int | None:
    """Return how far `text` is from the `words` typed (0 is best); None where it does not match."""
    total = 0
    parts = text.split()
    for word in words:
        if any(part.startswith(word) for part in parts):
            continue
        if word in text:
            total += 1
        elif in_order(word, text):
            total += 3
        else:
            return None
    return total


def in_order(letters: str, text: str) -> bool:
    """Return whether all `letters` occur in `text` in their order."""
    place = -1
    for letter in letters:
        place = text.find(letter, place + 1)
        if place < 0:
            return False
    return True
