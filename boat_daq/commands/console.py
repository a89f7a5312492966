"""The output of every command: results and the JSON object on standard output, messages on standard error.

Rules: `show` and `emit_json` print results; `notify` and `progress_bar` print messages and progress, so that
`boat-daq ... --json | jq` works. A failure is one or two lines, the cause and the remedy, and exit code 1.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from analysis.numbers import finite
from protocol.base.errors import StorageError


class PlainConsole(Console):
    """A console that prints text from files literally: no markup, no emoji, no terminal control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return `text` with the characters that control a terminal replaced by a box."""
        return super().render_str(text.translate(_CONTROLS), **options)


_CONTROL_CODES = (*range(32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A), *range(0xD800, 0xE000))
_CONTROLS = {code: "\ufffd" for code in _CONTROL_CODES if chr(code) not in "\n\t"}  # C0, C1, bidirectional, surrogates
out = PlainConsole()
err = PlainConsole(stderr=True)


class _Json:
    """Whether the JSON object that the call requested is still to be printed."""

    pending = False


def _request(value: bool) -> bool:
    _Json.pending = value
    return value


JsonOption = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.", callback=_request)]


Advance = Callable[[float, float], None]  # moves a progress bar to (done, total), in any unit


def emit_json(value: Any) -> None:
    """Print one JSON object on standard output."""
    _Json.pending = False
    text = json.dumps(finite(value), ensure_ascii=False, allow_nan=False)
    typer.echo(text.encode("utf-8", "backslashreplace").decode())  # a name that is not UTF-8 becomes JSON's escape


def emit_error(kind: str, cause: str, remedy: str) -> None:
    """Print why a call failed: on standard error, and as the JSON object where that is still pending."""
    if _Json.pending:
        emit_json({"error": kind, "cause": cause, "remedy": remedy})
    notify(f"error: {cause}")
    if remedy:
        notify(f"  try: {remedy}")


def show(text: str) -> None:
    """Print a line of the result on standard output."""
    out.print(text, soft_wrap=True)


def present(content: Any, *lines: str, as_json: bool) -> None:
    """Print a result on standard output: as the JSON object, or as lines of text."""
    if as_json:
        emit_json(content)
    else:
        for line in lines:
            show(line)


def show_table(
    columns: Iterable[str], rows: Iterable[Iterable[str]], *, left: int = 1, title: str | None = None
) -> None:
    """Print a table on standard output.

    Parameters
    ----------
    left : number of leading columns that are aligned to the left; the others are numbers.
    """
    table = Table(title=title, box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for number, name in enumerate(columns):
        table.add_column(name, justify="left" if number < left else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    out.print(table)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Report a failure to make or write `path` with cause and remedy.

    Raises
    ------
    StorageError : in place of an OSError, or of a file format that is not known.
    """
    try:
        yield
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise StorageError(f"{path} cannot be written: {reason}", "choose another --out") from error


def notify(text: str) -> None:
    """Print a message on standard error."""
    err.print(text, soft_wrap=True)


def notify_shortcomings() -> None:
    """Print what of this installation is slower than it could be, on standard error."""
    from boat_daq.engine.installation import shortcomings

    for found in shortcomings():
        notify(f"note: {found.cause}")
        notify(f"  try: {found.remedy}: {found.command}")


@contextmanager
def progress_bar(label: str) -> Iterator[Advance]:
    """Show a bar on standard error for work of more than a second; yields ``advance(done, total)``."""
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
