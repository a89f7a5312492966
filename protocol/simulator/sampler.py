"""The virtual board's sampling: its instants, and the content of each SAMPLE.

Instant n of a run is at start + floor(n / rate), whether it is sent or not; between the plant's ticks values are
interpolated. Each sensor is read with its emitter off (dark) and, 50 us later, on (lit); both contain the ambient
light: a level, the mains' flicker, and faults. Noise, divided between the two so that the signal has the specimen's
noise with quantisation, is a function of the sample's number, so that a stream does not depend on its division.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.base.arrays import FloatArray, IntArray
from protocol.recording import SampleFlag
from protocol.simulator.plant import TICK_US
from protocol.simulator.sample_frames import body_dtype
from protocol.simulator.specimens import Specimen, SpecimenSensor

Counts = NDArray[np.uint16]

VREF_MV = 3300
ADC_BITS = 12
LSB_MV = VREF_MV / 2**ADC_BITS
FULL_SCALE = 2**ADC_BITS - 1

AMBIENT_MV = 120.0
FLICKER_MV = 5.0
LIT_AFTER_US = 50
_DARK_NOISE_MV = 0.5
_FLICKER_PERIOD_US = 9_996  # twice the mains' frequency, which is never exactly 50 Hz
_FLICKER = np.sin(2 * np.pi * np.arange(_FLICKER_PERIOD_US) / _FLICKER_PERIOD_US)
_RAMP_TOP_MV = 600.0
_SATURATING_MV = 4000.0
PRESSURE_NOISE_PA = 40.0

_BLOCK = 1024


class SampleNoise:
    """Noise by sample number: standard normal (pressure, lit and dark of each sensor), uniform for the jitter."""

    def __init__(self, seed: int, run: int, n_sensors: int) -> None:
        self._key = (seed, run)
        self._columns = 1 + 2 * n_sensors
        self._number = -1
        self._normal: FloatArray = np.empty((0, 0))
        self._uniform: FloatArray = np.empty(0)

    def rows(self, first: int, count: int) -> tuple[FloatArray, FloatArray]:
        """Return normal numbers, shape (count, 1 + 2 sensors), and uniform ones, shape (count,)."""
        parts = []
        index, end = first, first + count
        while index < end:
            number, offset = divmod(index, _BLOCK)
            if number != self._number:
                generator = np.random.default_rng((*self._key, number))
                self._normal = generator.standard_normal((_BLOCK, self._columns))
                self._uniform = generator.random(_BLOCK)
                self._number = number
            part = slice(offset, min(_BLOCK, offset + end - index))
            parts.append((self._normal[part], self._uniform[part]))
            index += part.stop - part.start
        if not parts:
            return np.empty((0, self._columns)), np.empty(0)
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


class FrontEnd:
    """Emitter, receiver and converter of each sensor."""

    def __init__(self, sensors: tuple[SpecimenSensor, ...]) -> None:
        quantisation = LSB_MV**2 / 12
        dark = [_DARK_NOISE_MV] * len(sensors)
        lit = [(s.noise_mv**2 - _DARK_NOISE_MV**2 - 2 * quantisation) ** 0.5 for s in sensors]
        self._noise_mv = np.array([lit, dark]).T  # (sensors, 2)
        self._frozen: dict[int, Counts] = {}

    def convert(
        self,
        signal_mv: FloatArray,
        time_us: NDArray[np.int64],
        noise: FloatArray,
        faults: Mapping[str, float],
        since_us: int,
    ) -> Counts:
        """Return counts [n, sensors, (lit, dark)].

        `signal_mv`: signal without noise, [n, sensors]. `time_us`: board time of each sample, [n]. `noise`: standard
        normal numbers, [n, sensors, 2]. `since_us`: board time at which `ambient_ramp` began.
        """
        n, sensors = signal_mv.shape
        reading_mv = noise * self._noise_mv
        for column, delay_us in ((0, LIT_AFTER_US), (1, 0)):
            reading_mv[:, :, column] += _ambient_mv(time_us + delay_us, faults, since_us)[:, None]
        if "sensor_disagreement" in faults:
            signal_mv = signal_mv + np.eye(sensors)[-1] * faults["sensor_disagreement"]
        reading_mv[:, :, 0] += signal_mv
        if "saturate" in faults:
            reading_mv[:, _sensor(faults["saturate"], sensors), :] += _SATURATING_MV
        counts: Counts = np.clip(np.rint(reading_mv / LSB_MV), 0, FULL_SCALE).astype(np.uint16)
        if "frozen_channel" in faults:
            if n:
                number = _sensor(faults["frozen_channel"], sensors)
                counts[:, number] = self._frozen.setdefault(number, counts[0, number].copy())
        else:
            self._frozen.clear()
        return counts


def _ambient_mv(time_us: NDArray[np.int64], faults: Mapping[str, float], since_us: int) -> FloatArray:
    flicker = faults.get("flicker", FLICKER_MV)
    ambient = AMBIENT_MV + flicker + flicker * _FLICKER[time_us % _FLICKER_PERIOD_US]
    ambient += faults.get("ambient_step", 0.0)
    if "ambient_ramp" in faults:
        ambient += np.minimum(faults["ambient_ramp"] * (time_us - since_us) / 1e6, _RAMP_TOP_MV)
    return np.asarray(ambient, dtype=np.float64)


def _sensor(number: float, sensors: int) -> int:
    """Return the index of a sensor numbered from 1; a number out of range means the nearest."""
    return min(max(int(number), 1), sensors) - 1


def truth_dtype(n_sensors: int) -> np.dtype[np.void]:
    """Return the record of a sample's true values; `run` counts the STARTs from 1 and, with `index`, names it."""
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
        """Return the samples up to and with `stop_us`; `since_us`: starts of the faults."""
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
