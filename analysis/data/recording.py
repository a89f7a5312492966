"""A run as the analysis uses it: columns of one length, never changed.

A `.boat` file, a CSV or arrays in a test become one `Recording`: read-only columns in board time, the sequencer's steps
and the readings of elongation as frames, the session's metadata. Time is laid end to end over segments, in file order;
no sample is dropped, sorted, resampled or repaired. A value that is not finite, or whose flags mark it as no
measurement, is marked in `usable`, with a count by reason, and stays in the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.data.camera_record import CameraRecord
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import BoatDaqError, DataError
from protocol.base.optional import optional
from protocol.base.units import in_a_name
from protocol.recording import (
    NOT_FOR_FIGURES,
    ExtraChannel,
    Metadata,
    SampleFlag,
    session_channels,
)

GAP_FACTOR = 4.5  # without a running index, a hole is an interval longer than this many median intervals

STEP_COLUMNS = (
    "id", "segment", "number", "cycle", "branch", "target_kpa", "ramp_kpa_per_s", "started_s", "arrived_s",
    "settled_s", "ended_s", "status", "detail",
)  # fmt: skip
META_KEYS = (  # of the session, in the comments of an exported CSV
    "simulated", "unit", "operator", "note", "rate_hz", "vref_mv", "adc_bits", "board_id", "started_utc", "polarity",
    "customer", "item", "serial_number", "ambient_temperature_c", "ambient_humidity_percent",
)  # fmt: skip
READING_COLUMNS = ("id", "utc", "step", "elongation_mm", "resolution_mm", "source", "reader", "note")
_NO_READER = "no calibration was given: to_frame(reader=elongation_reader(analysis))"


@dataclass(frozen=True, slots=True)
class Gap:
    """Samples missing after row `row`: how many, and when (s, board time of the last sample before).

    `crc_failed` of them came in frames that failed their check, by the link's counter.
    """

    row: int
    lost: int
    time_s: float
    crc_failed: int = 0


class ElongationReader(Protocol):
    """What turns signals, [n, sensors] mV, into elongations: a `Fusion`, see `elongation_reader`."""

    def evaluate(self, signal_mv: FloatArray) -> Any:
        """Return `elongation_mm` and `standard_uncertainty_mm`, [n]."""

    @property
    def u_stand_in(self) -> str:
        """What U rests on besides the run; "" where it rests on the run."""


@dataclass(frozen=True, slots=True, repr=False)
class Recording:
    """One run. Arrays have one row a sample (n) and are read-only; `calibrator` gives `to_frame` the elongation."""

    time_s: FloatArray  # [n] board time from the first sample, segments laid end to end
    pressure_kpa: FloatArray  # [n] gauge
    target_kpa: FloatArray  # [n] gauge; NaN where none was set or known
    signal_mv: FloatArray  # [n, sensors] (lit - dark) * vref / 2^bits, or the signal itself if the device gives one
    lit: npt.NDArray[np.uint16] | None  # [n, sensors] ADC counts; None if the source has none
    dark: npt.NDArray[np.uint16] | None
    state: npt.NDArray[np.uint8]  # [n], see `protocol.recording`, as the next three
    flags: npt.NDArray[np.uint16]
    segment: IntArray
    index: IntArray
    usable: BoolArray  # [n, sensors] True where the signal may enter a figure
    pressure_usable: BoolArray  # [n] as `usable`
    masked: Mapping[str, int]  # number of rows left out, by reason
    interval_s: float  # median sampling interval, NaN below two samples
    gaps: tuple[Gap, ...]
    steps: pd.DataFrame  # with STEP_COLUMNS; empty if the source has none
    readings: pd.DataFrame  # with READING_COLUMNS
    meta: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    channel: FloatArray | None = None  # [n, channels] extra ones, each in its own unit, NaN where not measured
    camera: CameraRecord | None = None
    calibrator: Callable[[Recording], ElongationReader] | None = field(default=None, repr=False, compare=False)

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.time_s.size

    @property
    def n_sensors(self) -> int:
        """Number of sensors."""
        return int(self.signal_mv.shape[1])

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Column names of the sensors: s1, s2, ..."""
        return tuple(f"s{i + 1}" for i in range(self.n_sensors))

    @property
    def signal_columns(self) -> tuple[str, ...]:
        """Columns of the signals in a file: s1_mv, or s1_n of signals in N."""
        return tuple(f"{name}_{in_a_name(self.signal_unit) or 'signal'}" for name in self.sensor_names)

    @property
    def channels(self) -> tuple[ExtraChannel, ...]:
        """Names and units of the columns of `channel`."""
        return () if self.channel is None else session_channels(self.meta)

    @property
    def simulated(self) -> bool:
        """True where the run came from the virtual board."""
        return bool(self.meta.get("simulated", False))

    @property
    def unit(self) -> str:
        """Name of the unit, "" where it is not known."""
        return str(self.meta.get("unit") or "")

    @property
    def signal_unit(self) -> str:
        """Unit of the signals, in which `signal_mv` and every figure in mV are: mV unless an import states another."""
        return str(self.meta.get("signal_unit") or "mV")

    @property
    def identity(self) -> str:
        """Its UUID, which a renamed file keeps; the name of the file where it has none."""
        return str(self.meta.get("uuid") or Path(self.source).name)

    @property
    def started_utc(self) -> str:
        """When it was recorded, ISO 8601, "" where it is not known."""
        return str(self.meta.get("started_utc") or "")

    @property
    def metadata(self) -> Metadata:
        """Return the metadata of the session; raises DataError for a comment line of a table that cannot be."""
        try:
            return Metadata.of(self.meta)
        except ValueError as error:
            raise DataError(f"of its metadata {error}", "Correct the comment lines of the file.") from error

    @property
    def duration_s(self) -> float:
        """From the first sample to the last, board time."""
        return float(self.time_s[-1] - self.time_s[0]) if self.n > 1 else 0.0

    @property
    def rate_hz(self) -> float:
        """Effective rate: intervals inside segments over their time, losses counted as samples not there."""
        if self.n < 2:
            return float("nan")
        inside = np.diff(self.segment) == 0
        elapsed = float(np.diff(self.time_s)[inside].sum())
        return float(inside.sum() / elapsed) if elapsed > 0 else float("nan")

    @property
    def lost(self) -> int:
        """Samples known to be missing."""
        return sum(gap.lost for gap in self.gaps)

    @property
    def current_readings(self) -> pd.DataFrame:
        """The reading that counts for each step: the last one entered, also where it withdraws the one before."""
        return self.readings.sort_values("id").dropna(subset="step").drop_duplicates("step", keep="last")

    def __repr__(self) -> str:
        mark = "SIMULATED, " if self.simulated else ""
        name, size = Path(self.source).name or "arrays", f"{self.n} samples of {self.n_sensors} sensors"
        length = f"{self.duration_s:.1f} s at {self.rate_hz:.1f} Hz"
        return f"<Recording {name}: {mark}unit {self.unit or 'not named'}, {size}, {length}, {self.lost} lost>"

    def to_xarray(self, reader: ElongationReader | None = None) -> Any:
        """Return the samples as an `xarray.Dataset` over `time_s`, units as attributes. RequestError: no xarray."""
        frame = self.to_frame(reader=reader).set_index("time_s")
        found = optional("xarray").Dataset.from_dataframe(frame[~frame.index.duplicated()])
        for name, unit in frame.attrs["units"].items():
            found[name].attrs["units"] = unit
        found.attrs |= {"unit": self.unit, "simulated": int(self.simulated)}
        return found

    def to_frame(self, rows: slice | None = None, *, reader: ElongationReader | None = None) -> pd.DataFrame:
        """Return the samples, or some rows of them, in the columns and the order of the export.

        `attrs` of the frame hold `simulated`, `unit` (under test) and `units` (of measurement, by column). `reader`:
        gives the columns `elongation_mm` and `u_mm` (U, k = 2); default the calibration by the run's own readings, for
        all rows of a run of `load_recording`.
        """
        void = _NO_READER
        if reader is None and rows is None and self.calibrator is not None and len(self.readings):
            try:
                reader = self.calibrator(self)
            except BoatDaqError as error:
                void = error.cause
        first, last = ("index", "time_s", "pressure_kpa", "target_kpa"), ("state", "flags", "segment")
        frame: dict[str, Any] = {name: getattr(self, name) for name in first}
        for i, name in enumerate(self.signal_columns):
            frame[name] = self.signal_mv[:, i]
        if self.lit is not None and self.dark is not None:
            for i, name in enumerate(self.sensor_names):
                frame |= {f"{name}_lit": self.lit[:, i], f"{name}_dark": self.dark[:, i]}
        frame |= {name: getattr(self, name) for name in last}
        if self.channel is not None:
            frame |= {channel.column: self.channel[:, i] for i, channel in enumerate(self.channels)}
        columns = {name: column[rows or slice(None)] for name, column in frame.items()}
        if reader is not None:
            read = reader.evaluate(self.signal_mv[rows or slice(None)])
            columns |= {"elongation_mm": read.elongation_mm, "u_mm": 2.0 * read.standard_uncertainty_mm}
        found = pd.DataFrame(columns)
        found.attrs = {"simulated": self.simulated, "unit": self.unit, "units": self._units(found.columns)}
        found.attrs |= {"u_stand_in": reader.u_stand_in} if reader is not None else {"elongation_void": void}
        return found

    def _units(self, names: Iterable[str]) -> dict[str, str]:
        """Return the units of measurement of columns, by name."""
        by_ending = {"_s": "s", "_kpa": "kPa", "_mv": "mV", "_mm": "mm", "_lit": "counts", "_dark": "counts"}
        usual = {name: unit for name in names for ending, unit in by_ending.items() if name.endswith(ending)}
        others = {channel.column: channel.unit for channel in self.channels}
        signals = dict.fromkeys(self.signal_columns, self.signal_unit)
        return {name: unit for name, unit in (usual | others | signals).items() if unit}

    @classmethod
    def from_arrays(
        cls, time_s: npt.ArrayLike, pressure_kpa: npt.ArrayLike, signal_mv: npt.ArrayLike, **columns: Any
    ) -> Recording:
        """Build a recording from arrays: time and pressure [n], signals [n] or [n, sensors], and any other attributes.

        Other attributes are `target_kpa`, `lit`, `dark`, `state`, `flags`, `segment`, `index`, `channel` (with
        `channels` in `meta`), `steps`, `readings`, `meta`, `source`. Raises DataError without samples, or for columns
        of different length.
        """
        time = np.asarray(time_s, dtype=np.float64)
        signal = np.asarray(signal_mv, dtype=np.float64)
        signal = signal.reshape(signal.shape[0], -1) if signal.ndim else signal.reshape(1, 1)
        n = time.size
        _check_columns(n, {"pressure_kpa": pressure_kpa, "signal_mv": signal, **columns})
        pressure = np.asarray(pressure_kpa, dtype=np.float64)
        given = {name: column for name, column in columns.items() if column is not None}
        defaults = {"target_kpa": (np.nan, np.float64), "state": (0, np.uint8), "flags": (0, np.uint16),
                    "segment": (0, np.int64)}  # fmt: skip
        filled = {
            name: np.asarray(given.get(name, np.full(n, value)), dtype=kind) for name, (value, kind) in defaults.items()
        }
        index = np.asarray(given.get("index", np.arange(n)), dtype=np.int64)
        usable, pressure_usable, masked = _usable(time, pressure, signal, filled["flags"])
        frozen: dict[str, Any] = {name: _frozen(column) for name, column in filled.items()}
        return cls(
            time_s=_frozen(time), pressure_kpa=_frozen(pressure), signal_mv=_frozen(signal),
            **frozen,
            channel=_channel(columns.get("channel"), given.get("meta", {})),
            lit=_counts(columns.get("lit"), n), dark=_counts(columns.get("dark"), n), index=_frozen(index),
            usable=_frozen(usable), pressure_usable=_frozen(pressure_usable), masked=masked,
            interval_s=_typical_interval(time),
            gaps=find_gaps(time, filled["segment"], index if "index" in given else None),
            steps=given.get("steps", pd.DataFrame(columns=list(STEP_COLUMNS))),
            readings=given.get("readings", pd.DataFrame(columns=list(READING_COLUMNS))),
            meta=dict(given.get("meta", {})), source=str(given.get("source", "")),
        )  # fmt: skip


