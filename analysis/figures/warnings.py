"""What a reader of the figures has to know besides: flags of a run and of its sensors, each a code and a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analysis.calibration.fit import Words, reservations
from analysis.figures import sensor_figures as metrics
from analysis.segmentation.cycles import disagreements_with_marks
from analysis.segmentation.losses import LossCounter

if TYPE_CHECKING:
    from analysis.figures.sensor_analysis import Run, SensorAnalysis

NOISY_SHARE = 0.01  # of the span of the pressure: above it the pressure is smoothed, and holds and bins lose their ends
MOST_SAID = 5  # remarks of an import; the preview has them all
BREAK_FLAGS = {"same": "break", "differs": "differs_over_break", "untested": "untested_break"}


def flags_of(run: Run, sensors: list[SensorAnalysis]) -> tuple[dict[str, str], ...]:
    """Return the flags of a run, those of its sensors last."""
    recording = run.recording
    flags: list[tuple[str, str]] = []
    if recording.simulated:
        flags.append(("simulated", "recorded from the virtual board: SIMULATED"))
    if recording.gaps:
        flags.append(("gaps", f"{recording.lost} samples lost in {len(recording.gaps)} gaps"))
    said = [*recording.meta.get("import_notes", ()), *recording.meta.get("import_issues", ())]
    flags += [("import", str(text)) for text in said[:MOST_SAID]]
    if len(said) > MOST_SAID:
        flags.append(("import", f"and {len(said) - MOST_SAID} more: see `boat-daq import --preview`"))
    if recording.meta.get("crc_errors"):
        text = f"{recording.meta['crc_errors']} frames failed their CRC; their samples count as lost"
        flags.append(("crc_errors", text))
    flags += [
        (name, f"{count} samples masked: {name.replace('_', ' ')}") for name, count in recording.masked.items() if count
    ]
    if recording.meta.get("damaged_blocks"):
        flags.append(("damaged", f"{recording.meta['damaged_blocks']} blocks of the file are damaged and left out"))
    if run.cycles.noise_kpa > NOISY_SHARE * run.cycles.span_kpa > 0:
        share = run.cycles.noise_kpa / run.cycles.span_kpa
        wave = "full scale reads short, loops read wide, by more than their intervals say"
        hit = "holds are uncertain" if run.plateaus else wave
        text = f"the pressure's noise of {run.cycles.noise_kpa:.2g} kPa is {share:.1%} of its span: {hit}"
        flags.append(("noisy_pressure", text))
    if not run.cycles.used:
        flags.append(("no_cycle", f"no complete cycle, {run.cycles.as_json()['partial']} partial"))
    flags += [(BREAK_FLAGS[found.verdict], found.sentence) for found in run.breaks]
    flags += [("partial_cycle", part.reason) for part in run.cycles.partial]
    flags += [("cycle_left_out", f"cycle {c.number}: {c.left_out}") for c in run.cycles.complete if c.left_out]
    flags += [
        (
            "excursion_left_out",
            f"{recording.time_s[e.first]:.1f} s: {e.low_kpa:+.1f} to {e.high_kpa:+.1f} kPa: {e.reason}",
        )
        for e in run.cycles.excursions
    ]
    flags += [("void", reason) for reason in run.loops.void]
    flags += [("marks_disagree", said) for said in disagreements_with_marks(run.cycles, recording)]
    for sensor in sensors:
        flags += [(code, f"{sensor.name}: {text}") for code, text in _sensor_flags(sensor, run)]
    return tuple({"code": code, "text": text} for code, text in flags)


def _sensor_flags(sensor: SensorAnalysis, run: Run) -> list[tuple[str, str]]:
    flags: list[tuple[str, str]] = []
    number = run.recording.sensor_names.index(sensor.name)
    signal = run.recording.signal_mv[:, number]
    signal = signal[np.isfinite(signal)]
    if signal.size > 1 and signal.min() == signal.max():
        text = f"the signal is constant, {signal[0]:.6g} mV in all {signal.size} samples: the sensor measured nothing"
        flags.append(("constant_signal", text))
    standing = LossCounter.of(run.recording, number).of_windows([slice(0, run.recording.n)]).standing
    if standing:
        share = f"{standing / run.recording.n:.1%}"
        text = f"{standing} samples ({share}) are clipped, frozen or dropped out though nothing flagged them: left out"
        flags.append(("flat", text))
    if sensor.figures["snr_db"].note.startswith("the full-scale output"):
        flags.append(("no_span", sensor.figures["snr_db"].note))
    for name, abscissa in (("sensor", "elongation"), ("system", "pressure")):
        figure = sensor.figures.get(f"{name}_hysteresis_percent_fso")
        if figure is not None and figure.note.startswith(metrics.BOUND):
            flags.append(("hysteresis_is_a_bound", f"the hysteresis over {abscissa} is {figure.note}"))
        elif figure is not None and metrics.IN_PART in figure.note:
            flags.append(("hysteresis_in_part", f"the hysteresis over {abscissa}: {figure.note}"))
    calibration, posterior = sensor.calibration, sensor.posterior
    if calibration is None:
        return [*flags, ("no_calibration", sensor.calibration_void)] if run.plateaus else flags
    if not calibration.monotone:
        inside = [t for t in calibration.turning_points if calibration.x_range[0] < t < calibration.x_range[1]]
        where = f"turns at {', '.join(f'{t:.2f}' for t in inside)} mm" if inside else "is flat"
        flags.append(("not_monotone", f"the curve {where}: its inverse is refused"))
    flags += [("calibration", text) for text in reservations(calibration, _words(sensor, run))]
    if posterior is None and run.options.mcmc:
        flags.append(("no_posterior", sensor.calibration_void))
    flags += [("posterior", text) for text in (posterior.reservations if posterior is not None else ())]
    if posterior is not None and not posterior.converged:
        flags.append(
            ("not_converged", f"the posterior is not converged: {posterior.steps} steps, tau {posterior.tau:.0f}")
        )
    low, high = calibration.x_range
    by_reading = run.reading_sd_mm * calibration.full_scale / (high - low)
    if by_reading > 2.0 * calibration.residual_sd:
        flags.append(
            (
                "reading_error_overstated",
                f"the readings scatter less than a reading error of {run.reading_sd_mm:.2f} mm would make them: "
                "posterior and uncertainty are too wide; give --x-resolution",
            )
        )
    return flags


def _words(sensor: SensorAnalysis, run: Run) -> Words:
    """Return how the sensor's points are called: reading, pressure, branch and cycle of their plateaus."""
    plateaus = [run.plateaus[int(i)] for i in sensor.point_plateau]
    x = sensor.calibration.x if sensor.calibration is not None else np.zeros(0)
    return Words(lambda i: f"the reading {x[i]:+.2f} mm at {plateaus[i].place}", "mm", "mV")
