"""True figures of a specimen: the noise-free model driven over a plan's cycle, by the definitions of
analysis/METHODS.md.

Hysteresis is the largest distance between the two branches on a common grid, in % of the full-scale output (of the
span, for the actuator); sensitivity is the end-to-end slope of the cubic over the range reached; SNR is 20 log10(FSO /
noise rms). A staircase's branches are the means of its holds, with straight lines between them (for the sensor's loop,
between their residuals from its cubic); those of a continuous cycle are read at every tick.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from protocol.base.arrays import FloatArray
from protocol.simulator.plant import TICK_S, Body, Pneumatics, Sensors, cubic
from protocol.simulator.specimens import find_specimen

CONTINUOUS = (50.0, -40.0, 50.0)
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
class NoiseFreeRun:
    """The plant without noise, one row a tick: shapes (n,) and (n, sensors). `arrivals` [targets]: when ramps end."""

    time_s: FloatArray
    pressure_kpa: FloatArray
    elongation_mm: FloatArray
    signal_mv: FloatArray
    arrivals_s: FloatArray

    def holds(self, after_s: float, last_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return mean pressure, elongation and signals of each hold, from `after_s` to `last_s` after the arrival."""
        rows = [np.searchsorted(self.time_s, self.arrivals_s + t) for t in (after_s, last_s)]
        parts = [slice(first, last) for first, last in zip(*rows, strict=True)]
        pressure, elongation = (
            [float(v[part].mean()) for part in parts] for v in (self.pressure_kpa, self.elongation_mm)
        )
        return np.array(pressure), np.array(elongation), np.array([self.signal_mv[part].mean(axis=0) for part in parts])


def noise_free_run(unit: str, targets_kpa: Sequence[float], *, ramp_kpa_per_s: float, dwell_s: float) -> NoiseFreeRun:
    """Return the noise-free run of a specimen from rest through holds of `dwell_s`. RequestError: no such specimen."""
    model = find_specimen(unit)
    pneumatics = Pneumatics()
    pressure: list[float] = []
    arrivals = []
    for start, target in itertools.pairwise((0.0, *targets_kpa)):
        pneumatics.command(target, ramp_kpa_per_s)
        arrivals.append(TICK_S * len(pressure) + abs(target - start) / ramp_kpa_per_s)
        for _ in range(math.ceil((abs(target - start) / ramp_kpa_per_s + dwell_s) / TICK_S)):
            pneumatics.step(0.0)
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

    Parameters
    ----------
    cycle_kpa : targets of one cycle, first and last the same; more than the three of `CONTINUOUS` are a staircase, read
        from `_SETTLED_S` after each arrival.
    dwell_s : time at each target.
    """
    model = find_specimen(unit)
    targets = (*cycle_kpa, *cycle_kpa[1:], *cycle_kpa[1:])
    run = noise_free_run(unit, targets, ramp_kpa_per_s=ramp_kpa_per_s, dwell_s=dwell_s)
    third = slice(-round((run.time_s.size - abs(cycle_kpa[0]) / ramp_kpa_per_s / TICK_S - dwell_s / TICK_S) / 3), None)
    p, x, y = run.pressure_kpa[third], run.elongation_mm[third], run.signal_mv[third]
    staircase = len(cycle_kpa) > len(CONTINUOUS)
    if staircase:
        p, x, y = (held[-len(cycle_kpa) :] for held in run.holds(min(_SETTLED_S, 0.5 * dwell_s), dwell_s))
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
                noise_mv=sensor.noise_mv,
                snr_db=20 * math.log10(fso / sensor.noise_mv),
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
