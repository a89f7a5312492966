"""`boat-daq board`: a virtual board on a port."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, say


def board(
    pty: Annotated[bool, typer.Option("--pty", help="On a pseudo-terminal.")] = False,
    tcp: Annotated[str | None, typer.Option("--tcp", metavar="HOST:PORT", help="On TCP; port 0 = any.")] = None,
    speed: Annotated[float, typer.Option(min=1, max=1000, help="Board time over wall time.")] = 1.0,
    unit: Annotated[str, typer.Option(help="SA1, SA2, SA3; with -falling behind it, the signal falls.")] = "SA1",
    seed: Annotated[int, typer.Option(min=0, help="Of all noise.")] = 0,
    fault: Annotated[
        list[str] | None, typer.Option("--fault", metavar="NAME@SECONDS[:VALUE]", help="See --list-faults.")
    ] = None,
    truth: Annotated[Path | None, typer.Option(help="CSV of the noise-free values beside each sample.")] = None,
    link: Annotated[Path | None, typer.Option(help="Symbolic link to the pseudo-terminal.")] = None,
    allow_remote: Annotated[bool, typer.Option("--allow-remote", help="Let --tcp leave this machine.")] = False,
    list_faults: Annotated[bool, typer.Option("--list-faults", help="Name the faults and leave.")] = False,
    as_json: JsonOption = False,
) -> None:
    """A virtual board; its port's name is the first line of standard output. Ctrl-C ends it.

    With --json that line is an object: port, unit, seed, speed, and the unit's true figures. Everything the board sends
    says SIMULATED. Example:

        boat-daq board --pty --speed 100 --fault estop@30:5 --truth truth.csv
    """
    if list_faults:
        from protocol.simulator.faults import FAULTS, fault_list

        if as_json:
            emit_json(FAULTS)
        else:
            typer.echo(fault_list())
        return
    if pty == (tcp is not None):
        raise typer.BadParameter("use either --pty or --tcp HOST:PORT")
    if tcp is not None and link is not None:
        raise typer.BadParameter("--link goes with --pty")
    from boat_daq.engine.simulator.server import BoardServer, BoardSettings

    server = BoardServer(
        BoardSettings(
            port=tcp or "pty",
            speed=speed,
            unit=unit,
            seed=seed,
            faults=tuple(fault or ()),
            truth=str(truth) if truth else None,
            link=str(link) if link else None,
            allow_remote=allow_remote,
        )
    )
    try:
        say(f"SIMULATED board {unit} at {speed:g}x on {server.url}; Ctrl-C ends it")
        if as_json:
            from protocol.simulator.truth import truth_figures

            emit_json({"port": server.url, "unit": unit, "seed": seed, "speed": speed, "truth": truth_figures(unit)})
        else:
            typer.echo(server.url)
        server.run(lambda: False, typer.echo)
    finally:
        server.close()
