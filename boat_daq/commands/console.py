"""The output of every command: results and the JSON object on standard output, messages on standard error.

Rules: `show` and `emit_json` print results; `notify` and `progress_bar` print messages and progress, so that
`boat-daq ... --json | jq` works. A failure is one or two lines, the cause and the remedy, and exit code 1.
"""

from __future__ import annotations

import codecs
import io
import json
import re
import sys
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Annotated, Any

import typer


class _Json:
    """Whether the one JSON object of this call was printed."""

    printed = False


JsonOption = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]

Advance = Callable[[float, float], None]  # moves a progress bar to (done, total), in any unit


_PROPER_NAMES = ("Debian", "Python", "Qt", "Qt's", "Excel", "Linux", "Windows")
_PLAIN = dict(
    zip("−–—µμσχ±²³×≤°", ("-", "-", "-", "u", "u", "sigma", "chi", "+/-", "^2", "^3", "x", "<=", " deg"), strict=True)
)


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """Replace the characters that an output lacks: the handler of `codecs.register_error`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_plain, error.object[error.start : error.end])), error.end


def _plain(character: str) -> str:
    letters = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return _PLAIN.get(character) or letters or "?"


def prepare_output() -> None:
    """Prepare the output of a call.

    An output may have any encoding, as after `> file.txt` on Windows: characters that it lacks become ASCII.
    """
    _Json.printed = False
    codecs.register_error("boat-daq", _in_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and "utf" not in stream.encoding.lower():
            stream.reconfigure(errors="boat-daq")


def emit_json(value: Any) -> None:
    """Print one JSON object on standard output; in ASCII where the output's encoding is not that of JSON."""
    from analysis.numbers import finite

    _Json.printed = True
    ascii_only = "utf" not in (getattr(sys.stdout, "encoding", None) or "utf-8").lower()
    text = json.dumps(finite(value), ensure_ascii=ascii_only, allow_nan=False)
    print(text.encode("utf-8", "backslashreplace").decode())  # a name that is not UTF-8 becomes JSON's escape


def emit_error(kind: str, cause: str, remedy: str, *, as_json: bool) -> None:
    """Print why a call failed: on standard error, and as its JSON object unless that is printed already."""
    cause, remedy = cause.rstrip("."), _as_step(remedy)
    if as_json and not _Json.printed:
        emit_json({"error": kind, "cause": cause, "remedy": remedy})
    notify(f"error: {cause}")
    if remedy:
        notify(f"  try: {remedy}")


def _as_step(remedy: str) -> str:
    """Return a remedy in the one style of the terminal: after `try:`, in lower case, without a full stop."""
    first, rest = remedy[:1], remedy[1:]
    word = re.match(r"[\w'-]*", rest)
    ordinary = word is not None and word[0] == word[0].lower() and first + word[0] not in _PROPER_NAMES
    return (first.lower() + rest if ordinary else remedy).rstrip(".")


def complete_cycles(count: int) -> str:
    return f"{count} complete cycle{'' if count == 1 else 's'}"


def show(text: str) -> None:
    """Print a line of the result on standard output."""
    from boat_daq.commands.terminal import out

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
    """Print a table on standard output, its first `left` columns aligned to the left; the others are numbers."""
    from boat_daq.commands.terminal import print_table

    print_table(columns, rows, left, title)


def notify(text: str) -> None:
    from boat_daq.commands.terminal import err

    err.print(text, soft_wrap=True)


def notify_shortcomings() -> None:
    """Print what of this installation is slower than it could be, on standard error."""
    from boat_daq.engine.installation import shortcomings

    for found in shortcomings():
        notify(f"note: {found.cause}")
        notify(f"  try: {found.remedy}: {found.command}")


def load(*modules: str) -> None:
    """Import modules that take seconds, behind a bar."""
    with progress_bar("loading"):
        for module in modules:
            import_module(module)


@contextmanager
def progress_bar(label: str) -> Iterator[Advance]:
    """Show a bar on standard error for work of more than a second; yields ``advance(done, total)``."""
    from boat_daq.commands.terminal import bar

    with bar(label) as advance:
        yield advance
