"""The command line: start, interruption, and the number of options."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from boat_daq.cli import LazyCommands, app
from tests.analysis.calibration.sessions import CUBIC
from tests.analysis.calibration_export.calibrations import calibration_file, inverse_of
from tests.boat_daq.commands.calls import program
from tests.conftest import ROOT

EXAMPLE = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"
MOST_OPTIONS, MOST_OF_A_COMMAND = 250, 16
HEAVY = {"numpy", "rich", "pandas", "numba", "pydantic", "scipy", "matplotlib", "typst", "emcee", "PySide6"}

INTERRUPTED_IN_A_CALLBACK = """
import ctypes, os, signal, time
from boat_daq.cli import Interruption
Interruption()
discards = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
try:
    discards()
    time.sleep(20)
except KeyboardInterrupt:
    print("ended")
"""


UNFINISHED_OBJECTS = """
import os, signal
from boat_daq.cli import Interruption

class Unfinished:
    def __del__(self):
        self.parts

Interruption()
Unfinished()
try:
    os.kill(os.getpid(), signal.SIGINT)
except KeyboardInterrupt:
    Unfinished()
"""


INTERRUPTED_AGAIN = """
import os, signal
from boat_daq import __main__, cli

def app(**_):
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        os.kill(os.getpid(), signal.SIGINT)

ignore = signal.signal
def signal_again(number, handler):
    if handler is signal.SIG_IGN:
        signal.signal = ignore
        os.kill(os.getpid(), signal.SIGINT)
    return ignore(number, handler)

cli.app = app
signal.signal = signal_again
__main__.main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    ("call", "needed"),
    [
        ("--version", []),
        ("config get", ["rich"]),
        ("ports", ["numpy", "rich"]),
        (f"info {EXAMPLE}", ["numpy", "rich"]),
        (f"metadata {EXAMPLE}", ["numpy", "rich"]),
        (f"convert {EXAMPLE} --calibration SA1.json --json --out mm.csv", ["numpy", "pandas", "rich", "scipy"]),
        pytest.param(
            f"export {EXAMPLE} --calibration SA1.json --format csv --json --out run.csv",
            ["numpy", "pandas", "rich", "scipy"],
            marks=pytest.mark.nightly,
        ),
        pytest.param(
            f"analyze {EXAMPLE} --no-mcmc", ["numba", "numpy", "pandas", "rich", "scipy"], marks=pytest.mark.nightly
        ),
    ],
)
def test_a_call_imports_what_it_needs(call: str, needed: list[str], tmp_path: Path) -> None:
    """What only prints text starts within 0.2 s, without numpy and rich; a stored calibration needs no compiler."""
    if "SA1.json" in call:
        made = calibration_file(inverse_of(CUBIC, 3), inverse_of(CUBIC, 3))
        (tmp_path / "SA1.json").write_text(made.text(), encoding="utf-8")
    program = f"""
import atexit, sys
atexit.register(lambda: print(sorted({HEAVY} & set(sys.modules))))
from boat_daq.__main__ import main
sys.argv[1:] = {call.split()}
main()
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True, cwd=tmp_path
    )
    assert len(ended.stdout.splitlines()) > 1
    assert ended.stdout.splitlines()[-1] == str(needed)


def test_the_help_of_every_command_loads_no_library() -> None:
    program = f"""
import sys
from boat_daq.cli import LazyCommands
loaded = [*LazyCommands().values()]
print(len(loaded), sorted({HEAVY} & set(sys.modules)))
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout == f"{len(LazyCommands())} []\n"


def test_every_command_is_found_under_its_name() -> None:
    """Each name of `--help` loads a command of that name."""
    found = LazyCommands()
    assert {name: command.name for name, command in found.items()} == {name: name for name in found}


def commands_of(command: Any, name: str = "boat-daq") -> Iterator[tuple[str, Any]]:
    """Yield every command by its full name."""
    yield name, command
    for word, below in getattr(command, "commands", {}).items():
        yield from commands_of(below, f"{name} {word}")


def test_summaries_are_whole_in_the_help() -> None:
    """Within 60 characters, in groups, the first commands on top; no name of a command is missing."""
    found = LazyCommands()
    assert {name: text for name, text in found.summaries.items() if len(text) > 60} == {}
    inner = {name: command for name, command in commands_of(typer.main.get_command(app)) if name.count(" ") > 1}
    assert {name: text for name, one in inner.items() if len(text := one.get_short_help_str(200)) > 60} == {}
    shown = program("-h").out
    assert shown == program("--help").out == program("help").out
    tutorial = program("help", "tutorial").out
    assert "boat-daq record --port out/board" in tutorial
    assert ".md" not in tutorial
    lines = [line.split()[0] for line in shown.splitlines() if line.startswith("  ") and line.split()]
    assert lines.index("demo") < lines.index("gui")
    assert set(found) <= set(lines)
    assert "..." not in shown.partition("Begin with")[2]
    assert [line for line in shown.splitlines() if len(line) > 80] == []
    for group, names in found.groups.items():
        listed = program(group)
        assert listed.code == 0
        assert all(f"  {name} " in listed.out for name in names)


