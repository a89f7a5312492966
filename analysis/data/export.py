"""Samples out of a recording, with elongation and its uncertainty where a calibration gives them.

CSV (one header row) with a JSON sidecar, Parquet, HDF5 (a dataset a column, over the dimension time_s), or MAT (a
vector a column, MATLAB 5). Every column's name carries its unit; numbers read back are the same; a simulated run is
marked in the file itself, in CSV by a column. `analysis.data.csv_import` reads them without a map. A cancelled export
leaves the file before as it was.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from analysis.data.recording import Recording
from analysis.data.ros_bag import write_bag
from analysis.progress import Progress
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import RequestError, writing
from protocol.base.optional import optional
from protocol.base.whole_file import write_whole, written_whole

Format = Literal["csv", "parquet", "hdf5", "mat", "rosbag", "rosbag-sqlite3"]
SUFFIXES: Mapping[str, Format] = {".csv": "csv", ".parquet": "parquet", ".h5": "hdf5", ".hdf5": "hdf5", ".mat": "mat"}

BAGS: Mapping[str, str] = {"rosbag": "mcap", "rosbag-sqlite3": "sqlite3"}  # storage of each

_ROWS_AT_ONCE = 100_000


@dataclass(frozen=True, slots=True)
class ConvertedElongation:
    """The elongation of every sample [n], u_mm with k = 2; `valid` is False if unknown or the sensors disagree."""

    elongation_mm: FloatArray
    u_mm: FloatArray
    valid: BoolArray
    calibration: Mapping[str, Any]

    @property
    def marks(self) -> dict[str, int]:
        """The column that marks U where it rests on a stated stand-in; none where it rests on the run."""
        return {"u_stand_in": 1} if self.calibration.get("u_stand_in") else {}


def samples_frame(
    recording: Recording, rows: slice | None = None, converted: ConvertedElongation | None = None
) -> pd.DataFrame:
    """Return the samples, or some `rows`, as a frame, in the columns and the order of the export."""
    frame = recording.to_frame(rows)
    if recording.camera is not None:
        frame["camera_mm"], _, frame["camera_u_mm"] = recording.camera.at(frame["time_s"].to_numpy())
    if converted is not None:
        where = rows or slice(None)
        frame["elongation_mm"], frame["u_mm"] = converted.elongation_mm[where], converted.u_mm[where]
        frame["elongation_valid"] = converted.valid[where].astype(np.uint8)
        frame = frame.assign(**converted.marks)
    return frame


def require_library(format: str) -> None:
    """Raise RequestError with the extra to install if the library of a format is missing."""
    if format in _LIBRARIES:
        optional(_LIBRARIES[format])


def export(
    recording: Recording,
    path: str | Path,
    format: Format,
    *,
    converted: ConvertedElongation | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Write the samples and return the files: for CSV also the sidecar, `PATH` with .json.

    `format` is csv, parquet, hdf5, mat, rosbag (MCAP storage) or rosbag-sqlite3. Raises RequestError for another, or a
    missing library; FileError if the folder cannot be written.
    """
    path = Path(path)
    if format not in ("csv", *_WRITERS, *BAGS):
        known = ", ".join(("csv", *_WRITERS, *BAGS))
        raise RequestError(f"format {format!r} is not one of {known}", "Give one of them.")
    if format in BAGS:
        frame, about = samples_frame(recording, None, converted), _description(recording, converted)
        with writing(path):
            write_bag(frame, json.loads(_description_text(about)), path, BAGS[format], progress)
        return [path]
    with writing(path):
        with written_whole(path) as part:
            if format == "csv":
                _write_csv(recording, part, converted, progress)
            else:
                _WRITERS[format](samples_frame(recording, None, converted), _description(recording, converted), part)
        if format != "csv":
            return [path]
        sidecar, text = path.with_suffix(".json"), _description_text(_description(recording, converted), indent=2)
        write_whole(sidecar, text + "\n")
        return [path, sidecar]


