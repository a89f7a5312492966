"""Uncertainty budgets after the GUM (JCGM 100:2008).

A budget is a list of components, each a standard uncertainty with a sensitivity and degrees of freedom, combined by the
law of propagation (GUM 5.1.2, 5.2.2), the effective degrees of freedom by Welch-Satterthwaite (G.4.1). Nothing is
counted twice: what one component holds is taken out of the next. A component that could not be assessed has no value
and is not zero. The expanded uncertainty uses k = 2, with a statement of its traceability
(`analysis.calibration.type_b`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import stats

from analysis.calibration.adequacy import expanded
from analysis.calibration.compare import between_calibrations_mm
from analysis.calibration.curve_choice import CURVES, CurveCandidate, degree_of
from analysis.calibration.fit import Calibration
from analysis.calibration.inverse import raise_without_inverse
from analysis.calibration.type_b import (
    ONE_CYCLE,
    STAND_INS,
    Traceability,
    TypeBContribution,
    counted,
    not_assessed,
    stand_in_text,
    traceability,
)
from analysis.figures.figure import Figure
from analysis.figures.noise_figures import noise_course
from analysis.figures.sensor_analysis import AnalysedRun, with_curve
from analysis.json_object import json_object
from analysis.numbers import percent
from analysis.segmentation.cycle_effect import CycleEffect
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, DataError
from protocol.base.units import COVERAGE_FACTOR

NOT_READ = "no elongation was read"
_CURVE_POINTS = 41
_STATED = ", stated"  # behind the name of a stand-in
KNOWN_COURSE = 4.0
"""Times the square of the error of a loop's width: below it the mean square of the loop tells nothing of its course."""


@dataclass(frozen=True, slots=True)
class Component:
    """One line of a budget; `sensitivity` turns `u`, NaN if not assessed, into the unit of the result."""

    name: str
    u: float
    sensitivity: float = 1.0
    dof: float = float("inf")
    source: str = ""

    @property
    def assessed(self) -> bool:
        return bool(np.isfinite(self.u))

    @property
    def contribution(self) -> float:
        """|c| u, in the unit of the result; NaN where it was not assessed."""
        return abs(self.sensitivity) * self.u


@dataclass(frozen=True, slots=True)
class Budget:
    """A combined budget. `u` standard, `expanded` with k = 2, `dof` effective; `traceability` of an elongation.

    `void` says which component that U rests on was not assessed: U is then not known, and NaN.
    """

    components: tuple[Component, ...]
    u: float
    dof: float
    traceability: Traceability | None = None
    void: str = ""

    @property
    def expanded(self) -> float:
        return COVERAGE_FACTOR * self.u

    @property
    def stand_in(self) -> bool:
        """Whether U rests on a stated stand-in for what the run did not show."""
        return any(c.assessed and c.name.endswith(_STATED) for c in self.components)

    @property
    def coverage(self) -> float:
        """Level of confidence of U: about 0.95 with many effective degrees of freedom, less with few (GUM G.6.4)."""
        inside = stats.norm.cdf(COVERAGE_FACTOR) if np.isinf(self.dof) else stats.t.cdf(COVERAGE_FACTOR, self.dof)
        return float(2.0 * inside - 1.0)

    def shares(self) -> dict[str, float]:
        """Return the share of each assessed component in the variance, largest first; they add up to 1."""
        assessed = [c for c in self.components if c.assessed]
        total = sum(c.contribution**2 for c in assessed)
        ordered = sorted(assessed, key=lambda c: -c.contribution)
        return {c.name: (c.contribution**2 / total if total > 0 else 0.0) for c in ordered}

    def what_halves_it(self) -> str:
        """Return which single component halves the uncertainty when removed, or that none does."""
        if self.void:
            return ""
        shares = self.shares()
        name, share = next(iter(shares.items()))
        if share >= 0.75:
            return f"without {name} ({percent(share)} of the variance) the uncertainty would be half or less"
        largest = f"the largest, {name}, is {percent(share)} of the variance"
        return f"no component halves the uncertainty alone: {largest}, 75 % would be needed"

    def as_json(self) -> dict[str, Any]:
        shares = self.shares()
        line = ("name", "assessed", "u_mm=contribution", "dof")
        lines = [json_object(c, *line) | {"share": shares.get(c.name), "source": c.source} for c in self.components]
        traced = self.traceability
        return {
            "components": lines,
            **json_object(self, "standard_uncertainty_mm=u", "expanded_uncertainty_mm=expanded"),
            "void": self.void,
            "stand_in": self.stand_in,
            "coverage_factor": COVERAGE_FACTOR,
            "effective_dof": self.dof,
            "what_halves_it": self.what_halves_it(),
            "traceable": None if traced is None else traced.traceable,
            "traceability": "" if traced is None else traced.text,
        }


