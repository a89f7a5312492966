"""`boat-daq shadow modulus` and `replay`: the shadow and measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, present, progress_bar, show
from boat_daq.commands.options import PlotOption, RunArgument
from boat_daq.commands.shadow_options import ParametersOption, chosen_parameters, chosen_table, save_figure

BAND_PRESSURES_KPA = (-40.0, -20.0, 20.0, 50.0)


def modulus(
    files: Annotated[list[Path], typer.Argument(metavar="FILE.csv...", help="One compression test a specimen.")],
    height_mm: Annotated[float, typer.Option(help="Height of the specimens at rest, mm.")],
    area_mm2: Annotated[float, typer.Option(help="Cross-section of the specimens at rest, mm².")],
    window: Annotated[tuple[float, float], typer.Option(help="Range of strain for the slope.")] = (0.02, 0.1),
    force_column: Annotated[str | None, typer.Option(help="Name or number of the force column.")] = None,
    displacement_column: Annotated[str | None, typer.Option(help="Name or number of the displacement column.")] = None,
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find the effective modulus of the lattice from uniaxial compression, and its effect on nominal elongation.

    Example: boat-daq shadow modulus s1.csv s2.csv s3.csv --height-mm 50 --area-mm2 2500
    """
    import math
    from dataclasses import asdict, replace

    import numpy as np

    from analysis.shadow.model.modulus import effective_modulus, read_compression_test

    if len({path.resolve() for path in files}) < len(files):
        raise typer.BadParameter("one file is given for two specimens, which leaves no spread", param_hint="FILE.csv")
    tests = [read_compression_test(path, height_mm, area_mm2, force_column, displacement_column) for path in files]
    found = effective_modulus(tests, window)
    spread = found.sd_kpa if math.isfinite(found.sd_kpa) else found.standard_error_kpa
    table = chosen_table(
        replace(chosen_parameters(parameters), lattice_modulus_kpa=found.mean_kpa, lattice_modulus_sd_kpa=spread)
    )
    low, high = table.pressure_range_kpa
    pressures = np.array([p for p in BAND_PRESSURES_KPA if low <= p <= high])
    band = list(zip(pressures, *table.nominal_elongation(pressures), strict=True))
    keys = ("pressure_kpa", "nominal_elongation_mm", "standard_uncertainty_mm")
    present(
        asdict(found) | {"n": len(tests), "band": [dict(zip(keys, row, strict=True)) for row in band]},
        *(f"{one.name}: {one.modulus_kpa:.2f} kPa (R² {one.r2:.4f}, {one.points} points)" for one in found.specimens),
        f"E = {found.mean_kpa:.2f} ± {spread:.2f} kPa, N = {len(tests)}",
        *(f"{p:+.0f} kPa: {x:+.3f} ± {u:.3f} mm (k = 1)" for p, x, u in band),
        as_json=as_json,
    )


def replay(
    run: RunArgument,
    calibration: Annotated[Path | None, typer.Option(help="Run to calibrate from; default RUN itself.")] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of the calibration's elongation readings.")] = None,
    parameters: ParametersOption = None,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare a run with the shadow: deviation, drift over cycles, and the alarms of the monitor.

    Example: boat-daq shadow replay repeatability.boat --calibration calibration.boat --plot deviation.png
    """
    import math

    from analysis import analyse, find_cycles, load_recording
    from analysis.figures.against_shadow import measured_elongation
    from analysis.shadow.monitoring.replay import replay as compare
    from analysis.shadow.monitoring.replay import replay_figure

    recording = load_recording(run)
    with progress_bar("calibrating") as progress:
        sensors = analyse(calibration or run, elongation, mcmc=False, progress=progress).sensors
    result = compare(
        chosen_table(chosen_parameters(parameters)),
        recording.time_s,
        recording.pressure_kpa,
        measured_elongation(recording, sensors),
        [cycle.rows for cycle in find_cycles(recording).complete],
    )
    summary = result.summary() | {"simulated": recording.simulated}
    if plot is not None:
        save_figure(replay_figure(result), plot)
    if as_json:
        emit_json(summary)
        return
    if recording.simulated:
        show("SIMULATED")
    show(
        f"{summary['cycles']} cycles; deviation {summary['deviation_mean_mm']:+.3f} mm on average, "
        f"{summary['deviation_rms_mm']:.3f} mm rms, {summary['inside_band_percent']:.0f} % inside the band (k = 2)"
    )
    for alarm in result.alarms:
        show(f"ALARM in cycle {alarm.cycle}: {alarm.sentence}")
    for cause in result.left_out:
        notify(f"omitted: {cause}")
    detectable = ", ".join(f"{name} {size:.2g}" for name, size in result.smallest_shift.items() if math.isfinite(size))
    show(
        f"smallest shifts that further cycles would show: {detectable}"
        if detectable
        else "too few cycles for the alarms to detect a shift"
    )
