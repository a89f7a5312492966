"""How long work reports its progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[float, float], None]
"""Called with (done, total) while work proceeds; raising from it cancels the work."""


def part_of(progress: Progress | None, before: float, size: float, total: float) -> Progress:
    """Return the progress of a part of `size` after `before` of `total`; nothing is called if `progress` is None."""

    def within(done: float, of: float) -> None:
        if progress is not None:
            progress(before + size * done / of, total)

    return within


_shown: list[tuple[Progress, Callable[[], None]]] = []


@contextmanager
def compiling(progress: Progress, ended: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Have `progress` called with the number of functions that are compiled, and of how many, while this is entered.

    `ended`: called when the function that was called is compiled, with all that it calls.
    """
    _shown.append((progress, ended))
    try:
        yield
    finally:
        _shown.remove((progress, ended))


def show_compiled(done: float, total: float, *, all_called: bool) -> None:
    """Show how many functions are compiled where that was asked for last."""
    for progress, ended in _shown[-1:]:
        progress(done, total)
        if all_called:
            ended()