def find_gaps(time_s: FloatArray, segment: IntArray, index: IntArray | None) -> tuple[Gap, ...]:
    """Find the missing samples inside segments, of [n] times and segments.

    The running index gives the exact count; without one, an interval longer than `GAP_FACTOR` median intervals is a
    hole and the count is estimated from its length.
    """
    if time_s.size < 2:
        return ()
    inside = np.diff(segment) == 0
    if index is not None:
        lost = np.diff(index) - 1
        rows = np.flatnonzero(inside & (lost > 0))
        return tuple(Gap(int(r), int(lost[r]), float(time_s[r])) for r in rows)
    intervals = np.diff(time_s)
    typical = float(np.median(intervals))
    if not typical > 0:
        return ()
    rows = np.flatnonzero(inside & (intervals > GAP_FACTOR * typical))
    return tuple(Gap(int(r), round(float(intervals[r]) / typical) - 1, float(time_s[r])) for r in rows)


def _usable(
    time: FloatArray, pressure: FloatArray, signal: FloatArray, flags: npt.NDArray[np.uint16]
) -> tuple[BoolArray, BoolArray, dict[str, int]]:
    bad_pressure = ~np.isfinite(pressure) | ~np.isfinite(time)
    flagged = (flags & int(NOT_FOR_FIGURES)) != 0
    bad_signal = ~np.isfinite(signal)
    # a saturated ADC does not invalidate the pressure of that row
    pressure_usable = ~bad_pressure & ((flags & int(NOT_FOR_FIGURES & ~SampleFlag.SATURATED)) == 0)
    usable = pressure_usable[:, None] & ~bad_signal & ~flagged[:, None]
    masked = {
        "pressure_not_finite": int(bad_pressure.sum()),
        "signal_not_finite": int(bad_signal.any(axis=1).sum()),
    }
    for flag in ("SATURATED", "PRESSURE_INVALID", "IMPLAUSIBLE"):
        masked[flag.lower()] = int(((flags & SampleFlag[flag]) != 0).sum())
    return usable, pressure_usable, masked


