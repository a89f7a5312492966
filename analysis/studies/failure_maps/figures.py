"""Where the segmentation and the figures of a run break down: runs with a truth, disturbed in one way at a time.

A staircase of pressure moves the elongation along a line with a parabolic loop of known width; the paper's cubic makes
the signal. Full scale, sensitivity and the system's hysteresis then follow from the formula alone. The runs are
analysed as a user would. A staircase is no longer found in its pressure with noise, short holds, lost samples, a loose
wire, small steps; figures lose their meaning without span or noise, or where branches do not overlap.
"""

from __future__ import annotations

import itertools
import tempfile
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from analysis.data.recording import Recording
from analysis.figures.figure import Figure
from analysis.figures.pipeline import Analysis, analyse
from analysis.figures.sensor_analysis import Options
from analysis.studies.failure_maps.fit import SENSOR_NOISE_MV, cubic
from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult, joined
from protocol.base.arrays import BoolArray, FloatArray, IntArray

MIDDLE_KPA, SPAN_KPA, _STEPS = 5.0, 90.0, 9
MM_PER_KPA = 6.5 / SPAN_KPA
LOOP_SHARE = 0.08
"""Half the loop's width in the middle, as a share of the span of x, times 1/2: 4 % of full scale in the signal."""
_EXACT = Options(mcmc=False, x_resolution_mm=0.0)
_EXPECTED = ("simulated", "no_calibration", "hysteresis_is_a_bound")
"""Warnings that do not concern a number's truth: a missing calibration has its own reason, a bound its own note."""


