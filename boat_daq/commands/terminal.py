"""The terminal by the library rich: text, tables, progress bars. `console` imports it when something is printed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from analysis.progress import compiling


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


def print_table(columns: Iterable[str], rows: Iterable[Iterable[str]], left: int, title: str | None) -> None:
    table = Table(title=title, box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for number, name in enumerate(columns):
        table.add_column(name, justify="left" if number < left else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    out.print(table)


class _Percent(TextColumn):
    """The part that is done; nothing where it is unknown."""

    def render(self, task: Task) -> Text:
        return super().render(task) if task.total is not None else Text()


@contextmanager
def bar(label: str) -> Iterator[Callable[[float, float], None]]:
    """Show a progress bar on standard error, as `console.progress_bar`."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        _Percent("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as progress:
        task = progress.add_task(label, total=None)

        def advance(done: float, total: float, /) -> None:
            progress.update(task, description=label, completed=done, total=total)

        def compiled(done: float, total: float, /) -> None:
            text = f"compiling once: {done:.0f} of at most {total:.0f} functions"
            progress.update(task, description=text, completed=done, total=total)

        def ended() -> None:
            progress.update(task, description=label, completed=0, total=None)

        with compiling(compiled, ended):
            yield advance
