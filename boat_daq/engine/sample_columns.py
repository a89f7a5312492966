"""A block of samples as the control reads it: columns in the lab's units, made once and never changed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.snapshot import LastSample
from protocol.recording import NOT_FOR_FIGURES, BoardState, ExtraChannel, SampleFlag

_PRESSURE_UNKNOWN = int(SampleFlag.PRESSURE_INVALID)


@dataclass(frozen=True)
class Columns:
    """n samples in order of board time.

    `raw`: converter reading with the emitter on, counts; the signal where a board sends no counts [n, sensors].
    """

    time_us: NDArray[np.int64]  # board time, int64 [n]
    pressure_kpa: NDArray[np.float64]  # gauge pressure [n]
    signal_mv: NDArray[np.float64]  # (lit - dark) in mV [n, sensors]
    raw: NDArray[np.float64]
    state: NDArray[np.uint8]  # `BoardState` [n]
    flags: NDArray[np.uint16]  # `SampleFlag` [n]

    def __len__(self) -> int:
        return len(self.time_us)

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """Samples that may enter a figure [n]."""
        unusable: NDArray[np.bool_] = (self.flags & int(NOT_FOR_FIGURES)) != 0
        return ~unusable

    @cached_property
    def pressure_known(self) -> NDArray[np.bool_]:
        """Samples with a valid pressure [n]."""
        unknown: NDArray[np.bool_] = (self.flags & _PRESSURE_UNKNOWN) != 0
        return ~unknown & np.isfinite(self.pressure_kpa)

    def part(self, where: slice | NDArray[np.bool_]) -> Columns:
        """Return the samples there; those of a slice are not copied."""
        return Columns(*(getattr(self, each.name)[where] for each in fields(self)))


def mv_per_count(meta: Mapping[str, Any]) -> float:
    """Return mV of signal for one count, from a recording's `session`. 1 where the samples are signals in mV."""
    if meta["sample_kind"] != "counts" or not meta.get("vref_mv") or not meta.get("adc_bits"):
        return 1.0
    return float(meta["vref_mv"]) / (1 << int(meta["adc_bits"]))


def columns(samples: NDArray[np.void], mv_per_count: float) -> Columns:
    """Return a block of samples in the lab's units.

    `samples`: array of `protocol.recording.sample_dtype`. `mv_per_count`: vref_mv / 2**adc_bits; unused where the
    samples carry a signal.
    """
    if "signal_mv" in (samples.dtype.names or ()):
        raw = signal = samples["signal_mv"]
    else:
        raw = samples["lit"].astype(np.float64)
        signal = (raw - samples["dark"]) * mv_per_count
    return Columns(
        samples["time_us"], samples["pressure_pa"] / 1000.0, signal, raw, samples["state"], samples["flags"]
    )  # fmt: skip


def channel_values(samples: NDArray[np.void], channels: Sequence[ExtraChannel]) -> dict[str, NDArray[np.float64]]:
    """Return the values [n] of the extra channels of samples, by column."""
    return {channel.column: samples["channel"][:, i].astype(np.float64) for i, channel in enumerate(channels)}


def passed_us(block: Columns, before_us: int, longest_s: float) -> tuple[int, float]:
    """Return the board time from `before_us` to the end of a block, and its longest step in seconds.

    A step back, or one over `longest_s`, is another clock: no time passed in it.
    """
    steps = np.diff(block.time_us, prepend=before_us)
    return int(steps[(steps > 0) & (steps <= 1e6 * longest_s)].sum()), float(steps.max()) * 1e-6


def last_sample(block: Columns, target_kpa: float | None) -> LastSample:
    """Return the newest sample, its pressure nan where it is invalid; an unknown state is taken for FAULT."""
    state = int(block.state[-1])
    return LastSample(
        time_s=float(block.time_us[-1]) / 1e6,
        pressure_kpa=float(block.pressure_kpa[-1]) if block.pressure_known[-1] else math.nan,
        target_kpa=math.nan if target_kpa is None else target_kpa,
        signal_mv=tuple(block.signal_mv[-1].tolist()),
        state=BoardState(state) if state <= max(BoardState) else BoardState.FAULT,
        flags=SampleFlag(int(block.flags[-1])),
    )
