"""`boat-daq serve`: a board's samples as LSL streams, and the session as a SECoP node, without a window."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from boat_daq.commands.console import JsonOption, emit_json, notify, show
from boat_daq.commands.options import PortOption, ProfileOption
from boat_daq.workflows.outlets import ADDRESS, HOLD_S, NodeChoice
from protocol.base.errors import RequestError

if TYPE_CHECKING:
    from boat_daq.engine.outlets.lsl import LslOutlet
    from boat_daq.engine.outlets.secop_server import SecopServer
    from boat_daq.engine.plan import Plan
    from boat_daq.engine.session.session import Session
    from boat_daq.workflows.live_conversion import Conversion


class ServeCommand(TyperCommand):
    """Gives `--secop` its usual address where none follows it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for at in (i for i, arg in enumerate(args) if arg == "--secop"):
            if at + 1 == len(args) or args[at + 1].startswith("-"):
                return super().parse_args(ctx, [*args[: at + 1], ADDRESS, *args[at + 1 :]])
        return super().parse_args(ctx, args)


COMMAND_CLASS = ServeCommand


AllowControlOption = Annotated[
    bool,
    typer.Option("--allow-control", help="SECoP clients with the token may command."),
]
ListenOption = Annotated[
    str, typer.Option(metavar="ADDRESS", help="Accept SECoP clients on this address; needs --token-file.")
]
PlansOption = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="SECoP clients may arm the plans in its TOML files as well.")
]
TokenFileOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Token that clients send; default one of this user's.")
]
HoldOption = Annotated[
    float,
    typer.Option(
        "--hold-after-disconnect", metavar="S", min=0, help="Vent a pressure this long after its client left."
    ),
]


def serve(
    port: PortOption,
    profile: ProfileOption = None,
    unit: Annotated[str, typer.Option(help="Name of the unit: its limits hold, its calibration gives mm.")] = "",
    lsl: Annotated[bool, typer.Option("--lsl", help="Stream samples and markers over LSL, on this computer.")] = False,
    lsl_network: Annotated[bool, typer.Option("--lsl-network", help="Stream over LSL to other computers too.")] = False,
    secop: Annotated[str, typer.Option(metavar="[HOST:PORT]", help=f"Serve as a SECoP node; default {ADDRESS}.")] = "",
    allow_control: AllowControlOption = False,
    listen: ListenOption = "",
    plans: PlansOption = None,
    token_file: TokenFileOption = None,
    hold: HoldOption = HOLD_S,
    record: Annotated[Path | None, typer.Option(metavar="FILE.boat", help="Also record to this file.")] = None,
    duration: Annotated[float | None, typer.Option(min=0, help="Seconds to serve; default until Ctrl-C.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Serve a board's live data to other programs: LSL streams, a SECoP node, or both.

    Clients read. With --allow-control those that send the token may also command, within the limits of unit, board and
    interlock; VENT is always accepted. A pressure whose client has left is vented after 30 s. Nothing is reachable from
    another computer unless --lsl-network or --listen says so. Ctrl-C vents.

    Example: boat-daq serve --port /dev/ttyACM0 --unit SA1 --lsl --secop
    """
    if not (lsl or lsl_network or secop or listen):
        raise typer.BadParameter("give --lsl, --secop, or both")
    from boat_daq.engine.log import start_log
    from boat_daq.engine.outlets.lsl import MARKERS, STREAM
    from boat_daq.engine.plan import built_in_plans, plans_in
    from boat_daq.engine.session.session import Session
    from boat_daq.workflows.live_conversion import conversion_in_force
    from boat_daq.workflows.outlets import open_streams

    start_log("serve")
    choice = NodeChoice(listen or secop or ADDRESS, allow_control, token_file, hold)
    _check_address(choice, "--listen" if listen else "--secop")
    armable = built_in_plans() if plans is None else plans_in(plans)
    with Session.open(port, profile=str(profile) if profile else None, unit=unit, record_to=record) as session:
        if session.wait(lambda _: session.live.ring is not None, 5.0).simulated:
            notify("SIMULATED: this is the virtual board")
        conversion, calibration = conversion_in_force(session, unit) if unit else (None, "no --unit is given")
        if conversion is None:
            notify(f"without elongation: {calibration}")
            calibration = ""
        outlet = node = None
        try:
            if lsl or lsl_network:
                outlet = open_streams(session, network=lsl_network, conversion=conversion, calibration_id=calibration)
                show(f"LSL streams {STREAM!r} and {MARKERS!r}, source_id {outlet.source_id}")
            if secop or listen:
                node = _opened(session, choice, conversion, armable)
            _wait(session, duration)
        finally:
            if node is not None:
                node.close()
            if outlet is not None:
                outlet.close()
            content = _summary(session, outlet, node)
    if as_json:
        emit_json(content)


def _check_address(choice: NodeChoice, option: str) -> None:
    try:
        _ = choice.host_and_port
    except RequestError as error:
        raise typer.BadParameter(error.cause, param_hint=option) from error


def _opened(
    session: Session, choice: NodeChoice, conversion: Conversion | None, plans: Mapping[str, Plan]
) -> SecopServer:
    """Return the SECoP node, and print how to reach it."""
    from boat_daq.engine.settings import recordings_folder
    from boat_daq.workflows.outlets import open_node

    folder = recordings_folder(session.settings)
    node = open_node(session, choice, folder, conversion=lambda: conversion, plans=lambda: plans)
    rights = "allowed" if choice.control else "not allowed"
    show(f"SECoP node {choice.host_and_port[0]}:{node.port}, control {rights}")
    if choice.token_path is not None:
        show(f"clients send: _authenticate TOKEN, the line in {choice.token_path}")
    return node


def _wait(session: Session, duration_s: float | None) -> None:
    """Print messages until the time is over or the link is closed."""
    from boat_daq.engine.snapshot import LinkState
    from boat_daq.workflows.session_messages import MessagePrinter

    told, end_s = MessagePrinter(notify), None if duration_s is None else time.monotonic() + duration_s
    while end_s is None or time.monotonic() < end_s:
        seen = session.snapshot()
        told(seen)
        if seen.link in (LinkState.CLOSED, LinkState.FAILED):
            return
        time.sleep(0.1)


def _summary(session: Session, outlet: LslOutlet | None, node: SecopServer | None) -> dict[str, Any]:
    seen = session.snapshot()
    lost = seen.health.statistics.lost if seen.health else 0
    content: dict[str, Any] = {"simulated": seen.simulated, "lost": lost, "lsl": None, "secop": None}
    if outlet is not None:
        content["lsl"] = {"pushed": outlet.pushed, "skipped": outlet.skipped, "clock": outlet.clock}
        notify(f"LSL: {outlet.pushed} samples pushed, {outlet.skipped} skipped, {_clock_text(outlet.clock)}")
    if node is not None:
        content["secop"] = {"port": node.port, "requests": node.requests, "refused": node.refused}
        notify(f"SECoP: {node.requests} requests, {node.refused} clients refused")
    notify(f"{lost} samples lost on the link")
    return content


def _clock_text(clock: dict[str, float | None]) -> str:
    drift, jitter = clock["drift_ppm"], clock["jitter_ms"]
    if drift is None or jitter is None:
        return "clock not yet known"
    return f"board's clock {drift:+z.0f} ppm against LSL's, arrivals scatter by {jitter:.2f} ms"
