"""Calls of the command line in this process: its JSON object, or the error that ended it."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest import mock

from typer.testing import CliRunner

from boat_daq import cli
from boat_daq.cli import app


class Ended(NamedTuple):
    """Exit code and output of the program."""

    code: int
    out: str
    err: str


def program(*words: object) -> Ended:
    """Run the program in this process, from its arguments to its exit code, without its handlers of signals."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    uninterrupted = mock.patch.object(cli, "Interruption", lambda: SimpleNamespace(came=False))
    typed = mock.patch.object(sys, "argv", ["boat-daq", *map(str, words)])
    with uninterrupted, typed, redirect_stdout(out), redirect_stderr(err):
        try:
            cli.main()
        except SystemExit as leaving:
            code = int(leaving.code or 0)
    return Ended(code, out.getvalue(), err.getvalue())


def call(*words: object) -> Any:
    """Run a command with --json and return its object; raise the error that ended it."""
    result = CliRunner().invoke(app, [str(word) for word in (*words, "--json")])
    if result.exception is not None:
        raise result.exception
    return json.loads(result.stdout)


def text(*words: object) -> str:
    """Run a command and return the text on its standard output; raise the error that ended it."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None:
        raise result.exception
    return result.stdout


@contextmanager
def shown_progress(command: str) -> Iterator[dict[str, list[float]]]:
    """Note the progress that a module of commands shows: its bars by label, each with the parts done."""
    shown: dict[str, list[float]] = {}

    @contextmanager
    def bar(label: str) -> Iterator[Callable[[float, float], None]]:
        parts = shown.setdefault(label, [])
        yield lambda done, total: parts.append(done / total)

    with mock.patch(f"boat_daq.commands.{command}.progress_bar", bar):
        yield shown


def exit_code(*words: object) -> int:
    """Run a command and return its exit code."""
    return CliRunner().invoke(app, [str(word) for word in words]).exit_code


def refusal(*words: object) -> Any:
    """Run a command that fails and return its error, which has a cause and a remedy."""
    error = CliRunner().invoke(app, [str(word) for word in words]).exception
    assert getattr(error, "cause", "")
    assert getattr(error, "remedy", "")
    return error
