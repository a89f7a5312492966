"""The warnings of a run and of its sensors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.calibration.adequacy import NOTICED_PERCENT, REFUSED_PERCENT, Adequacy, CurveVerdict
from analysis.calibration.checks import calibration_warnings
from analysis.figures.figure import Reason
from analysis.figures.reading_check import CheckedReading, ReadingFault
from analysis.numbers import percent, with_uncertainty
from analysis.segmentation.cycles import TOLERANCE_KPA, Excursion, disagreements_with_marks, find_cycles
from analysis.segmentation.influence import ChannelInfluence
from analysis.segmentation.losses import LossCounter
from analysis.segmentation.plateaus import find_plateaus, shorter_settling_s
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray
from protocol.base.units import as_text
from protocol.recording.missing import missing_of

if TYPE_CHECKING:
    from analysis.calibration.fit import Calibration
    from analysis.figures.sensor_analysis import SegmentedRun, SensorAnalysis

NOISY_SHARE = 0.01  # of the span of the pressure: above it the pressure is smoothed, and holds and bins lose their ends
OVERSTATED = 0.999  # p of the test of a curve: above it the errors of reading are smaller than stated
MOST_ALIKE = 5  # warnings with one reason; more are one with their count
MOST_OF_AN_IMPORT = 5  # warnings; the preview lists them all
BREAK_CODES = {
    "same": WarningCode.BREAK,
    "differs": WarningCode.DIFFERS_OVER_BREAK,
    "untested": WarningCode.UNTESTED_BREAK,
}


def run_warnings(
    run: SegmentedRun, sensors: Sequence[SensorAnalysis], checked: Sequence[CheckedReading] = ()
) -> tuple[Warning, ...]:
    """Return the warnings of a run, those of its sensors last."""
    of_run = tuple(Warning(code, "", text) for code, text in (*_run_texts(run), *_reading_texts(checked)))
    return of_run + tuple(warning for sensor in sensors for warning in _sensor_warnings(sensor, run))


def _run_texts(run: SegmentedRun) -> Iterator[tuple[WarningCode, str]]:
    recording, cycles, meta = run.recording, run.cycles, run.recording.meta
    if recording.simulated:
        yield WarningCode.SIMULATED, "recorded from the virtual board: SIMULATED"
    if recording.gaps:
        yield (
            WarningCode.GAPS,
            f"{recording.lost} samples lost in {len(recording.gaps)} gap{'s' * (len(recording.gaps) > 1)}",
        )
    imported = [*meta.get("import_notes", ()), *meta.get("import_issues", ())]
    for text in imported[:MOST_OF_AN_IMPORT]:
        yield WarningCode.IMPORT, str(text)
    if len(imported) > MOST_OF_AN_IMPORT:
        yield WarningCode.IMPORT, f"and {len(imported) - MOST_OF_AN_IMPORT} more: see the preview of the import"
    if meta.get("crc_errors"):
        yield WarningCode.CRC_ERRORS, f"{meta['crc_errors']} frames failed their CRC; their samples count as lost"
    for name, count in recording.masked.items():
        if count:
            yield WarningCode(name), f"{count} samples left out: {name.replace('_', ' ')}"
    if meta.get("damaged_blocks"):
        yield WarningCode.DAMAGED, f"{meta['damaged_blocks']} blocks of the file are damaged and left out"
    for text in missing_of(meta).lines():
        yield WarningCode.DAMAGED, text
    if cycles.noise_kpa > NOISY_SHARE * cycles.span_kpa > 0 and not cycles.void:
        on_loops = "full scale is underestimated and hysteresis overestimated by more than their intervals"
        effect = "plateaus are uncertain" if run.plateaus else on_loops
        share = cycles.noise_kpa / cycles.span_kpa
        yield (
            WarningCode.NOISY_PRESSURE,
            f"the pressure noise of {cycles.noise_kpa:.2g} kPa is {percent(share, 1)} of the pressure span: {effect}",
        )
    if cycles.void:
        yield WarningCode.NOT_DRIVEN, cycles.void
    if not cycles.used:
        yield WarningCode.NO_CYCLE, f"no complete cycle, {cycles.as_json()['partial']} partial"
    if lost := _lost_plateaus_text(run):
        yield WarningCode.TOLERANCE_TOO_WIDE, lost
    if text := _grid_text(run):
        yield WarningCode.READING_GRID, text
    for found in run.breaks:
        yield BREAK_CODES[found.verdict], found.sentence
    for part in cycles.partial:
        yield WarningCode.PARTIAL_CYCLE, part.reason
    for cycle in cycles.complete:
        if cycle.left_out:
            yield WarningCode.CYCLE_LEFT_OUT, f"cycle {cycle.number}: {cycle.left_out}"
    if cycles.excursions:
        yield WarningCode.EXCURSION_LEFT_OUT, _excursions_text(cycles.excursions, recording.time_s)
    if settling_s := shorter_settling_s(run.plateaus, run.options.plateau):
        now_s = run.options.plateau.settling_s
        text = f"most holds are shorter than the settling time of {now_s:g} s: state one of {settling_s:g} s"
        yield WarningCode.SHORT_HOLDS, text
    for text in merged(run.loops.void):
        yield WarningCode.VOID, text
    for text in disagreements_with_marks(cycles, recording):
        yield WarningCode.MARKS_DISAGREE, text


def merged(texts: Sequence[str]) -> Iterator[str]:
    """Yield texts "where: why"; more than a few with one reason are one with their count."""
    where: dict[str, list[str]] = {}
    for text in texts:
        place, _, why = text.partition(": ")
        where.setdefault(re.sub(r"[0-9.]+", "#", why), []).append(text)
    for alike in where.values():
        if len(alike) <= MOST_ALIKE:
            yield from alike
            continue
        place, _, why = alike[0].partition(": ")
        yield f"{place} and {len(alike) - 1} more: {why}"


def _reading_texts(checked: Sequence[CheckedReading]) -> Iterator[tuple[WarningCode, str]]:
    """Yield the readings to be checked, and those that were confirmed with the reason."""
    for one in checked:
        if one.confirmed:
            yield WarningCode.READING_CONFIRMED, f"the reading {one.text}, is confirmed: {one.confirmed}"
        else:
            code = WarningCode.OUTLIER if one.fault is ReadingFault.OFF else WarningCode.HIGH_LEVERAGE
            yield code, f"check the reading {one.text} ({one.of_sensors})"


def reading_grid(run: SegmentedRun) -> dict[str, float | str | None] | None:
    """Return `reading_grid` of `analyze --json`: the grid that is used, their steps, what was stated; None unread."""
    found, option = run.elongations, run.options.x_resolution_mm
    if found is None:
        return None
    origin = "stated" if option is not None else "steps" if found.resolution_mm == found.steps_mm else "image"
    used = found.resolution_mm if option is None else option
    stated = found.stated_mm if option is None else option
    return {"mm": used, "steps_mm": found.steps_mm, "stated_mm": stated, "from": origin}


def _grid_text(run: SegmentedRun) -> str:
    """Return how the readings' own steps contradict the grid that was stated, and which one is used; else ""."""
    grid = reading_grid(run)
    steps, stated = (float(grid[key] or np.nan) for key in ("steps_mm", "stated_mm")) if grid else (np.nan, np.nan)
    if grid is None or grid["from"] == "image" or not abs(steps - stated) > 1e-6 * stated:
        return ""
    side = "finer" if steps < stated else "coarser"
    text = f"the readings are in steps of {steps:g} mm, {side} than the stated grid of {stated:g} mm"
    if grid["from"] == "steps":
        return f"{text}: their steps are taken"
    return f"{text}: {'U may be too wide' if steps < stated else 'U is too small'}"


