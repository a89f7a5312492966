"""`boat-daq gui`: the window."""

from __future__ import annotations

from typing import Annotated

import typer


def gui(
    port: Annotated[str | None, typer.Option(help="Port to connect to at once.")] = None,
    board: Annotated[bool, typer.Option("--board", help="Connect to a virtual board.")] = False,
    speed: Annotated[float, typer.Option(min=1, max=1000, help="Virtual board's time over real time.")] = 1.0,
    rate: Annotated[int | None, typer.Option(help="Samples per second; default as in the settings.", min=1)] = None,
) -> None:
    """Open the window. Esc vents, in every state.

    Example: boat-daq gui --board
    """
    if port is not None and board:
        raise typer.BadParameter("use either --port or --board")
    from boat_daq.engine.log import start_log
    from boat_daq.gui.app import run

    start_log("gui")
    raise typer.Exit(run(port, board=board, speed=speed, rate_hz=rate))
