"""The console script. Every group of commands has its own module in `boat_daq/commands/`.

The module of a command is imported when the command is called, and its libraries (numba, Qt, scipy) when it runs, so
that `--version`, `--help` and `board` start at once.
"""

from __future__ import annotations

import errno
import os
import re
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from types import FrameType
from typing import Annotated, Any

import typer
import typer.main
from typer.core import TyperGroup

import boat_daq
from boat_daq import commands

_GROUPS = {  # in the order of --help: place of the command in `commands/`, a function or a Typer, and its summary
    "measure": {
        "demo.gui": "Open the window; also `boat-daq` alone",
        "demo": "Run a whole calibration on a virtual board",
        "board.ports": "List serial ports and find BOAT boards",
        "record": "Record a run, with a pressure plan or without",
        "serve": "Stream live samples to other programs: LSL, SECoP",
        "board.board": "Run a virtual board, with faults to choose",
        "camera": "Measure the elongation by a camera",
    },
    "results": {
        "analyze": "Compute every figure of a run",
        "analyze.report": "Write a report of one run or several",
        "certificate": "Write a calibration certificate (PDF with DCC)",
        "calibration": "Write a calibration as JSON, CSV, C or MATLAB",
        "calibration.convert": "Convert signals to elongation",
        "analyze.strokes": "Measure the strokes of a continuous run",
        "fit": "Fit a polynomial calibration to two columns",
        "folders.batch": "Analyse a folder of runs into one table",
        "folders.history": "Show the calibrations of a unit over time",
    },
    "files": {
        "importing.importing": "Turn a table of samples into a recording",
        "importing.export": "Write samples: CSV, Parquet, HDF5, MAT, ROS",
        "recordings.info": "Summarise a run",
        "recordings.verify": "Check a run against its raw bytes",
        "recordings.recover": "Close an interrupted recording, or save its readable part",
        "recordings.upgrade": "Convert a recording of an older version",
        "recordings.metadata": "Show or change the metadata of a recording",
        "setup.examples": "Copy the example recordings and a notebook",
    },
    "models": {
        "optics": "Trace rays; sweep and optimise designs",
        "shadow": "Solve the finite-element model (digital shadow)",
        "twin": "Control the elongation of a unit",
    },
    "methods": {
        "reproduce": "Compute the figures of the paper again",
        "methods.tradeoff": "Measure time against error of every method",
        "methods.atlas": "Map where each method works and where not",
    },
    "computer": {
        "configuration.config": "Show and change settings",
        "configuration.unit": "Show and change units under test",
        "board.profile": "Propose a text profile for other firmware",
        "setup": "Compile ahead; install shell completion",
        "qualify": "Run the fault drills on this computer",
        "setup.bugreport": "Pack log, settings and versions into one file",
    },
}
_FIRST = ("demo", "ports", "record", "analyze", "report")
_NAMES = {"importing": "import"}  # where the name of the function is not that of the command
_STYLE: dict[str, Any] = {"rich_markup_mode": None, "pretty_exceptions_enable": False}
_UsageError: Any = typer.BadParameter.__mro__[1]  # releases of typer differ in the package that has it


class LazyCommands(Mapping[str, Any]):
    """Commands and groups by name; each is imported when it is looked up."""

    def __init__(self) -> None:
        self._places = {self._name(place): place for group in _GROUPS.values() for place in group}
        self.summaries = {self._name(place): text for group in _GROUPS.values() for place, text in group.items()}
        self.groups = {name: [*map(self._name, group)] for name, group in _GROUPS.items()}
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
        from boat_daq.commands.usage import plain

        module, _, attribute = place.rpartition(".")
        imported = import_module(f"{commands.__name__}.{module or attribute}")
        found = getattr(imported, attribute if module or not hasattr(imported, "app") else "app")
        parent = typer.Typer(add_completion=False, **_STYLE)
        if isinstance(found, typer.Typer):
            parent.add_typer(found, name=name)
        else:
            parent.command(name, cls=getattr(imported, "COMMAND_CLASS", None))(found)
        return plain(typer.main.get_group(parent).commands[name])


