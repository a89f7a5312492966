"""A plant with a closed-form truth, and a writer of `.boat` files from the schema: the analysis is tried on both."""

from __future__ import annotations

import json
import sqlite3
import zlib
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from analysis.data.recording import STEP_COLUMNS, Recording
from protocol.recording import APPLICATION_ID, SCHEMA_VERSION, SESSION_KEYS, TABLES, describe_dtype, sample_dtype

PAPER = ((1651.9842, 46.4413, -2.6934, -0.36251), (1624.5567, 33.37911, -2.3102, -0.14139))
PAPER_NOISE = (1.49, 1.04)
LEVELS = np.arange(50, -41, -10)


@dataclass(frozen=True)
class Plant:
    """Pressure follows the plan, x follows pressure with a loop of known width, mV follows x by the cubics."""

    cubics: tuple[tuple[float, ...], ...] = PAPER
    noise_mv: tuple[float, ...] = PAPER_NOISE
    loop_mm: float = 0.0
    drift_mv_per_cycle: float = 0.0
    pressure_noise_kpa: float = 0.05
    rate_hz: float = 100.0
    seed: int = 0

    def elongation(self, pressure_kpa: np.ndarray, loading: np.ndarray) -> np.ndarray:
        """x(p): a straight line between (-40, -2.7) and (50, 3.8), and a parabola of `loop_mm` between branches."""
        share = (pressure_kpa + 40.0) / 90.0
        bow = 2.0 * share * (1.0 - share) * self.loop_mm
        return -2.7 + 6.5 * share + np.where(loading, -bow, bow)

    def run(self, pressure: np.ndarray, loading: np.ndarray, cycle: np.ndarray, **columns: Any) -> Recording:
        """Return the recording of a pressure trace [n]."""
        rng = np.random.default_rng(self.seed)
        x = self.elongation(pressure, loading)
        signal = np.stack([np.polynomial.Polynomial(c)(x) for c in self.cubics], axis=1)
        signal += (self.drift_mv_per_cycle * cycle)[:, None]
        signal += rng.standard_normal(signal.shape) * np.asarray(self.noise_mv[: signal.shape[1]])
        measured = pressure + self.pressure_noise_kpa * rng.standard_normal(pressure.size)
        time = np.arange(pressure.size) / self.rate_hz
        return Recording.from_arrays(time, measured, signal, **columns)


@dataclass(frozen=True)
class Staircase:
    """A staircase +50 -> -40 -> +50 kPa, vented before and after."""

    plant: Plant = field(default_factory=Plant)
    cycles: int = 5
    dwell_s: float = 2.0
    ramp_kpa_per_s: float = 20.0
    vent: bool = True

    def levels(self) -> list[tuple[float, bool, int]]:
        """Level, whether loading, and cycle of every hold in order."""
        holds = [(50.0, False, 1)]
        for k in range(1, self.cycles + 1):
            holds += [(float(p), False, k) for p in LEVELS[1:]]
            holds += [(float(p), True, k) for p in LEVELS[::-1][1:]]
        return holds

    def trace(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[int, int]]]:
        """Return pressure, loading, cycle [n] and the rows of every hold."""
        rate = self.plant.rate_hz
        pressure: list[np.ndarray] = [np.zeros(int(rate))] if self.vent else []
        loading: list[np.ndarray] = [np.zeros(int(rate), bool)] if self.vent else []
        cycle: list[np.ndarray] = [np.zeros(int(rate))] if self.vent else []
        rows: list[tuple[int, int]] = []
        at, n = (0.0 if self.vent else 50.0), int(rate) if self.vent else 0
        for level, up, k in self.levels():
            ramp = np.linspace(at, level, max(1, round(abs(level - at) / self.ramp_kpa_per_s * rate)), endpoint=False)
            hold = np.full(round(self.dwell_s * rate), level)
            pressure += [ramp, hold]
            loading += [np.full(ramp.size + hold.size, up)]
            cycle += [np.full(ramp.size + hold.size, float(k))]
            rows.append((n + ramp.size, n + ramp.size + hold.size - 1))
            n += ramp.size + hold.size
            at = level
        if self.vent:
            tail = np.concatenate([np.linspace(at, 0, int(rate)), np.zeros(int(rate))])
            pressure.append(tail)
            loading.append(np.ones(tail.size, bool))
            cycle.append(np.full(tail.size, float(self.cycles)))
        return np.concatenate(pressure), np.concatenate(loading), np.concatenate(cycle), rows

    def recording(self, **columns: Any) -> Recording:
        """Return the run."""
        pressure, loading, cycle, _ = self.trace()
        return self.plant.run(pressure, loading, cycle, **columns)

    def elongations(self) -> pd.DataFrame:
        """Return the exact elongations, one row a hold."""
        levels = self.levels()
        p = np.asarray([level for level, _, _ in levels])
        up = np.asarray([u for _, u, _ in levels])
        return pd.DataFrame({"pressure_kpa": p, "elongation_mm": self.plant.elongation(p, up)})