def _lost_plateaus_text(run: SegmentedRun) -> str:
    """Return which plateaus a tolerance wider than the usual one joins with their neighbours, or ""."""
    settings = run.options.plateau
    if settings.tolerance_kpa <= TOLERANCE_KPA:
        return ""
    usual = find_plateaus(run.recording, find_cycles(run.recording), replace(settings, tolerance_kpa=TOLERANCE_KPA))
    steps_kpa = np.abs(np.diff([plateau.pressure_kpa for plateau in usual]))
    steps_kpa = steps_kpa[steps_kpa <= 2.0 * settings.tolerance_kpa + 0.5 * TOLERANCE_KPA]
    lost = len(usual) - len(run.plateaus)
    if lost <= 0 or not steps_kpa.size:
        return ""
    return (
        f"{lost} of {len(usual)} plateaus are not found: the tolerance of {settings.tolerance_kpa:g} kPa is half of a "
        f"step of {np.median(steps_kpa):.2g} kPa or more; give one well below that half"
    )


def _excursions_text(excursions: Sequence[Excursion], time_s: FloatArray) -> str:
    """Return one text for all reversals that make no cycle: their count, and the widest of them."""
    widest = max(excursions, key=lambda e: e.high_kpa - e.low_kpa)
    where = f"{widest.low_kpa:+z.1f} to {widest.high_kpa:+z.1f} kPa at {time_s[widest.first]:.1f} s"
    if len(excursions) == 1:
        return f"a reversal from {where} is {widest.reason}"
    return f"{len(excursions)} reversals are {widest.reason}, the widest from {where}"