def combine(components: Sequence[Component], traced: Traceability | None = None) -> Budget:
    """Combine uncorrelated components (GUM 5.1.2, G.4.1); those that were not assessed are listed only."""
    assessed = [c for c in components if c.assessed]
    u = float(np.sqrt(sum(c.contribution**2 for c in assessed)))
    small = sum(c.contribution**4 / c.dof for c in assessed)
    return Budget(tuple(components), u, u**4 / small if small > 0 else float("inf"), traced)


@dataclass(frozen=True, slots=True)
class SignalParts:
    """Standard uncertainties of a signal, mV, each without the others; `half_loop` at equally spaced x.

    `course` is that of the noise at equally spaced x, relative to its rms, ones where it is the same everywhere.

    What was not assessed is NaN, and `void` says why U is then not known; `missing` names it, `stand_in` says what is
    stated instead. A drift that two cycles cannot show is NaN
    too: what they differ by is in the repeatability.
    """

    noise: float
    resolution: float
    ambient: float
    repeatability: float
    drift: float
    half_loop: FloatArray
    noise_dof: float
    repeatability_dof: float
    void: str = ""
    one_cycle: bool = False  # whether that is the reason in `void`
    settling: float = 0.0
    course: FloatArray = field(default_factory=lambda: np.ones(1))
    missing: tuple[str, ...] = ()
    stand_in: str = ""

    @property
    def independent(self) -> float:
        """What differs from sample to sample, its rms over the range."""
        return float(np.sqrt(self.noise**2 + self.resolution**2 + self.ambient**2))

    @property
    def independent_over_x(self) -> float | list[float] | None:
        """The same at equally spaced x where the noise changes over them; None where it was not assessed."""
        if not np.isfinite(self.independent):
            return None
        if not np.ptp(self.course) > 0.0:
            return self.independent
        over_x: list[float] = np.sqrt((self.noise * self.course) ** 2 + self.resolution**2 + self.ambient**2).tolist()
        return over_x

    def noise_at(self, share: float) -> float:
        """Return the noise at a share of the range."""
        return self.noise * float(np.interp(share, np.linspace(0.0, 1.0, self.course.size), self.course))

    @property
    def between_cycles(self) -> float:
        """What differs from cycle to cycle, and from the dwell to rest."""
        drift = self.drift if np.isfinite(self.drift) else 0.0
        return float(np.sqrt(self.repeatability**2 + drift**2 + self.settling**2))  # NaN where not assessed

    @property
    def shared(self) -> float:
        """What the curve leaves out, the loop by its rms."""
        return float(np.sqrt(self.between_cycles**2 + np.mean(self.half_loop**2)))


