"""`boat-daq history`: the calibrations of one unit over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar, show, show_table
from boat_daq.commands.options import FolderArgument, SeedOption

if TYPE_CHECKING:
    from analysis.figures.unit_history import UnitHistory


def history(
    folder: FolderArgument,
    unit: Annotated[str, typer.Option(metavar="NAME", help="Name of the unit, as recorded.")],
    check_point: Annotated[float, typer.Option(metavar="MM", help="Elongation of the control chart.")] = 0.0,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Show the calibrations of one unit over time: coefficients, a control chart of a check point, En to the previous.

    Example: boat-daq history recordings --unit SA1 --check-point 2
    """
    from analysis.figures.unit_history import calibrations_in, unit_history

    with progress_bar("Analysing") as advance:
        found = calibrations_in(folder, unit, seed=seed, progress=advance)
    for entry in found.left_out:
        notify(f"{entry['run']} omitted: {entry['reason']}")
    sensors = range(min(len(a.sensors) for a in found.analyses))
    histories = [unit_history(found.analyses, i, check_point_mm=check_point) for i in sensors]
    simulated = any(a.recording.simulated for a in found.analyses)
    if as_json:
        sensor_rows = [one.as_json() for one in histories]
        emit_json({"unit": unit, "simulated": simulated, "sensors": sensor_rows, "left_out": found.left_out})
        return
    if simulated:
        show("SIMULATED")
    for one in histories:
        _show(one)


def _show(one: UnitHistory) -> None:
    from analysis.numbers import with_uncertainty

    limits = f", control limits {one.lower_mv:.2f} to {one.upper_mv:.2f} mV" if len(one.when) > 1 else ""
    show(f"{one.sensor}: mean {one.centre_mv:.2f} mV{limits}")
    rows = []
    for k, (when, value, expanded, en) in enumerate(zip(one.when, one.value_mv, one.expanded_mv, one.en, strict=True)):
        state = "outside" if k in one.out_of_control else "within"
        rows.append((
            when, with_uncertainty(float(value), float(expanded)), "" if en != en else f"{en:+.2f}",
            state + (", differs from the previous" if abs(en) > 1 else ""),
        ))  # fmt: skip
    show_table(("calibrated", f"y({one.check_point_mm:g} mm) ± U, mV", "En", "control"), rows, left=4)
