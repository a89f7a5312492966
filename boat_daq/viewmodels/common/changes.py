"""What can be undone: every value that was set or typed is changed through one of these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Change:
    """A change and its way back; `text` completes "Undo ..."."""

    text: str
    redo: Callable[[], None]
    undo: Callable[[], None]


class Changes(Protocol):
    """Where changes go; the window's is Qt's undo stack."""

    def push(self, change: Change) -> None:
        """Do the change and keep it."""


class History:
    """A plain undo history, for scripts and tests."""

    def __init__(self) -> None:
        self.done: list[Change] = []
        self.undone: list[Change] = []

    def push(self, change: Change) -> None:
        """Do the change and keep it; what had been undone is forgotten."""
        change.redo()
        self.done.append(change)
        self.undone.clear()

    def undo(self) -> None:
        """Take the last change back."""
        change = self.done.pop()
        change.undo()
        self.undone.append(change)

    def redo(self) -> None:
        """Do the last undone change again."""
        change = self.undone.pop()
        change.redo()
        self.done.append(change)
