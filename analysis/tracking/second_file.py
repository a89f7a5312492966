"""When a second file of a run begins, by the cross-correlation that also places a video."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from analysis.tracking.clock import find_delay, find_place
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

NEARLY = 0.02  # correlations that differ by less are equal
COARSE_U_S = 0.1  # of a place that no ramp makes finer


def place_second(first: Mapping[str, FloatArray], second: Mapping[str, FloatArray]) -> tuple[float, float]:
    """Return when the second file begins in the time of the first, from its first row, s, and the standard uncertainty.

    Pressures are compared where both files have one, else the pressure with the first signal, of either sign. Raises
    DataError: nothing in the files follows one another.
    """
    one, two = _compared(first, second)
    begin_s, end_s = first["time_s"] - first["time_s"][0], second["time_s"] - second["time_s"][0]
    known = np.isfinite(one)
    found = []
    for sign in (1.0, -1.0):
        try:
            at_s = find_place(end_s, sign * two, begin_s[known], one[known])
        except DataError:
            continue
        found.append((*_alike(begin_s[known], one[known], end_s + at_s, sign * two), at_s, sign))
    if not found:
        cause = "the two files do not show one run: nothing in the second follows what the first shows"
        raise DataError(cause, "Give the files of one run, with dates in both, or map the columns that move together.")
    # half a cycle away the other sign is as much alike: then the longer overlap counts
    best = max(alike for alike, *_ in found)
    _, _, place_s, sign = max((entry for entry in found if entry[0] > best - NEARLY), key=lambda entry: entry[1])
    delay = find_delay(end_s + place_s, sign * two, begin_s[known], one[known, None])
    return (place_s, COARSE_U_S) if delay is None else (place_s - delay.delay_s, delay.u_s)


def _alike(time_s: FloatArray, values: FloatArray, own_s: FloatArray, others: FloatArray) -> tuple[float, int]:
    """Return the correlation of values with others where both are known, and how many rows that are."""
    inside = (time_s >= own_s[0]) & (time_s <= own_s[-1])
    known = np.isfinite(others)
    at = np.interp(time_s[inside], own_s[known], others[known])
    return float(np.corrcoef(values[inside], at)[0, 1]), int(inside.sum())


def _compared(first: Mapping[str, FloatArray], second: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    signals = [sorted(name for name in values if name.endswith("_mv")) for values in (first, second)]
    if "pressure_kpa" in first and "pressure_kpa" in second:
        return first["pressure_kpa"], second["pressure_kpa"]
    if "pressure_kpa" in first and signals[1]:
        return first["pressure_kpa"], second[signals[1][0]]
    if "pressure_kpa" in second and signals[0]:
        return first[signals[0][0]], second["pressure_kpa"]
    raise DataError("the two files have not both a pressure and a signal", "Map the columns.")