class Root(TyperGroup):
    """The program's group of commands."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands: Any = LazyCommands()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of --help."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the first commands, then the others in their groups."""
        self._write(formatter, "Begin with", _FIRST)
        for group, names in self.commands.groups.items():
            self._write(formatter, group.capitalize(), [name for name in names if name not in _FIRST])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write where more help is, and where faults are reported."""
        from boat_daq.engine.installation import address_of

        places = [("boat-daq COMMAND -h", "explains a command, with an example"), ("boat-daq GROUP", "lists a group")]
        places.append(("boat-daq help tutorial", "shows a calibration step by step"))
        known = ((label, address_of(label)) for label in ("Documentation", "Issues"))
        places += [(label, address) for label, address in known if address]
        places.append(("Faults", "boat-daq bugreport --out report.zip packs what a report needs"))
        with formatter.section("More"):
            formatter.write_dl(places)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command of a call; the name of a group lists its commands, `help` stands for --help."""
        name = args[0].lower()
        if name == "help":
            args = [*args[1:], "--help"] if args[1:] else ["--help"]
            if args == ["--help"]:
                typer.echo(ctx.get_help())
                raise typer.Exit
            if args == ["tutorial", "--help"]:
                from boat_daq.commands.setup import show_tutorial

                show_tutorial()
                raise typer.Exit
        elif name in self.commands.groups:
            formatter = ctx.make_formatter()
            self._write(formatter, name.capitalize(), self.commands.groups[name])
            typer.echo(formatter.getvalue().rstrip())
            raise typer.Exit
        return super().resolve_command(ctx, args)

    def _write(self, formatter: Any, title: str, names: Sequence[str]) -> None:
        with formatter.section(title):
            formatter.write_dl([(name, self.commands.summaries[name]) for name in names])


app = typer.Typer(
    name="boat-daq", cls=Root, add_completion=False, context_settings={"help_option_names": ["-h", "--help"]}, **_STYLE
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


def _flush_output() -> None:
    """Write what is left in the buffers; a closed pipe, as after `| head`, ends the call without a message."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _write_nowhere()
        raise SystemExit(1) from None  # as typer leaves where it meets one


def _write_nowhere() -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # what is left in the buffers is written at the end
    os.close(nowhere)


def _unwritten(error: Exception) -> Exception | None:
    """Return the error of an output on a full or failing disk, which is then discarded; None for another error."""
    if not isinstance(error, OSError) or error.filename or error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
        return None
    from protocol.base.errors import StorageError

    _write_nowhere()
    return StorageError(f"the output cannot be written: {error.strerror}", "free disk space, or choose another disk")


def explain(error: Exception) -> tuple[str, str]:
    """Return cause and remedy of an error; the traceback of an unexpected one is written to the log."""
    from protocol.base.errors import cause_and_remedy

    if (known := cause_and_remedy(error)) is not None:
        remedy, command = known[1], getattr(error, "command", "")
        return known[0], f"{remedy.rstrip('.')}: {command}" if remedy and command else remedy or command
    if isinstance(error, OSError) and error.filename and error.strerror:
        absent = isinstance(error, FileNotFoundError)
        remedy = "check the path" if absent else "check the path, its permissions and the free space of the disk"
        return f"{error.filename}: {error.strerror}", remedy
    from boat_daq.engine.log import note_failure, start_log, stop_log

    path = start_log()
    note_failure("an error of the program", error)
    stop_log()
    where = f"; the details are in {path}" if path else ""
    return f"an error of the program: {type(error).__name__}: {error}{where}", "boat-daq bugreport --out FILE.zip"


_PLAIN = {
    r"a valid float( range)?": "a number",
    r"a valid int(eger)?( range)?": "a whole number",
    r"is not in the range x>=(\S+)$": r"is below \1",
    r"is not in the range (\S+)<=x<=(\S+)$": r"is not within \1 to \2",
}  # texts of the library that reads the options


def _usage(error: Any) -> tuple[str, str]:
    """Return cause and remedy of a wrong call."""
    called = error.ctx.command_path if error.ctx is not None else "boat-daq"
    text = error.format_message().rstrip(".")
    for of_the_parser, plain in _PLAIN.items():
        text = re.sub(of_the_parser, plain, text)
    return text, f"{called} --help"


def main() -> None:
    """Run the command line; failures become the exit codes of the surface (0, 1, 2, 130)."""
    from boat_daq.commands.console import emit_error, prepare_output

    interruption = Interruption()
    prepare_output()
    if "_BOAT_DAQ_COMPLETE" in os.environ:
        from typer._completion_classes import completion_init

        completion_init()
    try:
        code = app(standalone_mode=False, prog_name="boat-daq")
        _flush_output()
        raise SystemExit(code if isinstance(code, int) else 0)
    except (SystemExit, KeyboardInterrupt, typer.Abort) as leaving:
        if not interruption.came:
            raise SystemExit(getattr(leaving, "code", 1)) from None
        interruption.leave()
        raise SystemExit(130) from leaving  # releases of typer differ in the code they leave with after Ctrl-C
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
        else:
            emit_error("UsageError", *_usage(error), as_json="--json" in sys.argv)
        raise SystemExit(2) from None
    except Exception as caught:  # noqa: BLE001 - the last one to see it
        from protocol.base.errors import ChoiceError

        failure = _unwritten(caught) or caught
        emit_error(type(failure).__name__, *explain(failure), as_json="--json" in sys.argv)
        raise SystemExit(2 if isinstance(failure, ChoiceError) else 1) from None
