"""How every command speaks: one JSON object on standard output, all else on standard error.

Rules: results go to standard output; messages, tables' captions and progress go to standard error, so that
`boat-daq ... --json | jq` works. A failure is one or two lines, the cause and the remedy, and exit code 1.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text


class PlainConsole(Console):
    """A console to which words from files are words: no markup, no emoji, no control characters of a terminal."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Make a text of `text`, what would steer the terminal shown as a box."""
        return super().render_str(text.translate(_CONTROLS), **options)


_STEERS = (*range(32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A), *range(0xD800, 0xE000))
_CONTROLS = {code: "\ufffd" for code in _STEERS if chr(code) not in "\n\t"}  # C0, C1, right to left, no characters
out = PlainConsole()
err = PlainConsole(stderr=True)


class _JsonOwed:
    """Whether the call asked for a JSON object that it has not had yet."""

    owed = False


def _asked(value: bool) -> bool:
    _JsonOwed.owed = value
    return value


JsonOption = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.", callback=_asked)]


class Advance(Protocol):
    """Moves a bar: ``advance(done, total)`` in any one unit; may raise KeyboardInterrupt on Ctrl-C."""

    def __call__(self, done: float, total: float, /) -> None: ...


def plain(value: Any) -> Any:
    """Return `value` as JSON's own types; arrays become lists, NaN and infinities become null."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value


def emit_json(value: Any) -> None:
    """Print one JSON object on standard output."""
    _JsonOwed.owed = False
    text = json.dumps(plain(value), ensure_ascii=False, allow_nan=False)
    typer.echo(text.encode("utf-8", "backslashreplace").decode())  # a name that is no UTF-8 becomes JSON's escape


def emit_error(kind: str, cause: str, remedy: str) -> None:
    """Say why a call failed: to its reader on standard error, and as the one JSON object where that is still owed."""
    if _JsonOwed.owed:
        emit_json({"error": kind, "cause": cause, "remedy": remedy})
    say(f"error: {cause}")
    if remedy:
        say(f"  try: {remedy}")


def say(text: str) -> None:
    """Print a message for the reader on standard error."""
    err.print(text, highlight=False, markup=False, soft_wrap=True)


@contextmanager
def progress_bar(label: str) -> Iterator[Advance]:
    """A bar on standard error for work of more than a second; yields ``advance(done, total)``."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as progress:
        task = progress.add_task(label, total=None)

        def advance(done: float, total: float, /) -> None:
            progress.update(task, completed=done, total=total)

        yield advance
