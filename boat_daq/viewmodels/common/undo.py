"""The undo history: every value that is set or typed is changed through it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Change:
    """A change and its reversal; `text` completes "Undo ..."."""

    text: str
    redo: Callable[[], None]
    undo: Callable[[], None]


class UndoHistory:
    """Changes in order, and those that were undone."""

    def __init__(self) -> None:
        self.done: list[Change] = []
        self.undone: list[Change] = []

    def push(self, change: Change) -> None:
        """Apply a change and record it; one that raises is not recorded, undone changes are discarded."""
        change.redo()
        self.done.append(change)
        self.undone.clear()

    def undo(self) -> None:
        """Reverse the last change."""
        change = self.done.pop()
        self.undone.append(change)
        change.undo()

    def redo(self) -> None:
        """Apply the last undone change again."""
        change = self.undone.pop()
        self.done.append(change)
        change.redo()
