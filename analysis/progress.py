"""How long work reports its progress."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, float], None]
"""Called with (done, total) while work proceeds; raising from it cancels the work."""


def part_of(progress: Progress | None, before: float, size: float, total: float) -> Progress:
    """Return the progress of one part of a longer work.

    Parameters
    ----------
    progress : of the whole work; None is called never.
    before, size, total : what is done when the part begins, what the part adds, and all there is to do.
    """

    def within(done: float, of: float) -> None:
        if progress is not None:
            progress(before + size * done / of, total)

    return within
