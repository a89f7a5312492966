"""What all commands have in common as words on the command line: kinds of values, and `-` for standard input or output.

`plain` prepares a command when it is loaded, and sets what a shell completes.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from functools import partial, wraps
from pathlib import Path
from typing import Any

_KINDS = {"int": "N", "integer": "N", "float": "NUMBER", "path": "PATH", "file": "PATH", "datetime": "TIME"}
STANDARD_OUTPUT = "standard-output"  # name of the file that is copied to it
_STANDARD = ("-", "/dev/stdin", "/dev/stdout")
_SUFFIXES = {  # of what a command writes to standard output, where no --format says it
    "report": ".html", "history": ".html", "certificate": ".xml", "dynamics": ".html", "import": ".boat",
    "profile": ".toml", "scene": ".json", "calibrate": ".json", "marks": ".pdf", "trace": ".svg", "bugreport": ".zip",
}  # fmt: skip
_IN_PLACE = {"gui", "recover", "upgrade", "metadata", "accept", "identify", "tune", "record", "twin"}
_SQLITE = b"SQLite format 3"


def plain(command: Any) -> Any:
    """Return a command, or a group with its commands, whose values have plain names and whose files may be `-`."""
    for member in getattr(command, "commands", {}).values():
        plain(member)
    for parameter in command.params:
        if complete := _completion(command.name, parameter):
            parameter._custom_shell_complete = complete
        if hasattr(parameter.type, "readable"):
            parameter.type.readable = False  # a file that may not be read is no wrong call: who opens it explains
        if parameter.param_type_name == "option" and not parameter.metavar and not parameter.is_flag:
            parameter.metavar = _KINDS.get(parameter.type.name.removesuffix(" range"), "TEXT")
    if command.callback is not None and not hasattr(command, "commands") and command.name not in _IN_PLACE:
        inputs, outputs = files_of(command)
        for parameter in command.params:
            if parameter.name in outputs and parameter.callback is not None:
                parameter.callback = _unless_standard(parameter.callback)
        suffix = _SUFFIXES.get(command.name, ".csv")
        command.callback = _with_standard_files(command.callback, inputs, outputs, suffix)
    return command


def _completion(command: str, parameter: Any) -> Callable[..., list[str]] | None:
    """Return what completes the values of a parameter in a shell; None for those without a list."""
    if choices := getattr(parameter.callback, "choices", ()):
        known: Callable[[], Iterable[str]] = partial(iter, choices)
    elif "--plan" in parameter.opts:
        known = _plans
    elif "--unit" in parameter.opts or (parameter.metavar == "NAME" and parameter.name == "name"):
        known = _units
    elif (command, parameter.name) in (("get", "keys"), ("set", "values")):
        known = partial(_keys, "" if command == "get" else "=")
    else:
        return None
    return lambda _context, _parameter, begun: [name for name in known() if name.startswith(begun)]


def _plans() -> Iterable[str]:
    from boat_daq.engine.plan import built_in_plans

    return built_in_plans()


def _units() -> Iterable[str]:
    from boat_daq.engine.settings import UnitLibrary

    return UnitLibrary().names()


def _keys(ending: str) -> list[str]:
    from boat_daq.engine.described import described
    from boat_daq.engine.settings import Settings

    return [f"{key}{ending}" for key in described(Settings())]


def files_of(command: Any) -> tuple[set[str], set[str]]:
    """Return the names of the parameters that are files to read, and files to write; folders are neither."""
    files = [p for p in command.params if p.type.name in ("path", "file") and p.nargs == 1]
    files = [p for p in files if not str(getattr(p, "help", "")).startswith("Folder")]
    read = {p.name for p in files if p.param_type_name == "argument"}
    read |= {p.name for p in files if {"--elongation", "--profile", "--calibration", "--parameters"} & {*p.opts}}
    return read, {p.name for p in files if {"--out", "--plot"} & {*p.opts}}


def _unless_standard(check: Callable[..., Any]) -> Callable[..., Any]:
    """Return the check of a file's name, which standard output does not have."""

    @wraps(check)
    def checked(context: Any, parameter: Any, value: Any) -> Any:
        return value if str(value) in _STANDARD else check(context, parameter, value)

    return checked


def _with_standard_files(
    callback: Callable[..., Any], inputs: set[str], outputs: set[str], suffix: str
) -> Callable[..., Any]:
    @wraps(callback)
    def called(**values: Any) -> Any:
        with ExitStack() as stack:
            for name, value in values.items():
                if str(value) in _STANDARD and name in inputs:
                    values[name] = stack.enter_context(_standard_input())
                elif str(value) in _STANDARD and name in outputs:
                    values[name] = stack.enter_context(_standard_output(values.get("format"), suffix))
            return callback(**values)

    return called


@contextmanager
def _standard_input() -> Iterator[Path]:
    """Give the file that standard input was copied to; a recording or a table."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "standard-input"
        with path.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
        with path.open("rb") as file:
            recording = file.read(len(_SQLITE)) == _SQLITE
        yield path.rename(path.with_suffix(".boat" if recording else ".csv"))


@contextmanager
def _standard_output(form: str | None, suffix: str) -> Iterator[Path]:
    """Give a file that is copied to standard output when the command has written it; results go to standard error."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{STANDARD_OUTPUT}{f'.{form}' if form else suffix}"
        with redirect_stdout(sys.stderr):
            yield path
        with path.open("rb") as file:
            shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.buffer.flush()
