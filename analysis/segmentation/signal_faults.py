"""Signals that are no measurement although no flag marks them: clipped at a rail, frozen, dropped out.

    frozen     exactly one value while the pressure moves by more than a tenth of its span
    clipped    the signal's highest or lowest value, held far longer than the signal ever holds another; or within
               three counts of it while the pressure moves by what changes the signal by many before and after
    dropped    a jump away and back, of more than a quarter of the span each, while the pressure does not jump;
               or such a jump of the pressure itself

Only `usable` and `masked` of the recording change. A signal that never changes is left alone: its figures are void.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.data.recording import Recording
from analysis.segmentation.cycles import pressure_drop_outs
from protocol.base.arrays import BoolArray, FloatArray, IntArray

FROZEN_SHARE, FROZEN_KPA = 0.1, 1.0  # of the span of the pressure, and what is a movement at all
CLIPPED_RUN, LONGER = 10, 5  # samples at a rail, and how much longer than the runs at other values
DITHER_COUNTS, MOVED_SHARE = 3, 0.1  # counts at a rail; share of the span that the pressure moves meanwhile
STEEPER = 5.0  # how much more the signal changes beside the rail
DROP_SHARE, _MAX_DROP_OUT = 0.25, 50  # of the signal's span; samples, where the dropped value is not constant
JUMP_SD = 8.0  # of the signal's usual step from sample to sample: what noise alone does not do


def mask_faulty_signals(recording: Recording, smooth_kpa: FloatArray) -> Recording:
    """Leave clipped, frozen and dropped samples out of the figures, by the smooth pressure; count them by reason."""
    recording = _without_drop_outs_of_pressure(recording)
    usable = recording.usable.copy()
    rows = {name: np.zeros(recording.n, dtype=bool) for name in ("clipped", "frozen", "dropped_out")}
    for sensor in range(recording.n_sensors):
        for name, found in _faults(recording.signal_mv[:, sensor], usable[:, sensor], smooth_kpa).items():
            rows[name] |= found & usable[:, sensor]
            usable[:, sensor] &= ~found
    counts = {name: int(found.sum()) for name, found in rows.items()}
    if not any(counts.values()):
        return replace(recording, masked={**recording.masked, **counts})
    usable.flags.writeable = False
    return replace(recording, usable=usable, masked={**recording.masked, **counts})


def _without_drop_outs_of_pressure(recording: Recording) -> Recording:
    """Rows whose pressure jumps away and back are left out like rows without one: they would cut a hold in two."""
    dropped = pressure_drop_outs(recording.pressure_kpa, recording.pressure_usable)
    masked = {**recording.masked, "pressure_dropped_out": int(dropped.sum())}
    if not dropped.any():
        return replace(recording, masked=masked)
    pressure_usable, usable = recording.pressure_usable & ~dropped, recording.usable & ~dropped[:, None]
    pressure_usable.flags.writeable = usable.flags.writeable = False
    return replace(recording, pressure_usable=pressure_usable, usable=usable, masked=masked)


def _faults(y: FloatArray, usable: BoolArray, p: FloatArray) -> dict[str, BoolArray]:
    none = np.zeros(y.size, dtype=bool)
    known = y[usable]
    if y.size < 4 * CLIPPED_RUN or known.size < CLIPPED_RUN or np.ptp(known) == 0:
        return {"clipped": none, "frozen": none, "dropped_out": none}
    edges = np.concatenate([[0], np.flatnonzero(y[1:] != y[:-1]) + 1])  # NaN differs from everything
    lengths = np.diff(np.append(edges, y.size))
    moved = np.fmax.reduceat(p, edges) - np.fmin.reduceat(p, edges)
    frozen = np.repeat(moved > max(FROZEN_SHARE * float(np.ptp(p)), FROZEN_KPA), lengths)
    dropped = _dropped(y, p, edges, lengths, float(np.ptp(np.percentile(known, [1, 99])))) & ~frozen
    clipped = _clipped(y, usable & ~dropped, edges, lengths)
    clipped |= _dithered(y, usable & ~dropped & ~clipped, p)
    return {"dropped_out": dropped, "clipped": clipped, "frozen": frozen}


def _clipped(y: FloatArray, usable: BoolArray, edges: IntArray, lengths: IntArray) -> BoolArray:
    """Rows at the highest or lowest value where it is held in runs that no value in between comes near."""
    found = np.zeros(y.size, dtype=bool)
    if not usable.any():
        return found
    level, known = y[edges], usable[edges]
    for rail in (float(y[usable].max()), float(y[usable].min())):
        at_rail = known & (level == rail)
        others = lengths[known & ~at_rail]
        usual = float(np.percentile(others, 99)) if others.size else 0.0
        long = at_rail & (lengths >= max(CLIPPED_RUN, LONGER * usual))
        if long.any() and usual < CLIPPED_RUN:
            found |= usable & (y == rail)
    return found


def _dithered(y: FloatArray, usable: BoolArray, p: FloatArray) -> BoolArray:
    """Rows within a few counts of the highest or lowest value, where the pressure moved and the signal did not."""
    found = np.zeros(y.size, dtype=bool)
    values = np.unique(y[usable])
    if not 3 * DITHER_COUNTS < values.size < usable.sum() / 3:
        return found  # not in counts, or too few of them
    band, moved_kpa = DITHER_COUNTS * float(np.diff(values).min()), MOVED_SHARE * float(np.ptp(p))
    for rail in (float(values[0]), float(values[-1])):
        inside = usable & (np.abs(y - rail) <= 1.001 * band)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.view(np.int8), [0]])))
        for first, last in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
            if last - first < CLIPPED_RUN or np.ptp(p[first : last + 1]) < moved_kpa:
                continue
            before = np.flatnonzero(np.abs(p[:first] - p[first]) >= moved_kpa)
            after = np.flatnonzero(np.abs(p[last + 1 :] - p[last]) >= moved_kpa)
            ends = [*before[-1:].tolist(), *(last + 1 + after[:1]).tolist()]
            if any(abs(y[end] - rail) >= STEEPER * band for end in ends):
                found[first : last + 1] |= inside[first : last + 1]
    return found


def _dropped(y: FloatArray, p: FloatArray, edges: IntArray, lengths: IntArray, span: float) -> BoolArray:
    """Rows between a jump and the jump back: short, or exactly constant, while the pressure makes no jump."""
    found = np.zeros(y.size, dtype=bool)
    steps = np.diff(np.where(np.isfinite(y), y, np.nan))
    usual = 1.4826 * float(np.nanmedian(np.abs(steps))) if np.isfinite(steps).any() else 0.0
    jump = max(DROP_SHARE * span, JUMP_SD * usual)
    at = np.flatnonzero(np.abs(steps) > jump) if span > 0 else np.empty(0, dtype=np.int64)
    at = at[np.abs(np.diff(p)[at]) < 0.05 * max(float(np.ptp(p)), 1e-12)]
    k = 0
    while k + 1 < at.size:
        out, back = int(at[k]), int(at[k + 1])
        returns = steps[out] * steps[back] < 0 and abs(steps[back]) > 0.5 * abs(steps[out])
        run = int(np.searchsorted(edges, out + 1, side="right")) - 1
        constant = edges[run] == out + 1 and lengths[run] == back - out
        if returns and (constant or back - out <= _MAX_DROP_OUT):
            found[out + 1 : back + 1] = True
            k += 1
        k += 1
    # what fills more of the run than faults do is the signal itself: a square wave, seldom sampled
    return found if found.mean() <= 0.3 else np.zeros_like(found)
