"""`boat-daq shadow modulus` and `replay`: the shadow against what was measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, progress_bar, say

if TYPE_CHECKING:
    from analysis.arrays import FloatArray
    from analysis.data.recording import Recording

from boat_daq.commands.shadow_options import ParametersOption, chosen_parameters, save_figure

NO_SIGHT = "too few cycles for the alarms to find anything"


def modulus(
    files: Annotated[list[Path], typer.Argument(metavar="FILE.csv...", help="One compression test a specimen.")],
    height_mm: Annotated[float, typer.Option(help="Height of the specimens at rest, mm.")],
    area_mm2: Annotated[float, typer.Option(help="Cross-section of the specimens at rest, mm².")],
    window: Annotated[tuple[float, float], typer.Option(help="Strains between which the slope is taken.")] = (
        0.02,
        0.1,
    ),
    force_column: Annotated[str | None, typer.Option(help="Name or number of the force column.")] = None,
    displacement_column: Annotated[str | None, typer.Option(help="Name or number of the displacement column.")] = None,
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Effective modulus of the lattice from uniaxial compression, and the band it leaves of nominal elongation.

    Example: boat-daq shadow modulus s1.csv s2.csv s3.csv --height-mm 50 --area-mm2 2500
    """
    import math
    from dataclasses import asdict, replace

    import numpy as np

    from analysis.shadow.model.modulus import effective_modulus, read_compression_test
    from analysis.shadow.model.table import load_table

    if len({path.resolve() for path in files}) < len(files):
        raise typer.BadParameter("one file is given for two specimens, which leaves no spread", param_hint="FILE.csv")
    tests = [read_compression_test(path, height_mm, area_mm2, force_column, displacement_column) for path in files]
    found = effective_modulus(tests, window)
    spread = found.sd_kpa if math.isfinite(found.sd_kpa) else found.standard_error_kpa
    actuator = replace(chosen_parameters(parameters), lattice_modulus_kpa=found.mean_kpa, lattice_modulus_sd_kpa=spread)
    with progress_bar("building the table") as progress:
        table = load_table(actuator, progress=progress)
    ends = table.pressure_range_kpa
    pressures = np.array([p for p in (-40.0, -20.0, 20.0, 50.0) if ends[0] <= p <= ends[1]])
    nominal, band = table.nominal_elongation(pressures)
    if as_json:
        emit_json(
            asdict(found)
            | {
                "n": len(tests),
                "band": [
                    {"pressure_kpa": p, "nominal_elongation_mm": x, "standard_uncertainty_mm": u}
                    for p, x, u in zip(pressures, nominal, band, strict=True)
                ],
            }
        )
        return
    for one in found.specimens:
        say(f"{one.name}: {one.modulus_kpa:.2f} kPa (R² {one.r2:.4f}, {one.points} points)")
    say(f"E = {found.mean_kpa:.2f} ± {spread:.2f} kPa, N = {len(tests)}")
    for p, x, u in zip(pressures, nominal, band, strict=True):
        say(f"{p:+.0f} kPa: {x:+.3f} ± {u:.3f} mm (k = 1)")


def replay(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A .boat file, or a CSV that `import` understands.")],
    calibration: Annotated[Path | None, typer.Option(help="Run to calibrate from; RUN itself by default.")] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of read elongations of the calibration.")] = None,
    parameters: ParametersOption = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the deviation into this file.")] = None,
    as_json: JsonOption = False,
) -> None:
    """A run against the shadow: deviation, drift over cycles, and the alarms that it would have raised.

    Example: boat-daq shadow replay repeatability.boat --calibration calibration.boat --plot deviation.png
    """
    import math

    from analysis.data.load import load_recording
    from analysis.segmentation.cycles import find_cycles
    from analysis.shadow.model.table import load_table
    from analysis.shadow.monitoring.replay import replay as compare
    from analysis.shadow.monitoring.replay import replay_figure

    recording = load_recording(run)
    elongations = measured_elongations(recording, calibration or run, elongation)
    with progress_bar("building the table") as progress:
        table = load_table(chosen_parameters(parameters), progress=progress)
    result = compare(
        table,
        recording.time_s,
        recording.pressure_kpa,
        elongations,
        [cycle.rows for cycle in find_cycles(recording).complete],
    )
    summary = result.summary() | {"simulated": recording.simulated}
    if plot is not None:
        save_figure(replay_figure(result), plot)
    if as_json:
        emit_json(summary)
        return
    if recording.simulated:
        say("SIMULATED")
    say(
        f"{summary['cycles']} cycles; deviation {summary['deviation_mean_mm']:+.3f} mm on average, "
        f"{summary['deviation_rms_mm']:.3f} mm rms, {summary['inside_band_percent']:.0f} % inside the band (k = 2)"
    )
    for alarm in result.alarms:
        say(f"ALARM in cycle {alarm.cycle}: {alarm.sentence}")
    for cause in result.left_out:
        say(f"left out: {cause}")
    seen = ", ".join(f"{name} {size:.2g}" for name, size in result.smallest_shift.items() if math.isfinite(size))
    say(f"smallest shifts that these cycles would show from now on: {seen}" if seen else NO_SIGHT)


def measured_elongations(recording: Recording, calibration: Path, elongation: Path | None) -> FloatArray:
    """Return each sensor's elongation by the calibration of a run, shape (n, sensors); NaN outside its range."""
    import numpy as np

    from analysis.calibration.inverse import Inverse
    from analysis.errors import DataError
    from analysis.figures.pipeline import analyse

    sensors = analyse(calibration, elongation, mcmc=False).sensors
    if len(sensors) != recording.n_sensors:
        raise DataError(
            f"{calibration.name} has {len(sensors)} sensors, the run {recording.n_sensors}",
            "give a calibration of the same unit",
        )
    columns = []
    for number, sensor in enumerate(sensors):
        if sensor.calibration is None:
            raise DataError(
                f"{calibration.name} holds no calibration: {sensor.calibration_void}",
                "give --calibration RUN or --elongation FILE.csv",
            )
        signal = np.where(recording.usable[:, number], recording.signal_mv[:, number], np.nan)
        columns.append(Inverse.of(sensor.calibration)(signal))
    return np.stack(columns, axis=1)
