"""The virtual board's sampling: its instants, and the content of each SAMPLE.

Instant n of a run is at start + floor(n / rate), whether it is sent or not; between the plant's ticks values are
interpolated. Everything is computed element by element, and noise is a function of the number of the instant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import FloatArray, IntArray
from protocol.recording import SampleFlag
from protocol.simulator.adc import FULL_SCALE, PRESSURE_NOISE_PA, FrontEnd, SampleNoise
from protocol.simulator.plant import TICK_US
from protocol.simulator.sample_frames import body_dtype
from protocol.simulator.specimens import Specimen


def truth_dtype(n_sensors: int) -> np.dtype[np.void]:
    """Return the record of the true values of one sample, without noise.

    `run` counts the STARTs of the board from 1; `run` and `index` identify the sample in a recording.
    """
    head = [("run", "<u4"), ("index", "<u4"), ("time_us", "<i8"), ("elongation_mm", "<f8"), ("pressure_kpa", "<f8")]
    return np.dtype([*head, ("signal_mv", "<f8", (n_sensors,))])


@dataclass(frozen=True, slots=True)
class PlantBlock:
    """Values of the plant at consecutive ticks, and the board's state from each tick on."""

    first_tick: int
    rows: FloatArray  # (n + 1, 2 + sensors): gauge kPa, elongation mm, signals mV, at the tick and after the last one
    states: IntArray  # (n,)
    flags: IntArray  # (n,)


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """Consecutive samples: board time, SAMPLE bodies, true values; all shape (n,)."""

    time_us: IntArray
    bodies: NDArray[np.void]
    truth: NDArray[np.void]


class Sampler:
    """Makes the samples of a specimen, run after run."""

    def __init__(self, specimen: Specimen, seed: int) -> None:
        self.run = 0  # STARTs so far
        self._front_end = FrontEnd(specimen.sensors)
        self._n_sensors = len(specimen.sensors)
        self._seed = seed
        self._noise = SampleNoise(seed, 0, self._n_sensors)
        self._rate_hz = 0
        self._next = 0
        self._anchor = (0, 0)  # an instant's number and time, from which the rate counts

    def start(self, now_us: int, rate_hz: int) -> None:
        """Begin a run with index 0 now."""
        self.run += 1
        self._noise = SampleNoise(self._seed, self.run, self._n_sensors)
        self._rate_hz, self._next, self._anchor = rate_hz, 0, (0, now_us)

    def stop(self) -> None:
        """Make no more samples."""
        self._rate_hz = 0

    def change_rate(self, now_us: int, rate_hz: int) -> None:
        """Continue at another rate, as a board with a wrong divider does."""
        if self._rate_hz:
            self._anchor = (self._next, max(now_us, self._time_of(self._next)))
            self._rate_hz = rate_hz

    def _time_of(self, index: int) -> int:
        first, start_us = self._anchor
        return start_us + (index - first) * 1_000_000 // self._rate_hz

    def _instants(self, stop_us: int, jitter_ms: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return number, time and noise of the next instants up to and with `stop_us`."""
        first, start_us = self._anchor
        last = first + ((stop_us - start_us + 1) * self._rate_hz - 1) // 1_000_000
        index = np.arange(self._next, last + 1)
        time_us = start_us + (index - first) * 1_000_000 // self._rate_hz
        noise, uniform = self._noise.rows(self._next, index.size)
        if jitter_ms:
            most_us = min(1000.0 * jitter_ms, 0.9e6 / self._rate_hz)
            time_us = time_us + (uniform * most_us).astype(np.int64)
            index = index[: np.searchsorted(time_us, stop_us, side="right")]
        return index, time_us[: index.size], noise[: index.size]

    def make(
        self, plant: PlantBlock, stop_us: int, faults: Mapping[str, float], since_us: Mapping[str, int]
    ) -> SampleBlock:
        """Return the samples up to and with `stop_us`.

        Parameters
        ----------
        plant : ticks that enclose `stop_us`.
        stop_us : board time.
        faults : the active ones, name -> value.
        since_us : board time at which each began.
        """
        if not self._rate_hz:
            nothing = np.empty(0, np.int64)
            return SampleBlock(nothing, self._bodies(0), np.empty(0, truth_dtype(self._n_sensors)))
        index, time_us, noise = self._instants(stop_us, faults.get("jitter", 0.0))
        self._next += index.size
        tick = time_us // TICK_US - plant.first_tick
        part = ((time_us % TICK_US) / TICK_US)[:, None]
        rows = plant.rows[tick]
        rows = rows + (plant.rows[tick + 1] - rows) * part
        counts = self._front_end.convert(
            rows[:, 2:], time_us, noise[:, 1:].reshape(-1, self._n_sensors, 2), faults, since_us.get("ambient_ramp", 0)
        )
        bodies = self._bodies(index.size)
        bodies["index"] = index
        bodies["pressure_pa"] = np.rint(1000.0 * rows[:, 0] + PRESSURE_NOISE_PA * noise[:, 0])
        bodies["state"] = plant.states[tick]
        saturated = (counts == FULL_SCALE).any(axis=(1, 2))
        bodies["flags"] = plant.flags[tick] | np.where(saturated, int(SampleFlag.SATURATED), 0)
        bodies["counts"] = counts
        truth = np.empty(index.size, truth_dtype(self._n_sensors))
        truth["run"], truth["index"], truth["time_us"] = self.run, index, time_us
        truth["pressure_kpa"], truth["elongation_mm"], truth["signal_mv"] = rows[:, 0], rows[:, 1], rows[:, 2:]
        return SampleBlock(time_us, bodies, truth)

    def _bodies(self, n: int) -> NDArray[np.void]:
        return np.zeros(n, body_dtype(self._n_sensors))
