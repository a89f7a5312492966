"""`boat-daq gui`: the lab window."""

from __future__ import annotations

from typing import Annotated

import typer


def gui(
    port: Annotated[str | None, typer.Option(help="Connect to this port at once.")] = None,
    board: Annotated[bool, typer.Option("--board", help="Open it on a virtual board.")] = False,
    speed: Annotated[float, typer.Option(min=1, max=1000, help="Of the virtual board.")] = 1.0,
    rate: Annotated[int | None, typer.Option(help="Samples per second; the setting's when left out.", min=1)] = None,
) -> None:
    """The lab window. Esc vents, in any state. Example:

    boat-daq gui --board
    """
    if port is not None and board:
        raise typer.BadParameter("use either --port or --board")
    from boat_daq.engine.log import start_log
    from boat_daq.gui.app import run

    start_log("gui")
    raise typer.Exit(run(port, board=board, speed=speed, rate_hz=rate))