def signal_parts(analysis: AnalysedRun, sensor: int) -> SignalParts:
    """Assess the components of one sensor's signal from the run itself."""
    figures = analysis.sensors[sensor].figures
    fso = figures["fso_mv"].value
    cycles = analysis.loops.n_cycles
    noise, pooled = figures["noise_mv"].value, figures["repeatability_percent_fso"].value
    resolution = _resolution(analysis)
    ambient = _ambient(analysis, sensor)
    per_cycle = figures["drift_percent_fso_per_100_cycles"].value * fso / 1e4
    drift = abs(per_cycle) * cycles / np.sqrt(12.0)  # a ramp over the run, seen at any time of it
    ramp = float(drift) if np.isfinite(drift) else 0.0  # not told from the repeatability, which then holds it
    mean_noise = np.nanmedian([p.signal_se_mv[sensor] for p in analysis.plateaus]) if analysis.plateaus else 0.0
    repeatability = _without(pooled * fso / 100.0, ramp, float(mean_noise))
    half_loop, no_loop = _half_loop(analysis, sensor)
    noiseless = "" if np.isfinite(noise) else figures["noise_mv"].void or "the noise is not known"
    missing = {"repeatability": _unrepeated(figures, cycles), "noise": noiseless, "hysteresis": no_loop}
    missing = {name: why for name, why in missing.items() if why}
    given = {one.name for one in counted(analysis.options.type_b, missing)}
    unknown = next((name for name in missing if name not in given), "")
    together = CycleEffect.of(analysis.loops, sensor)
    return SignalParts(
        noise=_without(noise, resolution, ambient),
        resolution=resolution,
        ambient=ambient,
        repeatability=together.repeatability(repeatability, ramp),
        drift=float(drift),
        settling=analysis.sensors[sensor].settling.u_mv,
        course=_noise_course(analysis, sensor),
        half_loop=half_loop,
        noise_dof=float(max(analysis.recording.n // 10, 1)),
        repeatability_dof=together.dof(repeatability, ramp),
        void=missing.get(unknown, ""),
        one_cycle=unknown == "repeatability" and cycles == 1,
        missing=tuple(missing),
        stand_in=stand_in_text(analysis.options.type_b, missing),
    )


def _unrepeated(figures: Mapping[str, Figure], cycles: int) -> str:
    """Return why the repeatability was not assessed; "" where it was."""
    figure = figures["repeatability_percent_fso"]
    return ONE_CYCLE if cycles == 1 else "" if np.isfinite(figure.value) else figure.void


def elongation_budget(analysis: AnalysedRun, x_mm: float, *, runs: Sequence[AnalysedRun] = ()) -> tuple[Budget, ...]:
    """Return the budget of one reading of elongation at `x_mm`, for each sensor.

    `runs` are calibrations of the same unit, this one among them; two or more give the reproducibility. Raises
    DataError if a sensor is not calibrated or its curve has no inverse, RequestError as `between_calibrations_mm`.
    """
    of_sensors = [BudgetOfSensor.of(analysis, i, runs) for i in range(len(analysis.sensors))]
    for of_sensor in of_sensors:
        raise_without_inverse(of_sensor.calibration)
    return tuple(of_sensor.at(x_mm) for of_sensor in of_sensors)


def elongation_uncertainty(analysis: AnalysedRun, sensor: int) -> tuple[FloatArray, str]:
    """Return x and U (mm) over the calibrated range, [points, 2], and why U is not given everywhere in it.

    A curve that turns inside its range gives U on either side of the turn; nearer to it than U the side is not known,
    and U is NaN. No points if the curve gives no elongation at all, or a component of U was not assessed.
    """
    try:
        of_sensor = BudgetOfSensor.of(analysis, sensor)
        raise_without_inverse(of_sensor.calibration, by_parts=True)
    except BoatDaqError as error:
        return np.empty((0, 2)), error.cause
    if of_sensor.parts.void:
        return np.empty((0, 2)), of_sensor.parts.void
    calibration, stand_in = of_sensor.calibration, of_sensor.parts.stand_in
    x, turns = np.linspace(*calibration.x_range, _CURVE_POINTS), np.asarray(calibration.turns_inside)
    level = calibration.slope(x) == 0.0
    u = np.asarray([np.nan if flat else of_sensor.at(float(at)).expanded for at, flat in zip(x, level, strict=True)])
    if not turns.size:
        return np.column_stack([x, u]), stand_in
    u[np.abs(x[:, None] - turns).min(axis=1) <= u] = np.nan
    where = ", ".join(f"{turn:.3g}" for turn in turns)
    reason = f"the curve turns at {where} mm: U is for a reading whose side is known, and not given within U of a turn"
    return (np.column_stack([x, u]) if np.isfinite(u).any() else np.empty((0, 2))), reason


@dataclass(frozen=True, slots=True)
class ElongationBudgets:
    """The budgets of an elongation of `x_mm`, one a sensor; none where `void` gives the reason."""

    x_mm: float
    budgets: tuple[Budget, ...]
    void: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return `elongation_budget` of `analyze --json`."""
        return json_object(self, "x_mm", "sensors=budgets", "void")


def middle_budgets(analysis: AnalysedRun, runs: Sequence[AnalysedRun] = ()) -> ElongationBudgets | None:
    """Return the budgets in the middle of the range, with `runs` as `elongation_budget`; None if not calibrated."""
    ranges = [sensor.calibration.x_range for sensor in analysis.sensors if sensor.calibration is not None]
    if not ranges:
        return None
    x_mm = sum(ranges[0]) / 2
    try:
        return ElongationBudgets(x_mm, elongation_budget(analysis, x_mm, runs=runs))
    except BoatDaqError as error:
        return ElongationBudgets(x_mm, (), error.cause)


def curve_candidates_of(analysis: AnalysedRun, sensor: int, x_mm: float) -> tuple[CurveCandidate, ...]:
    """Return verdict, error of prediction, and U of an elongation at `x_mm` of each curve that a sensor could have."""
    if analysis.sensors[sensor].calibration is None:
        return ()
    return tuple(_candidate(analysis, sensor, name, x_mm) for name in CURVES)


def _candidate(analysis: AnalysedRun, sensor: int, name: str, x_mm: float) -> CurveCandidate:
    found = CurveCandidate(name)
    try:
        of_sensor = BudgetOfSensor.of(with_curve(analysis, sensor, degree_of(name)), sensor)
        adequacy = of_sensor.calibration.adequacy
        if adequacy is not None:
            own = next(one for one in adequacy.candidates if one.fit is adequacy.chosen)
            found = CurveCandidate(name, str(adequacy.verdict), adequacy.sentence, own.prediction_rms)
        raise_without_inverse(of_sensor.calibration)
        return replace(found, expanded_mm=of_sensor.at(x_mm).expanded)
    except BoatDaqError as error:
        return replace(found, void=error.cause)


@dataclass(frozen=True, slots=True)
class BudgetOfSensor:
    """The budgets of one sensor at any x: what they share is assessed once."""

    calibration: Calibration
    type_b: tuple[TypeBContribution, ...]
    parts: SignalParts
    calibrations: tuple[Calibration, ...]
    cycles: int
    counted: bool

    @classmethod
    def of(cls, analysis: AnalysedRun, sensor: int, runs: Sequence[AnalysedRun] = ()) -> BudgetOfSensor:
        """Prepare the budgets of a sensor, with `runs` as `elongation_budget`; DataError if it is not calibrated."""
        found = [run.sensors[sensor].calibration for run in runs if sensor < len(run.sensors)]
        calibrations = tuple(c for c in found if c is not None) if len(runs) > 1 else ()
        counted = analysis.recording.lit is not None
        calibration, parts = _calibration(analysis, sensor), signal_parts(analysis, sensor)
        return cls(calibration, analysis.options.type_b, parts, calibrations, analysis.loops.n_cycles, counted)

    def at(self, x_mm: float) -> Budget:
        """Return the budget of an elongation of `x_mm`."""
        calibration, parts = self.calibration, self.parts
        per_mv = 1.0 / abs(float(calibration.slope(x_mm)))
        low, high = calibration.x_range
        share = (x_mm - low) / (high - low)
        cycles, no_counts = f"{self.cycles} cycles", "not assessed: the recording has no counts"
        of_counts = (parts.resolution, parts.ambient) if self.counted else (float("nan"), float("nan"))
        between = Component("reproducibility", float("nan"), source="not assessed: one run")
        if self.calibrations:
            between_mm, dof = between_calibrations_mm(self.calibrations, x_mm)
            between = Component(
                "reproducibility", between_mm, dof=float(dof), source=f"between {dof + 1} runs, less fit"
            )
        by_fit, by_reading = (float(part) for part in calibration.curve_parts(x_mm))
        fit_dof = calibration.joint.effective_dof if calibration.joint is not None else calibration.dof
        components = [
            Component("reading", by_reading, per_mv, source="grid, the same in every cycle"),
            _of_run("noise", parts.noise_at(share), per_mv, parts.noise_dof, "within plateaus"),
            _of_run("repeatability", parts.repeatability, per_mv, parts.repeatability_dof, cycles),
            between,
            _of_run(
                "zero drift", parts.drift, per_mv, source=f"drift over {cycles}", void="the repeatability holds it"
            ),
            Component("settling", parts.settling, per_mv, source=(
                "what the holds are still to move by" if parts.settling > 0.0 else "the holds are settled"
            )),
            Component("resolution", of_counts[0], per_mv, source="ADC step" if self.counted else no_counts),
            Component("ambient residual", of_counts[1], per_mv,
                      source="signal against dark" if self.counted else no_counts),
            Component("fit", by_fit, per_mv, fit_dof, "covariance"),
        ]  # fmt: skip
        by_deviation = self._by_deviation(x_mm, per_mv, combine(components).u)
        found = combine([*components, *by_deviation, *self._type_b(x_mm)], traceability(self.type_b))
        return replace(found, u=float("nan"), dof=float("nan"), void=parts.void) if parts.void else found

    def _type_b(self, x_mm: float) -> list[Component]:
        """Return the contributions that were stated, and those that are expected and were not."""
        given, missing = self.type_b, self.parts.missing
        stated = [
            Component(_label(one), float(one.u_mm(x_mm)), 1.0, one.dof, one.statement)
            if one in counted(given, missing)
            else Component(_label(one), float("nan"), source="not used: the run shows it")
            for one in given
        ]
        source = "not assessed: not in the file of the unit or rig"
        return [*stated, *(Component(label, float("nan"), source=source) for label in not_assessed(given))]

    def _by_deviation(self, x_mm: float, per_mv: float, u_mm: float) -> tuple[Component, Component]:
        """Return what brings U to its coverage about the branches of the loop, and about a curve that misses.

        Both are deviations that are not corrected (GUM F.2.4.5), the loop's of either sign.
        """
        half_loop = np.nan_to_num(self.parts.half_loop)  # U is void where it was not assessed
        half = per_mv * float(np.interp(x_mm, np.linspace(*self.calibration.x_range, half_loop.size), half_loop))
        with_loop = float(expanded(0.0, u_mm, half_loop=half)) / COVERAGE_FACTOR
        own = _without(with_loop, u_mm) / per_mv if np.isfinite(self.parts.half_loop).all() else float("nan")
        loop = _of_run(
            "hysteresis", own, per_mv, source=f"either branch of the loop, {1000 * half:.0f} µm off the curve"
        )
        adequacy = self.calibration.adequacy
        if adequacy is None:
            return loop, Component("lack of fit", float("nan"), source="not assessed: no positions")
        away = float(adequacy.deviation_in_x(x_mm))
        whole = with_loop if away == 0.0 else float(expanded(away, u_mm, half_loop=half)) / COVERAGE_FACTOR
        miss = _without(whole, with_loop) / per_mv
        source = f"curve {adequacy.verdict}, {1000 * away:.0f} µm off the preferred one"
        return loop, Component("lack of fit", miss, per_mv, source=source)


def _calibration(analysis: AnalysedRun, sensor: int) -> Calibration:
    calibration = analysis.sensors[sensor].calibration
    if calibration is None:
        reason = analysis.sensors[sensor].calibration_void
        raise DataError(f"{analysis.sensors[sensor].name} is not calibrated: {reason}", "Give its elongations.")
    return calibration


def _of_run(
    name: str, u: float, per_mv: float, dof: float = float("inf"), source: str = "",
    void: str = "the run does not show it",
) -> Component:  # fmt: skip
    """Return a component that the run itself shows; where it does not, its source says so."""
    return Component(name, u, per_mv, dof, source if np.isfinite(u) else f"not assessed: {void}")


def _label(one: TypeBContribution) -> str:
    return f"{one.label}{_STATED}" if one.name in STAND_INS else one.label


def _half_loop(analysis: AnalysedRun, sensor: int) -> tuple[FloatArray, str]:
    """Half the distance of the branches, mV, less the reading error of x, or NaN and why; the rms if hardly wider."""
    calibration, width = analysis.sensors[sensor].calibration, analysis.sensors[sensor].sensor_loop
    joint = analysis.sensors[sensor].joint_loop
    if calibration is None:
        return np.full(1, np.nan), "the sensor is not calibrated"
    if width is None or width.void:
        return np.full(
            1, np.nan
        ), f"the loop of the sensor is not known: {width.void if width is not None else NOT_READ}"
    if joint is not None:
        grid = np.linspace(*joint.ends, _CURVE_POINTS)
        squares, by_reading = joint.loop_width(grid) ** 2 / 4.0, joint.loop_width_u(grid) ** 2 / 4.0
    else:
        grid = np.linspace(*calibration.x_range, _CURVE_POINTS)
        squares = np.interp(grid, width.grid, 0.5 * (width.loading - width.unloading)) ** 2
        by_reading = 0.5 * (analysis.reading_sd_mm * calibration.slope(grid)) ** 2  # half a difference of two readings
    own = squares - by_reading
    if not np.mean(squares) > KNOWN_COURSE * np.mean(by_reading):
        own = np.mean(own, keepdims=True)
    return np.asarray(np.sqrt(np.maximum(own, 0.0))), ""


def _noise_course(analysis: AnalysedRun, sensor: int) -> FloatArray:
    calibration, number = analysis.sensors[sensor].calibration, analysis.sensors[sensor].point_plateau
    if calibration is None or not number.size:
        return np.ones(1)
    points = [analysis.plateaus[int(i)] for i in number]
    variance = np.asarray([p.signal_sd_mv[sensor] ** 2 for p in points])
    return noise_course(calibration.x, variance, np.linspace(*calibration.x_range, _CURVE_POINTS))


def _resolution(analysis: AnalysedRun) -> float:
    meta = analysis.recording.meta
    if analysis.recording.lit is None or not meta.get("vref_mv") or not meta.get("adc_bits"):
        return 0.0
    step = float(meta["vref_mv"]) / 2.0 ** int(meta["adc_bits"])
    return float(step * np.sqrt(2.0 / 12.0))  # lit and dark are both rounded


def _ambient(analysis: AnalysedRun, sensor: int) -> float:
    """Return the ambient light left in the signal, mV: the signal's slope on the light, times the light's sd.

    Dark readings are the light plus noise of their own, and that noise is in the signal too (signal = lit - dark). The
    reading one sample later shares the light but not the noise: slope = cov(y_t, d_t+1) / cov(d_t, d_t+1), an
    instrument in the sense of Carroll et al. (2006), 6. Zero if either covariance is not above its own scatter.
    """
    recording = analysis.recording
    if recording.dark is None:
        return 0.0
    products, n = np.zeros(4), 0  # y_t d_t+1, d_t d_t+1, y y, d d
    for p in analysis.plateaus:
        rows = slice(p.settled_first, p.last + 1)
        good = recording.usable[rows, sensor]
        if p.damaged[sensor] or good.sum() < 4:
            continue
        dark, signal = recording.dark[rows, sensor][good].astype(float), recording.signal_mv[rows, sensor][good]
        dark, signal = dark - dark.mean(), signal - signal.mean()
        products += signal[:-1] @ dark[1:], dark[:-1] @ dark[1:], signal @ signal, dark @ dark
        n += int(good.sum())
    if not n or not products.all():
        return 0.0
    with_light, of_light, of_signal, of_dark = products / n
    if abs(of_light) < 3.0 * of_dark / np.sqrt(n) or abs(with_light) < 3.0 * np.sqrt(of_signal * of_dark / n):
        return 0.0
    return float(min(abs(with_light / of_light) * np.sqrt(abs(of_light)), np.sqrt(of_signal)))


def _without(whole: float, *parts: float) -> float:
    return float(np.sqrt(np.maximum(whole**2 - sum(p**2 for p in parts), 0.0)))  # NaN stays NaN
