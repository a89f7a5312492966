"""The console script. Every group of commands has its own module in `boat_daq/commands/`.

The module of a command is imported when the command is called, and its libraries (numba, Qt, scipy) when it runs, so
that `--version`, `--help` and `board` start at once.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from importlib import import_module
from itertools import chain
from types import FrameType
from typing import Annotated, Any

import typer
import typer.main
from typer.core import TyperGroup

import boat_daq
from boat_daq import commands

_COMMANDS = (  # in the order of --help; each is a function in the module named, or of its own name
    (
        "demo.gui",
        "demo",
        "board.ports",
        "board.board",
        "board.profile",
        "record",
        "run_queue.queue",
        "serve",
        "importing.importing",
    ),
    ("recordings.recover", "recordings.upgrade", "recordings.verify", "recordings.info", "metadata"),
    ("analyze", "analyze.report", "certificate"),
    ("folders.batch", "folders.history", "analyze.strokes", "methods.tradeoff", "methods.atlas"),
    ("examples", "importing.export", "calibration", "calibration.convert", "fit", "qualify", "setup", "bugreport"),
)
_GROUPS = ("camera", "configuration.config", "configuration.unit", "optics", "shadow", "twin", "reproduce")
_NAMES = {"importing": "import"}  # where the name of the function is not that of the command
_STYLE: dict[str, Any] = {"rich_markup_mode": None, "pretty_exceptions_enable": False}


class LazyCommands(Mapping[str, Any]):
    """Commands and groups by name; each is imported when it is looked up."""

    def __init__(self) -> None:
        self._places = {self._name(place): place for place in (*chain.from_iterable(_COMMANDS), *_GROUPS)}
        self._loaded: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._loaded:
            self._loaded[name] = self._load(name, self._places[name])
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    @staticmethod
    def _name(place: str) -> str:
        function = place.rpartition(".")[2]
        return _NAMES.get(function, function)

    @staticmethod
    def _load(name: str, place: str) -> Any:
        module, _, attribute = place.rpartition(".")
        imported = import_module(f"{commands.__name__}.{module or attribute}")
        parent = typer.Typer(add_completion=False, **_STYLE)
        if place in _GROUPS:
            parent.add_typer(getattr(imported, attribute if module else "app"), name=name)
        else:
            parent.command(name, cls=getattr(imported, "COMMAND_CLASS", None))(getattr(imported, attribute))
        return typer.main.get_group(parent).commands[name]


class Root(TyperGroup):
    """The program's group of commands."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands: Any = LazyCommands()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of --help."""
        return list(self.commands)


app = typer.Typer(
    name="boat-daq",
    cls=Root,
    help="Calibrate soft optical sensors in pneumatic actuators: record, analyse, report.",
    add_completion=False,
    **_STYLE,
)


def show_version(value: bool) -> None:
    if value:
        typer.echo(f"boat-daq {boat_daq.__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=show_version, is_eager=True)
    ] = False,
) -> None:
    """Calibrate soft optical sensors in pneumatic actuators: record, analyse, report.

    Without a command it opens the window.

    Example: boat-daq demo --headless
    """
    if context.invoked_subcommand is None:
        from boat_daq.commands.demo import gui

        gui()


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that end the program in order: SIGHUP, a closed terminal, unless nohup has it ignored."""
    hangup = getattr(signal, "SIGHUP", None)
    heeded = hangup is not None and signal.getsignal(hangup) != signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *((hangup,) if heeded else ()))


class Interruption:
    """Turns `ending_signals` into a KeyboardInterrupt, and records it in `came`."""

    def __init__(self) -> None:
        self.came, self._leaving = False, False
        sys.unraisablehook = self._again
        self._signals = ending_signals()
        for number in self._signals:
            signal.signal(number, self)

    def __call__(self, number: int, _frame: FrameType | None) -> None:
        self.came = True
        if number == getattr(signal, "SIGHUP", None):
            _discard_output()
        if not self._leaving:
            raise KeyboardInterrupt

    def leave(self) -> None:
        """Ignore what comes from now on: the interpreter, as it ends, would be killed by it and lose the exit code."""
        self._leaving = True  # for one that is pending already, which `signal.signal` handles first
        for number in self._signals:
            signal.signal(number, signal.SIG_IGN)

    def _again(self, ignored: sys.UnraisableHookArgs) -> None:
        """Interrupt once more where it came in a callback of compiled code (numba's), which discards it.

        What an interrupted compilation left unfinished cannot be finalised: that is no message to the user.
        """
        if isinstance(ignored.exc_value, KeyboardInterrupt):
            threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
        elif not self.came:
            sys.__unraisablehook__(ignored)


def _discard_output() -> None:
    """Lead output to a closed terminal nowhere: writing to it would raise an error amid the closing."""
    if sys.platform == "win32":  # there a closed terminal ends the program
        return
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (1, 2):
        try:
            os.ttyname(descriptor)
        except OSError as error:
            if error.errno not in (errno.EIO, errno.ENXIO, errno.ENODEV):  # a file or a pipe: it is still read
                continue
        os.dup2(nowhere, descriptor)
    os.close(nowhere)


def explain(error: Exception) -> tuple[str, str]:
    """Return cause and remedy of an error; the traceback of an unexpected one is written to the log."""
    from protocol.base.errors import cause_and_remedy

    if (known := cause_and_remedy(error)) is not None:
        remedy, command = known[1], getattr(error, "command", "")
        return known[0], f"{remedy.rstrip('.')}: {command}" if remedy and command else remedy or command
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}", "check the path, its permissions and the free space of the disk"
    from boat_daq.engine.log import note_failure, start_log, stop_log

    path = start_log()
    note_failure("an error of the program", error)
    stop_log()
    where = f"; the details are in {path}" if path else ""
    return f"an error of the program: {type(error).__name__}: {error}{where}", "boat-daq bugreport --out FILE.zip"


def main() -> None:
    """Run the command line; failures become the exit codes of the surface (0, 1, 2, 130)."""
    from boat_daq.commands.console import accept_every_character, emit_error

    interruption = Interruption()
    accept_every_character()
    try:
        app()
    except SystemExit as leaving:
        if not interruption.came:
            raise
        interruption.leave()
        raise SystemExit(130) from leaving  # releases of typer differ in the code they leave with after Ctrl-C
    except Exception as error:  # noqa: BLE001 - the last one to see it
        emit_error(type(error).__name__, *explain(error))
        raise SystemExit(1) from None