def _write_csv(
    recording: Recording, path: Path, converted: ConvertedElongation | None, progress: Progress | None
) -> None:
    with path.open("w", encoding="utf-8", errors="replace", newline="") as file:
        for first in range(0, recording.n, _ROWS_AT_ONCE):
            part = samples_frame(recording, slice(first, first + _ROWS_AT_ONCE), converted)
            if recording.simulated:
                part["simulated"] = 1
            if first == 0:  # what is missing in the first row is NaN: polars takes columns that begin empty as text
                part.iloc[:1].to_csv(file, index=False, na_rep="NaN", lineterminator="\n")
            part.iloc[int(first == 0) :].to_csv(file, index=False, header=False, lineterminator="\n")
            if progress is not None:
                progress(min(first + _ROWS_AT_ONCE, recording.n), recording.n)


def _write_parquet(frame: pd.DataFrame, description: Mapping[str, Any], path: Path) -> None:
    pa, pq = optional("pyarrow"), optional("pyarrow.parquet")
    table = pa.Table.from_pandas(frame, preserve_index=False)
    stated = {"boat_daq": _description_text(description)}
    if description["SIMULATED"]:
        stated["SIMULATED"] = "recorded from the virtual board"
    pq.write_table(table.replace_schema_metadata({**(table.schema.metadata or {}), **stated}), path)


def _write_hdf5(frame: pd.DataFrame, description: Mapping[str, Any], path: Path) -> None:
    with optional("h5py").File(path, "w", libver=("earliest", "v110")) as file:
        file.attrs["SIMULATED"] = bool(description["SIMULATED"])
        file.create_dataset("boat_daq", data=_description_text(description))  # an attribute has 64 KiB at most
        for name, unit in description["columns"].items():
            values = frame[name].to_numpy()
            dataset = file.create_dataset(name, data=values, compression="gzip", compression_opts=4, shuffle=True)
            dataset.attrs["units"] = dataset.attrs["unit"] = unit
        file["time_s"].make_scale("time_s")
        for name in description["columns"]:
            if name != "time_s":
                file[name].dims[0].attach_scale(file["time_s"])


def _write_mat(frame: pd.DataFrame, description: Mapping[str, Any], path: Path) -> None:
    from scipy.io import savemat

    columns = {name: frame[name].to_numpy() for name in frame.columns}
    units = dict(description["columns"])
    stated = {"units": units, "SIMULATED": bool(description["SIMULATED"]), "boat_daq": _description_text(description)}
    savemat(str(path), columns | stated, appendmat=False, long_field_names=True, do_compression=True, oned_as="column")


_LIBRARIES = {"parquet": "pyarrow", "hdf5": "h5py", "rosbag": "rosbags", "rosbag-sqlite3": "rosbags"}
_WRITERS: Mapping[str, Callable[[pd.DataFrame, Mapping[str, Any], Path], None]] = {
    "parquet": _write_parquet,
    "hdf5": _write_hdf5,
    "mat": _write_mat,
}


def _description(recording: Recording, converted: ConvertedElongation | None) -> dict[str, Any]:
    meta = {key: value for key, value in recording.meta.items() if key != "sample_dtype"}
    frame = samples_frame(recording, slice(0, 1), converted)
    units = {channel.column: channel.unit or "1" for channel in recording.channels}
    units |= dict.fromkeys(recording.signal_columns, recording.signal_unit)
    return {
        "SIMULATED": recording.simulated,
        "samples": recording.n,
        "duration_s": recording.duration_s,
        "rate_hz": recording.rate_hz if np.isfinite(recording.rate_hz) else None,
        "gaps": [{"time_s": gap.time_s, "lost": gap.lost} for gap in recording.gaps],
        "masked": dict(recording.masked),
        "columns": {name: units.get(name) or _unit(name) for name in frame.columns},
        "calibration": None if converted is None else dict(converted.calibration),
        "session": meta,
        "steps": json.loads(recording.steps.to_json(orient="records")),
        "readings": json.loads(recording.readings.to_json(orient="records")),
    }


def _description_text(description: Mapping[str, Any], indent: int | None = None) -> str:
    return json.dumps(description, indent=indent, default=str)


def _unit(name: str) -> str:
    if name in ("index", "state", "flags", "segment", "elongation_valid", "u_stand_in"):
        return "1"
    units = {"s": "s", "kpa": "kPa", "mv": "mV", "mm": "mm", "lit": "ADC counts", "dark": "ADC counts"}
    return units[name.rpartition("_")[2]]
