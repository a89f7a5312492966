"""`boat-daq history`: the calibrations of one unit over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar, say

if TYPE_CHECKING:
    from analysis.figures.unit_history import UnitHistory


def history(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Holds .boat or .csv runs; NAME.elongation.csv beside.")
    ],
    unit: Annotated[str, typer.Option(metavar="NAME", help="The unit, as it was named when recording.")],
    check_point: Annotated[float, typer.Option(metavar="MM", help="Elongation of the control chart.")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the intervals.")] = 0,
    json: JsonOption = False,
) -> None:
    """The calibrations of one unit over time: coefficients, a control chart of a check point, En against the last one.

    Example:

        boat-daq history recordings --unit SA1 --check-point 2
    """
    from analysis.figures.unit_history import calibrations_in, unit_history

    with progress_bar("Analysing") as advance:
        found = calibrations_in(folder, unit, seed=seed, progress=advance)
    for entry in found.left_out:
        say(f"{entry['run']} left out: {entry['reason']}")
    sensors = range(min(len(a.sensors) for a in found.analyses))
    histories = [unit_history(found.analyses, i, check_point_mm=check_point) for i in sensors]
    if json:
        emit_json({
            "unit": unit, "simulated": any(a.recording.simulated for a in found.analyses),
            "sensors": [h.as_json() for h in histories], "left_out": found.left_out,
        })  # fmt: skip
        return
    if any(a.recording.simulated for a in found.analyses):
        out.print("SIMULATED")
    for one in histories:
        _print(one)


def _print(one: UnitHistory) -> None:
    from rich.table import Table

    from analysis.numbers import with_uncertainty

    table = Table("calibrated", f"y({one.check_point_mm:g} mm) ± U, mV", "En", "control", box=None, pad_edge=False)
    outside = set(one.out_of_control)
    for k, (when, value, expanded, en) in enumerate(zip(one.when, one.value_mv, one.expanded_mv, one.en, strict=True)):
        said = "" if en != en else f"{en:+.2f}"
        state = ("outside" if k in outside else "within") + (", differs from the last" if abs(en) > 1 else "")
        table.add_row(when, with_uncertainty(float(value), float(expanded)), said, state)
    limits = f", control limits {one.lower_mv:.2f} to {one.upper_mv:.2f} mV" if len(one.when) > 1 else ""
    out.print(f"{one.sensor}: mean {one.centre_mv:.2f} mV{limits}", highlight=False)
    out.print(table)
