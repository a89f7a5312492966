"""`boat-daq record`: one session without a window, from the port to a closed recording."""

from __future__ import annotations

import dataclasses
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, say

if TYPE_CHECKING:
    from boat_daq.engine.plan import Plan


def record(
    port: Annotated[str, typer.Option(help="Serial port, pty, socket://HOST:PORT or replay:FILE[@SPEED].")],
    profile: Annotated[Path | None, typer.Option(help="Text profile (TOML) of another firmware.")] = None,
    plan: Annotated[str | None, typer.Option(help="calibration, repeatability, or a plan's TOML file.")] = None,
    cycles: Annotated[int | None, typer.Option(help="Cycles, in place of the plan's.", min=1)] = None,
    dwell: Annotated[float | None, typer.Option(help="Shortest hold, s, in place of the plan's.", min=0)] = None,
    ramp: Annotated[float | None, typer.Option(help="Ramp, kPa/s, in place of the plan's.", min=0.01)] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of readings: pressure_kpa,elongation_mm.")] = None,
    out: Annotated[Path | None, typer.Option(help="Recording to write; a dated name when left out.")] = None,
    operator: Annotated[str, typer.Option(help="Who records.")] = "",
    unit: Annotated[str, typer.Option(help="The unit on the bench: SA1 ...")] = "",
    note: Annotated[str, typer.Option(help="A line to remember.")] = "",
    rate: Annotated[int | None, typer.Option(help="Samples per second; the setting's when left out.", min=1)] = None,
    duration: Annotated[float | None, typer.Option(help="Without a plan: seconds to record.", min=0)] = None,
    as_json: JsonOption = False,
) -> None:
    """Record a session: with a plan the pressure sequence is run, without one it only listens.

    Ctrl-C vents, closes the recording properly and exits 130.

    Example: boat-daq record --port /dev/ttyACM0 --plan calibration --unit SA1 --out SA1.boat
    """
    from boat_daq.commands.run_session import SessionRequest, run_session
    from boat_daq.engine.readings import check_against_plan, enter_readings, read_elongation_csv

    chosen = choose_plan(plan, cycles=cycles, dwell_s=dwell, ramp_kpa_per_s=ramp)
    readings = read_elongation_csv(elongation) if elongation is not None else None
    if readings is not None and chosen is not None:
        check_against_plan(readings, chosen)
    summary, failure = run_session(
        SessionRequest(
            port=port,
            path=out if out is not None else dated_name(unit),
            plan=chosen,
            profile=str(profile) if profile else None,
            rate_hz=rate,
            unit=unit,
            duration_s=duration,
            metadata={"operator": operator, "unit": unit, "note": note},
        ),
        (lambda session: enter_readings(session, readings)) if readings is not None else None,
    )
    if as_json:
        emit_json({**dataclasses.asdict(summary), "failed": bool(failure), "failure": failure})
    say(
        f"{summary.path}: {summary.samples} samples in {summary.duration_s:.1f} s, {summary.lost_samples} lost, "
        f"{summary.cycles.complete} complete cycles, {summary.readings} readings; {summary.stop_reason}"
    )
    if failure:
        say("the run did not end as planned (see above); the recording holds everything until then")
        raise typer.Exit(1)


def choose_plan(
    name: str | None, *, cycles: int | None, dwell_s: float | None, ramp_kpa_per_s: float | None
) -> Plan | None:
    """Return the plan of that name with the values put in place of its own."""
    from boat_daq.engine.plan import load_plan
    from boat_daq.errors import OperatorError

    if name is None:
        if (cycles, dwell_s, ramp_kpa_per_s) != (None, None, None):
            raise OperatorError("--cycles, --dwell and --ramp change a plan, and there is none", "add --plan NAME")
        return None
    plan = load_plan(name)
    if cycles is not None:
        plan = dataclasses.replace(plan, cycles=cycles)
    if ramp_kpa_per_s is not None:
        plan = dataclasses.replace(plan, ramp_kpa_per_s=ramp_kpa_per_s)
    return plan if dwell_s is None else plan.with_dwell(dwell_s)


def dated_name(unit: str) -> Path:
    """Return a free name in this folder: date, time and unit."""
    stamp = datetime.now().astimezone().strftime("%Y-%m-%d_%H%M%S")
    return Path(f"{stamp}_{unit}.boat" if unit else f"{stamp}.boat")
