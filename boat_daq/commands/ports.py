"""`boat-daq ports`: what is plugged in, and which of it is a BOAT board."""

from __future__ import annotations

from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar, say


def ports(
    port: Annotated[
        list[str] | None,
        typer.Option("--port", help="Ask this port alone (may be repeated): a device, or socket://..."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List serial ports, with a mark at each BOAT board.

    Every port is opened, asked who is there, and closed: nothing moves. A pseudo-terminal is not on the system's
    list; ask it by its name.

    Example: boat-daq ports --port /dev/pts/3
    """
    from boat_daq.engine.link.discovery import identify_all_ports, identify_port

    if port:
        answers = [identify_port(name) for name in port]
    else:
        with progress_bar("asking") as progress:
            answers = identify_all_ports(progress=progress)
    if as_json:
        rows = [
            {
                "port": a.port,
                "description": a.description,
                "boat": a.hello is not None,
                "hello": a.hello,
                "remark": a.problem,
            }
            for a in answers
        ]
        emit_json({"ports": rows})
        return
    if not answers:
        say("no serial ports; a virtual board: boat-daq board --pty")
    for a in answers:
        board = f"BOAT {a.hello.board_id}, {a.hello.n_sensors} sensors" if a.hello else a.problem
        out.print(
            f"{'*' if a.hello else ' '} {a.port}  {a.description}  {board}".rstrip(), highlight=False, markup=False
        )