@dataclass(frozen=True)
class Stairs:
    """A staircase from the upper end down and up again, `cycles` times."""

    span_kpa: float = SPAN_KPA
    cycles: int = 2
    dwell_s: float = 2.0
    rate_hz: float = 100.0
    ramp_kpa_per_s: float = 20.0
    pressure_noise_kpa: float = 0.05
    noise_mv: float = SENSOR_NOISE_MV
    scale: float = 1.0  # factor on the signal's swing about its value at rest
    # bulge_percent, bulge_at: the sensor's own loop, % of full scale, widest at this share of the range of x
    bulge_percent: float = 0.0
    bulge_at: float = 0.5
    seed: int = 0

    @cached_property
    def levels_kpa(self) -> FloatArray:
        """Return the levels from the upper end to the lower."""
        return MIDDLE_KPA + self.span_kpa * np.linspace(0.5, -0.5, _STEPS + 1)

    def elongation(self, pressure_kpa: FloatArray, loading: FloatArray) -> FloatArray:
        """Return x of a pressure on the loading (1) or unloading (0) branch, mm."""
        share = (pressure_kpa - self.levels_kpa[-1]) / self.span_kpa
        bow = LOOP_SHARE * share * (1.0 - share) * self.span_kpa * MM_PER_KPA
        return np.asarray(MM_PER_KPA * pressure_kpa + 0.19 + np.where(loading > 0, -bow, bow))

    def signal(self, x: FloatArray) -> FloatArray:
        """Return the signal without noise, mV."""
        return np.asarray(cubic(np.zeros(1))[0] + self.scale * (cubic(x) - cubic(np.zeros(1))[0]))

    def bulge(self, x: FloatArray) -> FloatArray:
        """Return the distance of the branches over x, mV: s^a (1 - s)^b over the share s of the range."""
        a, b = 5.0 * self.bulge_at, 5.0 * (1.0 - self.bulge_at)
        ends = self.elongation(self.levels_kpa[[-1, 0]], np.zeros(2))
        share = np.clip((x - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)
        most = self.bulge_at**a * (1.0 - self.bulge_at) ** b
        full = abs(float(np.diff(self.signal(ends))[0]))
        return np.asarray(self.bulge_percent / 100.0 * full * share**a * (1.0 - share) ** b / most)

    @cached_property
    def holds(self) -> tuple[FloatArray, FloatArray]:
        """Return level and branch (1 loading) of every hold."""
        down, up = self.levels_kpa[1:], self.levels_kpa[-2::-1]
        levels = np.concatenate([self.levels_kpa[:1], *[down, up] * self.cycles])
        branch = np.concatenate([[0.0], *[np.zeros(_STEPS), np.ones(_STEPS)] * self.cycles])
        return levels, branch

    @cached_property
    def trace(self) -> tuple[FloatArray, FloatArray]:
        """Return pressure and branch of every sample."""
        levels, branch = self.holds
        hold = max(1, round(self.dwell_s * self.rate_hz))
        ramp = max(1, round(self.span_kpa / _STEPS / self.ramp_kpa_per_s * self.rate_hz))
        part = np.arange(ramp) / ramp
        pressure = [np.full(hold, levels[0])]
        for before, level in itertools.pairwise(levels):
            pressure += [before + (level - before) * part, np.full(hold, level)]
        return np.concatenate(pressure), np.concatenate([np.zeros(hold), np.repeat(branch[1:], hold + ramp)])

    @cached_property
    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return time (s), measured pressure (kPa) and signal (mV) of every sample."""
        pressure, loading = self.trace
        rng = np.random.default_rng(self.seed)
        x = self.elongation(pressure, loading)
        signal = self.signal(x) + np.where(loading > 0, 0.5, -0.5) * self.bulge(x)
        signal = signal + self.noise_mv * rng.standard_normal(pressure.size)
        measured = pressure + self.pressure_noise_kpa * rng.standard_normal(pressure.size)
        return np.arange(pressure.size) / self.rate_hz, measured, signal

    @property
    def truth(self) -> dict[str, float]:
        """Return full scale (mV), sensitivity (mV/mm) and system hysteresis (% FSO) from the formula."""
        ends = self.elongation(self.levels_kpa[[0, -1]], np.zeros(2))
        full = abs(float(np.diff(self.signal(ends))[0]))
        apart = self.signal(self.elongation(self.levels_kpa, np.ones(_STEPS + 1)))
        apart = apart - self.signal(self.elongation(self.levels_kpa, np.zeros(_STEPS + 1)))
        wide = 100.0 * float(np.abs(apart).max()) / full if full > 0 else float("nan")
        return {
            "fso_mv": full,
            "sensitivity_mv_per_mm": full / abs(float(np.diff(ends)[0])),
            "system_hysteresis_percent_fso": wide,
        }

    def recording(self, kept: IntArray | None = None) -> Recording:
        """Return the run; `kept` are the samples that arrived, all by default."""
        time, pressure, signal = self.columns
        rows = np.arange(time.size) if kept is None else kept
        return Recording.from_arrays(time[rows], pressure[rows], signal[rows], index=rows)


def analysed(run: Stairs, recording: Recording | None = None, *, readings: bool = True) -> Analysis:
    """Analyse a run, with a file of its exact elongations, one row a hold, or without.

    `recording`: the disturbed run; the undisturbed one by default.
    """
    recording = recording or run.recording()
    if not readings:
        return analyse(recording, options=_EXACT)
    levels, branch = run.holds
    rows = zip(levels, run.elongation(levels, branch), strict=True)
    text = "pressure_kpa,elongation_mm\n" + "".join(f"{p:.6f},{x:.9f}\n" for p, x in rows)
    return analysed_with(recording, text)


def analysed_with(recording: Recording, text: str, options: Options = _EXACT) -> Analysis:
    """Analyse a run with the text of a file of elongations."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "elongation.csv")
        file.write_text(text, encoding="ascii")
        return analyse(recording, file, options=options)


def warnings_of(found: Analysis) -> str:
    """Return the analysis' warnings about its own numbers."""
    return joined([warning.sentence for warning in found.warnings if warning.code not in _EXPECTED])


def compared_with_truth(run: Stairs, recording: Recording | None = None, *, readings: bool = True) -> StudyResult:
    """Compare full scale, sensitivity and hysteresis of a disturbed run with the formula: the worst, % FSO."""
    found = analysed(run, recording, readings=readings)
    figures, truth = found.sensors[0].figures, dict(run.truth)
    if not readings:
        truth.pop("sensitivity_mv_per_mm")
    void = [f"{name}: {figures[name].void}" for name in truth if name in figures and figures[name].void]
    void += [f"{name}: {figures[name].note}" for name in truth if name in figures and figures[name].note]
    errors = [off_percent(figures.get(name), name, value) for name, value in truth.items()]
    missed = len(found.cycles.used) != run.cycles
    error = float("inf") if missed and np.isfinite(errors).all() else float(np.max(errors))
    return StudyResult(error, joined([*void, warnings_of(found)]))


def off_percent(figure: Figure | None, name: str, truth: float) -> float:
    """Return the distance of a truth from a figure's stated 95 % interval, or from its value without one, % FSO.

    NaN where there is no figure.
    """
    if figure is None or figure.void:
        return float("nan")
    low, high = (figure.low, figure.high) if np.isfinite(figure.low + figure.high) else (figure.value, figure.value)
    off = max(low - truth, truth - high, 0.0)
    return off if name.endswith("percent_fso") else 100.0 * off / truth


TRUTH = "full scale, sensitivity and hysteresis of the formula that made the run"
_TOLERANCE = 0.5  # % FSO; a tenth of the hysteresis that is measured


def noisy(noise_kpa: float, dwell_s: float, *, readings: bool) -> StudyResult:
    """Analyse white noise on the pressure, holds of a given length."""
    return compared_with_truth(Stairs(pressure_noise_kpa=noise_kpa, dwell_s=dwell_s), readings=readings)


def lost(share_percent: float, length: float) -> StudyResult:
    """Analyse a run with lost samples, `share_percent` of it in holes of `length` samples."""
    run = Stairs()
    rows = np.arange(run.trace[0].size)
    return compared_with_truth(run, run.recording(rows[~_holes(rows.size, share_percent, length)]))


def loose_wire(share_percent: float, length: float) -> StudyResult:
    """Analyse a pressure sensor that reads zero for `length` samples at a time."""
    run = Stairs()
    time, pressure, _ = run.columns
    pressure[_holes(time.size, share_percent, length)] = 0.0
    return compared_with_truth(run)


def small(span_kpa: float, noise_kpa: float) -> StudyResult:
    """Analyse a staircase of ten levels over a small span of pressure."""
    return compared_with_truth(Stairs(span_kpa=span_kpa, pressure_noise_kpa=noise_kpa), readings=False)


def started(first_kpa: float, dwell_s: float) -> StudyResult:
    """Analyse a staircase whose recording begins at `first_kpa`, inside the ramp to its first hold."""
    run = Stairs(dwell_s=dwell_s)
    time, pressure, signal = run.columns
    top_kpa = float(run.levels_kpa[0])
    count = max(round(abs(top_kpa - first_kpa) / run.ramp_kpa_per_s * run.rate_hz), 1)
    ramp_kpa = np.linspace(first_kpa, top_kpa, count, endpoint=False)
    noise = np.random.default_rng(run.seed + 1).standard_normal((2, count))
    ramp_mv = run.signal(run.elongation(ramp_kpa, np.ones(count))) + run.noise_mv * noise[1]
    whole = np.arange(count + time.size)
    pressure = np.concatenate([ramp_kpa + run.pressure_noise_kpa * noise[0], pressure])
    recording = Recording.from_arrays(whole / run.rate_hz, pressure, np.concatenate([ramp_mv, signal]), index=whole)
    return compared_with_truth(run, recording)


def _holes(samples: int, share_percent: float, length: float) -> BoolArray:
    """Mark holes of `length` samples at random places, `share_percent` of all samples, one at least."""
    rng, found = np.random.default_rng(5), np.zeros(samples, dtype=bool)
    count = max(round(share_percent / 100.0 * samples / length), int(share_percent > 0))
    for first in rng.integers(0, samples - int(length), count):
        found[first : first + int(length)] = True
    return found


_NOISE = Axis("noise of the pressure, sd", "kPa", (0.0, 0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0))
_DWELL = Axis("length of a hold", "s", (0.1, 0.2, 0.3, 0.5, 0.8, 1.0, 1.5, 2.0, 5.0))
_HOLES = Axis("samples in a hole", "", (1.0, 3.0, 10.0, 30.0, 100.0, 300.0))


FULL_MV = 255.5
_BULGE_PERCENT = 5.0


def snr(span_mv: float, noise_mv: float) -> StudyResult:
    """Return the signal-to-noise ratio of a staircase whose signal spans `span_mv`, dB off its stated interval."""
    run = Stairs(scale=span_mv / FULL_MV, noise_mv=noise_mv)
    found = analysed(run)
    figure = found.sensors[0].figures["snr_db"]
    with np.errstate(divide="ignore", invalid="ignore"):
        truth = float(20.0 * np.log10(np.float64(run.truth["fso_mv"]) / noise_mv))
    message = joined([figure.void, figure.note, warnings_of(found)])
    if np.isnan(figure.value) or (np.isinf(figure.value) and figure.void):
        return StudyResult(float("nan"), message)
    low, high = (figure.low, figure.high) if np.isfinite(figure.low + figure.high) else (figure.value, figure.value)
    return StudyResult(max(low - truth, truth - high, 0.0), message)


def overlap(read_percent: float, bulge_at: float) -> StudyResult:
    """Return the sensor's loop over x where only the first part of each branch was read."""
    run = Stairs(bulge_percent=_BULGE_PERCENT, bulge_at=bulge_at)
    kept = round(read_percent / 100.0 * _STEPS)
    levels, branch = run.holds
    text = "cycle,branch,pressure_kpa,elongation_mm\n"
    for hold, (p, up, x) in enumerate(zip(levels, branch, run.elongation(levels, branch), strict=True)):
        cycle, step = divmod(hold - 1, 2 * _STEPS)
        if hold == 0:
            text += f"1,start,{p:.6f},{x:.9f}\n"
        elif step % _STEPS < kept:
            text += f"{cycle + 1},{'loading' if up else 'unloading'},{p:.6f},{x:.9f}\n"
    found = analysed_with(run.recording(), text)
    figure = found.sensors[0].figures["sensor_hysteresis_percent_fso"]
    truth = _BULGE_PERCENT * run.truth["fso_mv"] / found.sensors[0].figures["fso_mv"].value
    message = joined([figure.void, figure.note, warnings_of(found)])
    return StudyResult(off_percent(figure, "percent_fso", truth), message)


FIGURE_STUDIES = (
    Study(
        "segmentation-noise", "segmentation", "Noise and short holds, with readings", TRUTH, "% FSO", _TOLERANCE,
        _NOISE, _DWELL, partial(noisy, readings=True),
    ),
    Study(
        "segmentation-alone", "segmentation", "Noise and short holds, no readings", TRUTH, "% FSO", _TOLERANCE,
        _NOISE, _DWELL, partial(noisy, readings=False),
    ),
    Study(
        "segmentation-lost", "segmentation", "Lost samples", TRUTH, "% FSO", _TOLERANCE,
        Axis("samples lost", "%", (0.0, 0.1, 1.0, 5.0, 10.0, 20.0, 40.0, 70.0)), _HOLES, lost,
    ),
    Study(
        "segmentation-wire", "segmentation", "A loose wire: pressure reads zero", TRUTH, "% FSO", _TOLERANCE,
        Axis("samples at zero", "%", (0.0, 0.1, 1.0, 3.0, 5.0, 10.0, 20.0, 40.0)), _HOLES, loose_wire,
    ),
    Study(
        "segmentation-small", "segmentation", "Small steps of pressure, no readings", TRUTH, "% FSO", 1.0,
        Axis("span of ten levels", "kPa", (90.0, 60.0, 40.0, 30.0, 20.0, 15.0, 10.0, 5.0, 2.0, 1.0, 0.5)),
        Axis("noise of the pressure, sd", "kPa", (0.0, 0.05, 0.2, 0.5, 1.0, 2.0)), small,
    ),
    Study(
        "segmentation-start", "segmentation", "A recording that begins inside a ramp", TRUTH, "% FSO", _TOLERANCE,
        Axis("pressure of the first sample", "kPa", (49.0, 40.0, 20.0, 8.0, 5.0, 2.0, 0.0, -5.0, -20.0, -35.0, -39.0)),
        Axis("length of a hold", "s", (0.3, 0.5, 0.8, 1.0, 2.0, 5.0)), started,
    ),
    Study(
        "figures-snr", "figures", "Signal-to-noise ratio: no span, no noise",
        "20 log10 of the span over the noise put in", "dB", 1.0,
        Axis("span of the signal", "mV", (0.0, 1e-9, 1e-3, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 255.0)),
        Axis("noise, sd", "mV", (0.0, 1e-9, 1e-3, 0.1, 1.49, 10.0, 100.0, 1000.0)), snr,
    ),
    Study(
        "figures-overlap", "figures", "Hysteresis: branches that were read in part", "the width of the loop put in",
        "% FSO", 0.5, Axis("part of each branch that was read", "%", (100.0, 89.0, 78.0, 67.0, 56.0, 44.0, 33.0)),
        Axis("the loop is widest at", "of the range", (0.1, 0.3, 0.5, 0.7, 0.9)), overlap,
    ),
)  # fmt: skip