def _sensor_warnings(sensor: SensorAnalysis, run: SegmentedRun) -> list[Warning]:
    """Return the warnings of one sensor: its signal, its figures, its calibration."""
    found = [*_signal_texts(run, run.recording.sensor_names.index(sensor.name)), *_figure_texts(sensor)]
    fso = sensor.figures["fso_mv"].value
    if fso > 0 and abs(sensor.drift_mv) > NOTICED_PERCENT / 100.0 * fso:
        share = percent(abs(sensor.drift_mv) / fso, 2)
        found.append(
            (WarningCode.DRIFT, f"the signal drifts by {share} of the full scale: U is for readings of this run")
        )
    if text := _settling_text(sensor):
        found.append((WarningCode.NOT_SETTLED, text))
    found += [(WarningCode.INFLUENCE, influence_text(each)) for each in sensor.influences if each.matters]
    if sensor.calibration is None and run.plateaus:
        found.append((WarningCode.NO_CALIBRATION, sensor.calibration_void))
    warnings = [Warning(code, sensor.name, text) for code, text in found]
    return [*warnings, *(replace(w, subject=sensor.name) for w in _calibration_warnings(sensor, run))]


def _signal_texts(run: SegmentedRun, sensor: int) -> Iterator[tuple[WarningCode, str]]:
    signal = run.recording.signal_mv[:, sensor]
    signal = signal[np.isfinite(signal)]
    if signal.size > 1 and signal.min() == signal.max():
        text = f"the signal is constant, {signal[0]:.6g} mV in all {signal.size} samples: the sensor measured nothing"
        yield WarningCode.CONSTANT_SIGNAL, text
    standing = LossCounter.of(run.recording, sensor).of_windows([slice(0, run.recording.n)]).standing
    if standing:
        share = percent(standing / run.recording.n, 1)
        yield (
            WarningCode.FLAT,
            f"{standing} samples ({share}) are clipped, frozen or dropped out without a mark of the board: left out",
        )


def influence_text(found: ChannelInfluence) -> str:
    """Return what a channel explains of a signal as a sentence."""
    unit = as_text(found.unit) or "unit"
    slope = with_uncertainty(found.coefficient_mv, found.expanded_mv)
    verb = "follows" if found.significant else "does not measurably follow"
    text = f"the signal {verb} {found.name}: {slope} mV/{unit} (95 %)"
    if np.isfinite(found.effect_percent_fso):
        span = f"{found.low:.4g} to {found.high:.4g} {as_text(found.unit)}".rstrip()
        text += f", {found.effect_percent_fso:.1f} % FSO over {span}"
    return f"{text}; it changed steadily with time, so this may be drift" if found.like_drift else text


