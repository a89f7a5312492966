"""Calls of the command line in this process: its JSON object, or the error that ended it."""

from __future__ import annotations

import json
from typing import Any

from typer.testing import CliRunner

from boat_daq.cli import app


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


def exit_code(*words: object) -> int:
    """Run a command and return its exit code."""
    return CliRunner().invoke(app, [str(word) for word in words]).exit_code


def refusal(*words: object) -> Any:
    """Run a command that fails and return its error, which has a cause and a remedy."""
    error = CliRunner().invoke(app, [str(word) for word in words]).exception
    assert getattr(error, "cause", "")
    assert getattr(error, "remedy", "")
    return error
