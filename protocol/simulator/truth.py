"""True figures of a specimen: the noise-free model driven over a plan's cycle, by the definitions of
analysis/METHODS.md.

Hysteresis is the largest distance between the two branches on a common grid, in % of the full-scale output (of the
span, for the actuator); sensitivity is the end-to-end slope of the cubic over the range reached; SNR is 20 log10(FSO /
noise rms). A staircase's branches are the means of its holds, with straight lines between them (for the sensor's loop,
between their residuals from its cubic); those of a continuous cycle are read at every tick. The noise of a hold has the
pressure's ripple and the creep within it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from protocol.base.arrays import FloatArray
from protocol.simulator.plant import PUMP_NOISE, RAMP_LAG_S, TICK_S, Body, Pneumatics, Sensors, cubic
from protocol.simulator.specimens import find_specimen

CONTINUOUS = (50.0, -40.0, 50.0)
_RIPPLE_SEED = 0
_SETTLED_S = 1.0  # after the end of a ramp, as in `analysis`


@dataclass(frozen=True, slots=True)
class SensorTruth:
    """The true figures of one sensor, named as `analyze --json` names them."""

    name: str
    coefficients: tuple[float, float, float, float]
    sensitivity_mv_per_mm: float
    fso_mv: float
    noise_mv: float
    snr_db: float
    sensor_hysteresis_percent_fso: float
    system_hysteresis_percent_fso: float


@dataclass(frozen=True, slots=True)
class Truth:
    """The true figures of a specimen, `unit` by name."""

    unit: str
    range_mm: tuple[float, float]
    actuator_hysteresis_percent: float
    system_sensitivity_mv_per_mm: float
    sensors: tuple[SensorTruth, ...]


@dataclass(frozen=True, slots=True)
class Hold:
    """One target of a run: how long it was held after its ramp's end, and the part of that which is analysed, s.

    `place` is the position in the cycle that it was read for, counted from its start; None where it is not analysed.
    """

    target_kpa: float
    hold_s: float
    first_s: float
    last_s: float
    place: int | None


@dataclass(frozen=True, slots=True)
class NoiseFreeRun:
    """The plant without noise, one row a tick: shapes (n,) and (n, sensors). `arrivals` [targets]: when ramps end."""

    time_s: FloatArray
    pressure_kpa: FloatArray
    elongation_mm: FloatArray
    signal_mv: FloatArray
    arrivals_s: FloatArray

    def holds(
        self, after_s: float | FloatArray, last_s: float | FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return mean pressure, elongation and signals of each hold, from `after_s` to `last_s` after the arrival."""
        parts = self.parts(after_s, last_s)
        pressure, elongation = (
            [float(v[part].mean()) for part in parts] for v in (self.pressure_kpa, self.elongation_mm)
        )
        return np.array(pressure), np.array(elongation), np.array([self.signal_mv[part].mean(axis=0) for part in parts])

    def parts(self, after_s: float | FloatArray, last_s: float | FloatArray) -> list[slice]:
        """Return the rows of each hold, from `after_s` to `last_s` after the arrival, one at least."""
        first, last = (np.searchsorted(self.time_s, self.arrivals_s + t) for t in (after_s, last_s))
        return [slice(int(a), max(int(b), int(a) + 1)) for a, b in zip(first, last, strict=True)]


def noise_free_run(
    unit: str,
    targets_kpa: Sequence[float],
    *,
    ramp_kpa_per_s: float,
    dwell_s: float | Sequence[float],
    ripple: bool = False,
) -> NoiseFreeRun:
    """Return the noise-free run of a specimen from rest through holds of `dwell_s`. RequestError: no such specimen.

    `dwell_s`: of all holds, or of each; `ripple`: the pumps move the pressure as on the virtual board.
    """
    model = find_specimen(unit)
    pneumatics = Pneumatics()
    pressure: list[float] = []
    arrivals = []
    held = [dwell_s] * len(targets_kpa) if isinstance(dwell_s, (int, float)) else dwell_s
    rng = np.random.default_rng(_RIPPLE_SEED)
    for (start, target), hold_s in zip(itertools.pairwise((0.0, *targets_kpa)), held, strict=True):
        pneumatics.command(target, ramp_kpa_per_s)
        arrivals.append(TICK_S * len(pressure) + abs(target - start) / ramp_kpa_per_s)
        ticks = math.ceil((abs(target - start) / ramp_kpa_per_s + hold_s) / TICK_S)
        for noise in (PUMP_NOISE * rng.standard_normal(ticks)).tolist() if ripple else [0.0] * ticks:
            pneumatics.step(noise)
            pressure.append(pneumatics.bladder_kpa)
    pressure_kpa = np.array(pressure)
    elongation_mm = Body(model.actuator).advance(pressure_kpa)
    signal_mv = Sensors(model.sensors, model.range_mm).advance(elongation_mm)
    time_s = TICK_S * np.arange(1.0, pressure_kpa.size + 1)
    return NoiseFreeRun(time_s, pressure_kpa, elongation_mm, signal_mv, np.array(arrivals))


