"""`boat-daq ports`: the serial ports, and which of them are BOAT boards."""

from __future__ import annotations

from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar, show


def ports(
    port: Annotated[
        list[str] | None,
        typer.Option("--port", help="Only this port, a device or socket://HOST:PORT; may be repeated."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the serial ports, each BOAT board marked with *.

    Each port is opened, identified and closed; no pressure is commanded. Pseudo-terminals are not in the system's list:
    name them with --port.

    Example: boat-daq ports --port /dev/pts/3
    """
    from boat_daq.engine.link.opening import identify_all_ports, identify_port

    if port:
        answers = [identify_port(name) for name in port]
    else:
        with progress_bar("identifying") as progress:
            answers = identify_all_ports(progress=progress)
    if as_json:
        fields = {"port": "port", "description": "description", "hello": "hello", "remark": "problem"}
        rows = [{key: getattr(a, name) for key, name in fields.items()} for a in answers]
        emit_json({"ports": [{**row, "boat": row["hello"] is not None} for row in rows]})
        return
    if not answers:
        notify("no serial ports; for a virtual board: boat-daq board --pty")
    for a in answers:
        board = f"BOAT {a.hello.board_id}, {a.hello.n_sensors} sensors" if a.hello else a.problem
        show(f"{'*' if a.hello else ' '} {a.port}  {a.description}  {board}".rstrip())