def test_no_type_of_python_is_shown() -> None:
    """`N`, `PATH`, `TEXT` in place of `<int range>`, and no list; every command but the window's takes --json."""
    for name, command in commands_of(typer.main.get_command(app)):
        shown = program(*name.split()[1:], "--help").out
        assert re.findall(r"<\w+[^>]*>", shown) == [], name
        assert "Example: " in shown or hasattr(command, "commands"), name
        assert "--json" in shown or hasattr(command, "commands") or name == "boat-daq gui", name


@pytest.mark.parametrize(
    ("call", "cause", "remedy"),
    [
        ("record --json", "Missing option", "boat-daq record --help"),
        ("analyse x --json", "Did you mean 'analyze'", "boat-daq --help"),
        ("export a --format xlsx --out b --json", "'xlsx' is none of", "boat-daq export --help"),
        ("record --port x --plan calibraton --json", "no plan 'calibraton'", "did you mean calibration"),
        ("optics trace --state 20 --json", "no state 20", "0 (most compressed) to 14"),
        ("config set rate_hzz=1 --json", "'rate_hzz' is not a known key", "did you mean rate_hz"),
        ("demo --cycles u --json", "'u' is not a whole number", "boat-daq demo --help"),
        ("demo --speed 0 --json", "0.0 is not within 1 to 100", "boat-daq demo --help"),
        ("tradeoff nonsense --out x --json", "no method 'nonsense'", "choose one of"),
    ],
)
def test_a_wrong_call_exits_2_and_is_explained_in_json(call: str, cause: str, remedy: str) -> None:
    """One object on standard output, two lines on standard error; a misspelled name is recognised."""
    ended = program(*call.split())
    assert ended.code == 2
    content = json.loads(ended.out)
    assert (cause in content["cause"], remedy in content["remedy"]) == (True, True)
    assert ended.err.startswith(f"error: {content['cause']}\n  try: {content['remedy']}")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/dev/full")
@pytest.mark.parametrize("call", ["--version", "config get --json"])
def test_a_full_disk_is_named(call: str) -> None:
    """Standard output that takes no more, at once or at the end: cause, remedy and exit code 1."""
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "boat_daq", *call.split()]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    cause = "error: the output cannot be written: No space left on device"
    assert (ended.returncode, ended.stderr.splitlines()) == (
        1,
        [cause, "  try: free disk space, or choose another disk"],
    )


@pytest.mark.skipif(os.name != "posix", reason="pipes")
def test_a_closed_pipe_is_no_fault() -> None:
    """A reader that closes, as `head` does, before the last of the output is written: no message, no traceback."""
    program = "from boat_daq import cli; cli.app = lambda **_: print('a line'); cli.main()"
    buffered, pipe = {**os.environ, "PYTHONUNBUFFERED": ""}, subprocess.PIPE
    started = subprocess.Popen([sys.executable, "-c", program], stdout=pipe, stderr=pipe, env=buffered)
    assert started.stdout is not None and started.stderr is not None
    started.stdout.close()
    with started:
        assert (started.stderr.read(), started.wait(60)) == (b"", 1)


def complete(words: str) -> list[str]:
    """Return what bash would offer for the last word."""
    environment = {"_BOAT_DAQ_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    command = [sys.executable, "-m", "boat_daq"]
    ended = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=60)
    return ended.stdout.split()


@pytest.mark.skipif(os.name != "posix", reason="bash")
def test_values_are_completed() -> None:
    """Plans and keys of settings, as names and choices are."""
    assert {"calibration", "repeatability"} <= set(complete("boat-daq record --plan "))
    assert complete("boat-daq config set rate_") == ["rate_hz="]


def test_ctrl_c_while_ctrl_c_is_handled_keeps_the_exit_code() -> None:
    """One during the handling of the first, one that is pending as the interpreter is to ignore them: -2 before."""
    command = [sys.executable, "-c", INTERRUPTED_AGAIN]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (130, "")


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_in_a_callback_of_compiled_code_still_ends() -> None:
    """Such a callback discards the exception: the command would run to its end, after a traceback."""
    command = [sys.executable, "-c", INTERRUPTED_IN_A_CALLBACK]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("ended\n", "")


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_what_ctrl_c_leaves_unfinished_prints_no_traceback() -> None:
    """A compilation that is interrupted leaves objects that fail to end; before Ctrl-C such a failure is printed."""
    command = [sys.executable, "-c", UNFINISHED_OBJECTS]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr.count("AttributeError") == 1


def options_of(command: Any, name: str = "boat-daq") -> Iterator[tuple[str, list[str]]]:
    """Yield every command with its options, without --help and --json, which each has."""
    named = [p.opts[0] for p in command.params if p.param_type_name == "option"]
    yield name, [option for option in named if option not in ("--help", "--json")]
    for word, below in getattr(command, "commands", {}).items():
        yield from options_of(below, f"{name} {word}")


def test_a_person_can_learn_the_options() -> None:
    """What nobody types is in a file or a setting: at most 250 options, 16 of a command."""
    found = dict(options_of(typer.main.get_command(app)))
    assert {"--scene", "--tolerance"} <= set(found["boat-daq optics trace"])
    assert sum(map(len, found.values())) <= MOST_OPTIONS
    assert {name: len(options) for name, options in found.items() if len(options) > MOST_OF_A_COMMAND} == {}