def truth_figures(
    unit: str = "SA1",
    *,
    cycle_kpa: Sequence[float] = CONTINUOUS,
    ramp_kpa_per_s: float = 10.0,
    dwell_s: float = 0.5,
) -> Truth:
    """Return the true figures of a specimen over a cycle, the third of a run. RequestError: no such specimen.

    `cycle_kpa`: targets of one cycle, first and last the same; more than the three of `CONTINUOUS` are a staircase,
    read from `_SETTLED_S` after each arrival. `dwell_s`: time at each target.
    """
    model = find_specimen(unit)
    targets = (*cycle_kpa, *cycle_kpa[1:], *cycle_kpa[1:])
    run = noise_free_run(unit, targets, ramp_kpa_per_s=ramp_kpa_per_s, dwell_s=dwell_s)
    third = slice(-round((run.time_s.size - abs(cycle_kpa[0]) / ramp_kpa_per_s / TICK_S - dwell_s / TICK_S) / 3), None)
    p, x, y = run.pressure_kpa[third], run.elongation_mm[third], run.signal_mv[third]
    staircase = len(cycle_kpa) > len(CONTINUOUS)
    if staircase:
        p, x, y = (held[-len(cycle_kpa) :] for held in run.holds(min(_SETTLED_S, 0.5 * dwell_s), dwell_s))
    return _figures(unit, p, x, y, [sensor.noise_mv for sensor in model.sensors], staircase=staircase)


def ramp_ends(
    time_s: FloatArray, pressure_kpa: FloatArray, ramp_kpa: tuple[float, float], ramp_kpa_per_s: float
) -> tuple[float, float]:
    """Return when the setpoint began and ended the first ramp from one level to another, s."""
    start, end = ramp_kpa
    passed = np.sign(end - start) * (pressure_kpa - 0.5 * (start + end)) >= 0.0
    middle, half = float(time_s[np.argmax(passed)]) - RAMP_LAG_S, 0.5 * abs(end - start) / ramp_kpa_per_s
    return middle - half, middle + half


def truth_of_holds(unit: str, holds: Sequence[Hold], *, ramp_kpa_per_s: float) -> Truth:
    """Return the true figures of a whole staircase, as it was held; the mean loop is over its holds at each place."""
    targets, dwell_s = [hold.target_kpa for hold in holds], [hold.hold_s for hold in holds]
    first, last = (np.array([getattr(hold, name) for hold in holds]) for name in ("first_s", "last_s"))
    run = noise_free_run(unit, targets, ramp_kpa_per_s=ramp_kpa_per_s, dwell_s=dwell_s)
    places = np.array([-1 if hold.place is None else hold.place for hold in holds])
    p, x, y = (
        np.array([values[places == place].mean(axis=0) for place in np.unique(places[places >= 0])])
        for values in run.holds(first, last)
    )
    p, x, y = (np.concatenate([values, values[:1]]) for values in (p, x, y))  # the cycle ends where it begins
    moved = noise_free_run(unit, targets, ramp_kpa_per_s=ramp_kpa_per_s, dwell_s=dwell_s, ripple=True)
    parts = [part for part, place in zip(moved.parts(first, last), places, strict=True) if place >= 0]
    ripple = np.sqrt(np.mean([moved.signal_mv[part].var(axis=0) for part in parts], axis=0))
    own = [sensor.noise_mv for sensor in find_specimen(unit).sensors]
    return _figures(unit, p, x, y, np.hypot(own, ripple).tolist(), staircase=True)


def _figures(
    unit: str, p: FloatArray, x: FloatArray, y: FloatArray, noise_mv: Sequence[float], *, staircase: bool
) -> Truth:
    """Return the figures of one cycle, from its highest pressure and back to it."""
    model = find_specimen(unit)
    low, high = float(x.min()), float(x.max())
    sensors = []
    for number, sensor in enumerate(model.sensors, 1):
        bottom, top = cubic(sensor.coefficients, np.array([low, high])).tolist()
        fso = abs(top - bottom)
        signal = y[:, number - 1]
        own = signal - cubic(sensor.coefficients, x) if staircase else signal
        sensors.append(
            SensorTruth(
                name=f"s{number}",
                coefficients=sensor.coefficients,
                sensitivity_mv_per_mm=fso / (high - low),
                fso_mv=fso,
                noise_mv=noise_mv[number - 1],
                snr_db=20 * math.log10(fso / noise_mv[number - 1]),
                sensor_hysteresis_percent_fso=100 * loop_width(x, own) / fso,
                system_hysteresis_percent_fso=100 * loop_width(p, signal) / fso,
            )
        )
    return Truth(
        unit=unit,
        range_mm=(low, high),
        actuator_hysteresis_percent=100 * loop_width(p, x) / (high - low),
        system_sensitivity_mv_per_mm=float(np.mean([s.sensitivity_mv_per_mm for s in sensors])),
        sensors=tuple(sensors),
    )


def loop_width(abscissa: FloatArray, ordinate: FloatArray) -> float:
    """Return the largest distance between the falling and the rising branch of one cycle, arrays of shape (n,).

    The cycle starts and ends at its highest abscissa. A branch is the successive extremes that it reaches, so that
    ripple about a plateau cannot fold it; both are interpolated on a common grid.
    """
    turn = int(np.argmin(abscissa))
    branches = []
    for part, sign in ((slice(0, turn + 1), -1.0), (slice(turn, None), 1.0)):
        a, o = sign * abscissa[part], ordinate[part]
        advances = a >= np.maximum.accumulate(a)
        branches.append((sign * a[advances], o[advances]))
    (falling, down), (rising, up) = branches
    grid = np.linspace(max(falling.min(), rising.min()), min(falling.max(), rising.max()), 2001)
    gap = np.interp(grid, falling[::-1], down[::-1]) - np.interp(grid, rising, up)
    return float(np.abs(gap).max())
