"""How long work reports its progress."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, float], None]
"""Called with (done, total) while work proceeds; raising from it cancels the work."""


def part_of(progress: Progress | None, before: float, size: float, total: float) -> Progress:
    """Return the progress of a part of `size` after `before` of `total`; nothing is called if `progress` is None."""

    def within(done: float, of: float) -> None:
        if progress is not None:
            progress(before + size * done / of, total)

    return within