def _settling_text(sensor: SensorAnalysis) -> str:
    """Return what holds that are not settled mean for the figures, or ""; less than can be noticed is in them alone."""
    settling, fso = sensor.settling, sensor.figures["fso_mv"].value
    share = settling.most_mv / fso if fso > 0 else float("nan")
    if settling.settled or share < NOTICED_PERCENT / 100.0:
        return ""
    return (
        f"the holds are not settled: after {settling.held_s:.2g} s the signal is still to move by up to "
        f"{percent(share, 2)} of the full scale; figures are at {settling.held_s:.2g} s, and their intervals hold "
        "those at rest; hold longer"
    )


def _figure_texts(sensor: SensorAnalysis) -> Iterator[tuple[WarningCode, str]]:
    if sensor.figures["snr_db"].reason is Reason.FULL_SCALE_IS_NOISE:
        yield WarningCode.NO_SPAN, sensor.figures["snr_db"].note
    for name, abscissa in (("sensor", "elongation"), ("system", "pressure")):
        figure = sensor.figures.get(f"{name}_hysteresis_percent_fso")
        if figure is not None and figure.reason is Reason.UPPER_BOUND:
            yield WarningCode.HYSTERESIS_IS_A_BOUND, f"hysteresis over {abscissa} is {figure.note}"
        elif figure is not None and figure.reason is Reason.WIDER_THAN_FULL_SCALE:
            yield WarningCode.NO_SPAN, f"hysteresis over {abscissa}: {figure.note}"
        elif figure is not None and figure.reason is Reason.PART_OF_RANGE:
            yield WarningCode.HYSTERESIS_IN_PART, f"hysteresis over {abscissa}: {figure.note}"


def _adequacy_warnings(adequacy: Adequacy) -> Iterator[Warning]:
    if adequacy.verdict is CurveVerdict.DOUBTFUL:
        yield Warning(WarningCode.DOUBTFUL_CURVE, "", f"doubtful: {adequacy.sentence}")
    if adequacy.verdict is CurveVerdict.INADEQUATE:
        text = f"inadequate: {adequacy.sentence}; choose the curve by cross-validation (degree auto)"
        yield Warning(WarningCode.INADEQUATE_CURVE, "", text)
    if adequacy.refused:
        yield Warning(
            WarningCode.REFUSED_CURVE,
            "",
            f"the remainder of {adequacy.remainder_percent:.1f} % FSO is above {REFUSED_PERCENT:g} %: "
            "the curve gives no elongation",
        )


def _mostly_reading(calibration: Calibration) -> bool:
    """Return whether the reading makes most of what positions are known to be off by: cycles that differ do too."""
    joint = calibration.joint
    if joint is None:
        return calibration.reading is not None
    return bool(np.mean(joint.slope_at**2 * joint.means.x_variance) > 0.5 * np.mean(joint.known_variance))


def _calibration_warnings(sensor: SensorAnalysis, run: SegmentedRun) -> Iterator[Warning]:
    calibration, posterior = sensor.calibration, sensor.posterior
    if calibration is None:
        return
    if not calibration.monotone:
        turns = ", ".join(f"{turn:.2f}" for turn in calibration.turns_inside)
        where = f"turns at {turns} mm" if turns else "is flat"
        yield Warning(WarningCode.NOT_MONOTONE, "", f"the curve {where}: it has no inverse")
    yield from calibration_warnings(calibration, ("mm", "mV"), points=False)
    if calibration.adequacy is not None:
        yield from _adequacy_warnings(calibration.adequacy)
    if posterior is None and run.options.mcmc and calibration.spline is None:
        yield Warning(WarningCode.NO_POSTERIOR, "", sensor.calibration_void)
    if posterior is not None:
        yield from posterior.warnings
    low, high = calibration.x_range
    less = run.reading_sd_mm * calibration.full_scale / (high - low) > 2.0 * calibration.residual_sd
    p = calibration.adequacy.p_value if calibration.adequacy is not None else float("nan")
    if less or (p > OVERSTATED and _mostly_reading(calibration)):
        chance = f" (p = {p:.3f})" if p > OVERSTATED else ""
        yield Warning(
            WarningCode.READING_ERROR_OVERSTATED,
            "",
            f"the readings scatter less than a reading error of {run.reading_sd_mm:.2g} mm{chance}: "
            "posterior and uncertainty are too wide; give --x-resolution",
        )
