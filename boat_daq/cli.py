"""The one console script. Every group of commands has its own file in `boat_daq/commands/`."""

from __future__ import annotations

import sys

import typer

from boat_daq.commands.console import say

# A command's file is imported only when its turn comes: `boat-daq board` must not wait for Qt or numba.
GROUPS = {
    "optics": "The optical model: trace, scene, sweep, optimise.",
    "shadow": "The digital shadow: solve, table, modulus, replay, export.",
}

app = typer.Typer(
    name="boat-daq",
    help="Calibrate soft optical sensors in pneumatic actuators: record, analyse, report.",
    no_args_is_help=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line; map failures to the exit codes of the surface (0, 1, 2, 130)."""
    try:
        app()
    except KeyboardInterrupt:
        say("stopped")
        sys.exit(130)
