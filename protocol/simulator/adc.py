"""The ADC front end: from a sensor's signal to two counts, with ambient light, noise and quantisation.

The board reads each sensor with its emitter off (dark) and, 50 us later, on (lit); the host subtracts. Both readings
contain the ambient light: a level, the mains' flicker, and the contribution of faults. Noise is divided between the two
so that a sample's signal has the specimen's noise, quantisation included. It is a function of the sample's number,
drawn in fixed blocks, so that a stream does not depend on how it was divided.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import FloatArray
from protocol.simulator.specimens import SpecimenSensor

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
    """Standard normal and uniform numbers as a function of the sample number: the same for any slicing.

    A row is: pressure, then (lit, dark) of each sensor; the uniform number is for the jitter.

    Parameters
    ----------
    seed : of the board.
    run : number of its START.
    n_sensors : number of sensors.
    """

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
        """Return counts, shape (n, sensors, 2), the last axis (lit, dark).

        Parameters
        ----------
        signal_mv : without noise, shape (n, sensors).
        time_us : board time of each sample, shape (n,).
        noise : standard normal numbers, shape (n, sensors, 2).
        faults : the active ones, name -> value.
        since_us : board time at which `ambient_ramp` began.
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