def _typical_interval(time_s: FloatArray) -> float:
    intervals = np.diff(time_s)
    intervals = intervals[intervals > 0]
    return float(np.median(intervals)) if intervals.size else float("nan")


def _check_columns(n: int, columns: Mapping[str, Any]) -> None:
    if n == 0:
        raise DataError("the run holds no samples", "Check that the board was streaming when it was recorded.")
    for name, column in columns.items():
        if name in ("steps", "readings", "meta", "source") or column is None:
            continue
        if len(column) != n:
            raise DataError(f"column {name} has {len(column)} rows where time_s has {n}", "Give columns of one length.")


def _channel(column: Any, meta: Mapping[str, Any]) -> FloatArray | None:
    """Return the extra channels [n, channels]; None without any."""
    names = session_channels(meta)
    if column is None or not names:
        return None
    values = np.asarray(column, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != len(names):
        cause = f"channel has the shape {values.shape} for {len(names)} channels"
        raise DataError(cause, "Give a column for each of meta['channels'].")
    return _frozen(np.where(np.isfinite(values), values, np.nan))


def _counts(column: Any, n: int) -> npt.NDArray[np.uint16] | None:
    return None if column is None else _frozen(np.asarray(column, dtype=np.uint16).reshape(n, -1))


def _frozen(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view
