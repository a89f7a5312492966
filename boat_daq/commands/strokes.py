"""`boat-daq strokes`: strokes and hysteresis loops of a continuous run."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, show, show_table
from boat_daq.commands.options import MapOption, RateOption, RunArgument


def strokes(
    run: RunArgument,
    mapping: MapOption = None,
    rate: RateOption = None,
    min_speed: Annotated[
        float, typer.Option(min=0.0, metavar="KPA_PER_S", help="Slower samples are omitted from the half width.")
    ] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Measure the strokes of a continuous run: span and period, and each sensor's friction, half width and loop area.

    The half width is that of the loop of signal over pressure, in mV; the friction is the same along the pressure, in
    kPa. Mean and standard deviation are over the cycles; no calibration is needed.

    Example: boat-daq strokes repeatability.boat --json
    """
    from analysis import load_recording
    from analysis.segmentation.strokes import stroke_figures
    from boat_daq.commands.importing import column_map

    recording = load_recording(run, columns=column_map(mapping) or None, rate_hz=rate)
    figures = stroke_figures(recording, min_speed_kpa_per_s=min_speed)
    if as_json:
        emit_json({"simulated": recording.simulated, **figures})
        return
    show(
        f"{'SIMULATED  ' if recording.simulated else ''}{recording.source}: {figures['cycles']} cycles, "
        f"{figures['strokes_up']} strokes up, {figures['strokes_down']} down"
    )
    sensors = figures.pop("sensors")
    show_table(
        ("pressure", ""), ((name, _text(value)) for name, value in figures.items() if name.endswith(("_kpa", "_s")))
    )
    rows = ([name, *(_text(sensor[name]) for sensor in sensors)] for name in sensors[0] if name != "name")
    show_table(("loop", *(sensor["name"] for sensor in sensors)), rows)


def _text(value: Any) -> str:
    """Return a value, or a mean with its standard deviation, which a single cycle does not have."""
    if not isinstance(value, dict):
        return f"{value:.4g}"
    spread = f" ± {value['sd']:.2g}" if math.isfinite(value["sd"]) else ""
    return f"{value['mean']:.4g}{spread}"