def triangle(cycles: int, period_s: float, rate_hz: float = 100.0, vent: bool = False) -> tuple[np.ndarray, ...]:
    """Pressure, loading and cycle of continuous cycles +50 -> -40 -> +50 kPa."""
    phase = np.arange(round(cycles * period_s * rate_hz) + 1) / (period_s * rate_hz)
    share = np.abs(1.0 - 2.0 * (phase % 1.0))
    pressure = -40.0 + 90.0 * share
    return pressure, (phase % 1.0) >= 0.5, np.floor(phase) + 1


def write_boat(path: Path, recording: Recording, *, meta: dict[str, Any] | None = None, steps: Any = ()) -> Path:
    """Write a recording as a `.boat` file; signals become counts of 16 bits at 4096 mV, so nothing is rounded away."""
    dtype = sample_dtype(recording.n_sensors)
    samples = np.zeros(recording.n, dtype)
    samples["index"] = recording.index
    samples["time_us"] = np.round(recording.time_s * 1e6)
    samples["pressure_pa"] = recording.pressure_kpa * 1000
    samples["state"], samples["flags"] = recording.state, recording.flags
    samples["dark"] = 100
    samples["lit"] = np.round(recording.signal_mv * 16) + 100
    values: dict[str, Any] = dict.fromkeys(SESSION_KEYS)
    values |= {
        "uuid": "0", "status": "closed", "simulated": True, "program_version": "test", "n_sensors": recording.n_sensors,
        "sample_kind": "counts", "sample_dtype": describe_dtype(dtype), "vref_mv": 4096, "adc_bits": 16,
        "rate_hz": 100, "unit": "SA1", "started_utc": "2026-01-01T00:00:00+00:00", "polarity": -1,
    }  # fmt: skip
    values |= meta or {}
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"PRAGMA application_id={APPLICATION_ID}")
        db.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
        db.executescript(TABLES)
        db.executemany(
            "INSERT INTO session (key, value) VALUES (?, ?)", [(k, json.dumps(v)) for k, v in values.items()]
        )
        for segment in np.unique(recording.segment):
            db.execute(
                "INSERT INTO segment (id, host_ns, first_chunk, reason) VALUES (?, ?, 0, 'start')",
                (int(segment), int(segment) * 10**9),
            )
        for first in range(0, recording.n, 5000):
            part = samples[first : first + 5000]
            segment = int(recording.segment[first])
            times = (int(part["time_us"][0]), int(part["time_us"][-1]))
            db.execute(
                "INSERT INTO block (segment, last_chunk, n, first_time_us, last_time_us, samples, crc32)"
                " VALUES (?,0,?,?,?,?,?)",
                (segment, part.size, *times, part.tobytes(), zlib.crc32(part.tobytes())),
            )
        db.executemany(
            "INSERT INTO step (id, segment, number, cycle, branch, target_kpa, ramp_kpa_per_s, started_us, ended_us,"
            " status) VALUES (?, 0, ?, ?, ?, ?, 20, ?, ?, 'reached')",
            steps,
        )
    db.close()
    return path


def marks_of(stairs: Staircase) -> pd.DataFrame:
    """The steps that a sequencer would have marked for a staircase: one a hold, begun by its ramp."""
    rate, before, rows = stairs.plant.rate_hz, 100, []
    for number, ((_, last), (level, up, k)) in enumerate(zip(stairs.trace()[3], stairs.levels(), strict=True), 1):
        branch = "start" if number == 1 else "loading" if up else "unloading"
        cycle = 0 if number == 1 else k
        times = (before / rate, None, None, (last + 1) / rate)
        rows.append((number, 0, number, cycle, branch, level, 20.0, *times, "reached", "{}"))
        before = last + 1
    return pd.DataFrame(rows, columns=list(STEP_COLUMNS))
