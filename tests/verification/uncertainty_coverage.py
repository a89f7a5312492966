"""Does U hold? Simulated sensors of nine kinds, each with a truth by formulas: the share of new readings within U.

    python -m tests.verification.uncertainty_coverage --sensors 40

A sensor is calibrated by a staircase of five cycles that is read on a grid of 0.1 mm. New readings are single samples
of a further cycle. U holds if 93 to 97 % of them are within it; where it does not, it is to be refused (not given), or
marked (by a warning that names the fault, or a stated stand-in).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import Options, Recording, analyse
from analysis.calibration_export.run_record import elongation_reader
from analysis.figures.pipeline import Analysis
from analysis.numbers import finite
from analysis.warning import WarningCode

RATE_HZ, HOLD_S, RAMP_S, CYCLES = 50.0, 1.5, 0.5, 5
LEVELS_KPA = np.arange(50.0, -41.0, -10.0)
NOISE_MV, CYCLE_MV, LOOP_MV, LOOP_MM = 1.5, 0.3, 2.0, 0.25
GRID_MM, READER_MM = 0.1, 0.03
DRIFT_MV, CREEP, CREEP_S = 5.0, 0.06, 5.0
LOW, HIGH = 0.93, 0.97
MARKS = {WarningCode.NOT_SETTLED, WarningCode.DRIFT, WarningCode.INADEQUATE_CURVE, WarningCode.DOUBTFUL_CURVE}


def _scaled(x: np.ndarray) -> np.ndarray:
    return (x - 0.55) / 3.25


def _cubic(x: np.ndarray) -> np.ndarray:
    return 1651.9842 + x * (46.4413 + x * (-2.6934 - 0.36251 * x))


def _quintic(x: np.ndarray) -> np.ndarray:
    return 1650.0 + 125.0 * (0.5 * _scaled(x) + 0.5 * _scaled(x) ** 5)


def _dead_zone(x: np.ndarray) -> np.ndarray:
    """Return a signal that is level over 1 mm in the middle."""
    away = x - 0.55
    return 1650.0 + 46.0 * np.sign(away) * np.maximum(np.abs(away) - 0.5, 0.0)


CURVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {"quintic": _quintic, "dead zone": _dead_zone}
KINDS = (
    "cubic", "quintic", "dead zone", "one branch", "one cycle", "lost sensor", "drift", "creep", "growing noise",
)  # fmt: skip


@dataclass(frozen=True)
class Simulated:
    """A run with its readings, and new readings: signals [n, sensors] and true elongations [n]."""

    recording: Recording
    readings: pd.DataFrame
    signal_mv: np.ndarray
    elongation_mm: np.ndarray


def _creeping(values: np.ndarray) -> np.ndarray:
    level, found = values[0], np.empty_like(values)
    for i, value in enumerate(values):
        level += (value - level) / (RATE_HZ * CREEP_S)
        found[i] = (1.0 - CREEP) * value + CREEP * level
    return found


def simulated(kind: str, seed: int) -> Simulated:
    """Return one sensor of a kind, or of two (`drift and creep`); two sensors where one is lost.

    With its calibration run, and new readings.
    """
    kinds = kind.split(" and ")
    rng = np.random.default_rng((*(KINDS.index(one) for one in kinds), seed))
    cycles = 1 if "one cycle" in kinds else CYCLES
    holds = [(50.0, -1, 1)]
    for k in range(1, cycles + 2):  # the last one gives the new readings
        holds += [(p, -1, k) for p in LEVELS_KPA[1:]] + [(p, 1, k) for p in LEVELS_KPA[::-1][1:]]
    ramp, hold = int(RAMP_S * RATE_HZ), int(HOLD_S * RATE_HZ)
    before = [0.0, *(level for level, _, _ in holds[:-1])]
    pressure = np.concatenate([
        np.append(np.linspace(at, level, ramp, endpoint=False), np.full(hold, level))
        for at, (level, _, _) in zip(before, holds, strict=True)
    ])  # fmt: skip
    way, cycle = (np.repeat([one[i] for one in holds], ramp + hold) for i in (1, 2))
    share = (pressure + 40.0) / 90.0
    x = -2.7 + 6.5 * share - 2.0 * share * (1.0 - share) * LOOP_MM * way
    clean = CURVES.get(kinds[0], _cubic)(x) + 0.5 * LOOP_MV * way * (1.0 - _scaled(x) ** 2)
    clean = _creeping(clean) if "creep" in kinds else clean
    clean = clean + CYCLE_MV * rng.standard_normal(cycles + 2)[cycle]
    sd = NOISE_MV * (0.4 + 1.2 * share) if "growing noise" in kinds else np.full(x.size, NOISE_MV)
    signal = np.stack([clean + sd * rng.standard_normal(x.size) for _ in range(2 if "lost sensor" in kinds else 1)], 1)
    end = int(np.flatnonzero(cycle == cycles)[-1]) + 1
    time = np.arange(x.size) / RATE_HZ
    settled = np.tile(np.append(np.zeros(ramp + hold // 2, bool), np.ones(hold - hold // 2, bool)), len(holds))
    new = settled & (cycle == cycles + 1) & (np.abs(_scaled(x)) < 0.98)
    if "drift" in kinds:  # of the run, which its readings are to be of
        signal[:end] += (DRIFT_MV * (time[:end] / time[end] - 0.5))[:, None]
        signal[new] += (DRIFT_MV * (rng.random(int(new.sum())) - 0.5))[:, None]
    if "lost sensor" in kinds:
        signal[end // 2 :, 1] = signal[end // 2, 1]
    measured = pressure + 0.05 * rng.standard_normal(pressure.size)
    run = Recording.from_arrays(time[:end], measured[:end], signal[:end], meta={"unit": "SIM"})
    at = np.asarray([i * (ramp + hold) + ramp + hold // 2 for i in range(len(holds))])
    seen = np.round((x[at] + READER_MM * rng.standard_normal(at.size)) / GRID_MM) * GRID_MM
    rows = [
        (level, value, k, "loading" if up > 0 else "unloading")
        for (level, up, k), value in zip(holds, seen, strict=True) if k <= cycles
    ]  # fmt: skip
    readings = pd.DataFrame(rows, columns=["pressure_kpa", "elongation_mm", "cycle", "branch"])
    if "one branch" in kinds:
        readings = readings[readings["branch"] == "loading"]
    return Simulated(run, readings.iloc[0:], signal[new], x[new])


@dataclass(frozen=True)
class Outcome:
    """One sensor: the share of its new readings within U, NaN where U was refused, and the warnings that mark it."""

    within: float
    marks: tuple[str, ...]


def outcome(kind: str, seed: int) -> Outcome:
    """Calibrate one simulated sensor and read it."""
    one = simulated(kind, seed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "e.csv"
        one.readings.to_csv(file, index=False)
        options = Options(mcmc=False, fidelity="draft", x_resolution_mm=GRID_MM)
        analysis: Analysis = analyse(one.recording, file, options=options)
    found = elongation_reader(analysis).evaluate(one.signal_mv)
    marks = tuple(sorted({str(w.code) for w in analysis.warnings if w.code in MARKS}))
    away, u = np.abs(found.elongation_mm - one.elongation_mm), 2.0 * found.standard_uncertainty_mm
    known = np.isfinite(away) & np.isfinite(u)
    return Outcome(float(np.mean(away[known] <= u[known])) if known.any() else float("nan"), marks)


@dataclass(frozen=True)
class Row:
    """One line of the table: numbers of sensors, and the mean share within U with its standard error."""

    kind: str
    sensors: int
    refused: int
    marked: int
    within: float
    standard_error: float

    @property
    def holds(self) -> bool:
        """Whether U holds, or is refused or marked for every sensor."""
        return self.refused == self.sensors or self.marked == self.sensors or LOW <= self.within <= HIGH


def table(sensors: int, kinds: tuple[str, ...] = KINDS) -> list[Row]:
    """Return a row for each kind."""
    rows = []
    for kind in kinds:
        each = [outcome(kind, seed) for seed in range(sensors)]
        shares = np.asarray([one.within for one in each])
        given = shares[np.isfinite(shares)]
        refused, marked = int(np.isnan(shares).sum()), sum(bool(one.marks) for one in each)
        within = float(given.mean()) if given.size else float("nan")
        error = float(given.std(ddof=1) / np.sqrt(given.size)) if given.size > 1 else float("nan")
        rows.append(Row(kind, sensors, refused, marked, within, error))
        print(json.dumps(finite({**vars(rows[-1]), "holds": rows[-1].holds})), flush=True)
    return rows


def main() -> None:
    """Print the table, one line of JSON a kind."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--sensors", type=int, default=40)
    table(parser.parse_args().sensors)


if __name__ == "__main__":
    main()
