"""The virtual board's body and sensors, cycled fast: what the monitor is measured on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from protocol.simulator.plant import TICK_S, Body, Pneumatics, Sensors, cubic
from protocol.simulator.specimens import find_specimen

PUMP_NOISE = 0.15  # kPa/s a tick, as on the virtual board
INTERFERENCE_MV, INTERFERENCE_S = 0.157, 24.99
"""Flicker of 5 mV at 100.04 Hz between dark and lit, 50 us apart, sampled at 100 Hz."""
KPA_PER_CYCLE = 180.0


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault, and the cycle in which it begins (from 0)."""

    begins: int = 10**9
    leak_percent_per_min: float = 0.0
    softening_percent_in_50: float = 0.0
    disagreement_mv: float = 0.0


@dataclass(frozen=True, slots=True)
class Run:
    """Arrays of a run: time, gauge pressure, elongation by each sensor, and the rows of each cycle."""

    time_s: np.ndarray
    pressure_kpa: np.ndarray
    elongations_mm: np.ndarray
    cycles: list[slice]


def run_actuator(
    cycles: int, fault: Fault | None = None, *, staircase: bool = True, seed: int = 0, unit_name: str = "SA1"
) -> Run:
    """Cycle a unit between +50 and -40 kPa, in steps of 10 kPa or continuously, as sequencer and board do it.

    Holds are of unequal length (3 s and more, 0.5 s and more), light flickers, and beyond the unit's range no
    calibration knows an elongation.
    """
    present = fault or Fault()
    rng, unit, line = np.random.default_rng(seed), find_specimen(unit_name), Pneumatics()
    levels = [*range(40, -50, -10), *range(-30, 60, 10)] if staircase else [-40, 50]
    gauge: list[float] = []
    bladder: list[float] = []
    gain: list[float] = []
    travel = 0.0
    marks = []

    def go(target: float, hold_s: float, *, softens: bool) -> None:
        nonlocal travel
        line.command(target, 10.0)
        ticks = round(hold_s / TICK_S)
        while ticks > 0:
            ticks -= line.setpoint_arrived
            before = line.pressure_kpa
            line.step(PUMP_NOISE * rng.standard_normal())
            travel += abs(line.pressure_kpa - before) * softens
            gauge.append(line.pressure_kpa)
            bladder.append(line.bladder_kpa)
            gain.append(1 + present.softening_percent_in_50 / 100 * travel / KPA_PER_CYCLE / 50)

    go(50.0, 2.0, softens=False)
    for cycle in range(cycles):
        began = cycle >= present.begins
        line.leak_per_s = present.leak_percent_per_min / 6000 if began else 0.0
        marks.append(len(gauge))
        for level in levels:
            longer = rng.exponential(0.8) if staircase else rng.uniform(0.0, 0.15)
            go(float(level), (3.0 if staircase else 0.5) + longer, softens=began)
    marks.append(len(gauge))
    stretch = Body(unit.actuator).advance(np.array(bladder)) * np.array(gain)
    signal = Sensors(unit.sensors, unit.range_mm).advance(stretch)
    signal += rng.standard_normal(signal.shape) * [s.noise_mv for s in unit.sensors]
    rows = np.arange(len(signal))
    signal += INTERFERENCE_MV * np.cos(2.0 * np.pi * rows * TICK_S / INTERFERENCE_S + seed)[:, None]
    if present.begins < cycles:
        signal[:, -1] += present.disagreement_mv * (rows >= marks[present.begins])
    grid = np.linspace(*unit.range_mm, 4000)
    inverse = [
        np.interp(signal[:, k], cubic(s.coefficients, grid), grid, left=np.nan, right=np.nan)
        for k, s in enumerate(unit.sensors)
    ]
    measured = np.array(gauge) + 0.05 * rng.standard_normal(len(gauge))
    spans = [slice(a, b) for a, b in pairwise(marks)]
    return Run(rows * TICK_S, measured, np.stack(inverse, axis=1), spans)
