"""Samples out of a recording: CSV with a JSON sidecar, or Parquet.

Rules: every column's name carries its unit; numbers are written so that reading them gives the same number; text that
a spreadsheet would take for a formula is neutralised; a simulated run is marked SIMULATED in the file itself. What is
written is read again by `analysis.data.csv_import` without a map. An export that is cancelled leaves no file, and the
one before as it was.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from analysis.data.recording import META_KEYS, Recording
from analysis.errors import RequestError, writing
from analysis.optional import optional
from analysis.progress import Progress
from protocol.whole_file import write_whole, written_whole

Format = Literal["csv", "parquet"]

ROWS_AT_ONCE = 100_000


def samples_frame(recording: Recording, rows: slice | None = None) -> pd.DataFrame:
    """Return the samples as a frame, in the columns and the order of the export."""
    first, last = ("index", "time_s", "pressure_kpa", "target_kpa"), ("state", "flags", "segment")
    frame: dict[str, Any] = {name: getattr(recording, name) for name in first}
    for i, name in enumerate(recording.sensor_names):
        frame[f"{name}_mv"] = recording.signal_mv[:, i]
    if recording.lit is not None and recording.dark is not None:
        for i, name in enumerate(recording.sensor_names):
            frame |= {f"{name}_lit": recording.lit[:, i], f"{name}_dark": recording.dark[:, i]}
    frame |= {name: getattr(recording, name) for name in last}
    return pd.DataFrame({name: column[rows or slice(None)] for name, column in frame.items()})


def export(recording: Recording, path: str | Path, format: Format, *, progress: Progress | None = None) -> list[Path]:
    """Write the samples.

    Parameters
    ----------
    recording : to export.
    path : of the file.
    format : "csv" or "parquet".
    progress : called as progress(done, total) for CSV; raising from it cancels.

    Returns
    -------
    The files written: for CSV also the sidecar, `PATH` with .json.

    Raises
    ------
    RequestError : another format, or Parquet without pyarrow. FileError : the folder is not there or cannot be written.
    """
    path = Path(path)
    if format not in ("csv", "parquet"):
        raise RequestError(f"format {format!r} is not one of csv, parquet", "Give --format csv or --format parquet.")
    with writing(path, "Choose another folder."):
        if format == "parquet":
            with written_whole(path) as part:
                _write_parquet(recording, part)
            return [path]
        sidecar = path.with_suffix(".json")
        with written_whole(path) as part:
            _write_csv(recording, part, progress)
        write_whole(sidecar, json.dumps(_description(recording), indent=2, default=str) + "\n")
        return [path, sidecar]


def _write_csv(recording: Recording, path: Path, progress: Progress | None) -> None:
    with path.open("w", encoding="utf-8", errors="replace", newline="") as file:
        if recording.simulated:
            file.write("# SIMULATED: recorded from the virtual board\n")
        for key in META_KEYS:
            if recording.meta.get(key) is not None:
                file.write(_comment(f"{key}: {json.dumps(recording.meta[key], ensure_ascii=False)}"))
        for first in range(0, recording.n, ROWS_AT_ONCE):
            part = samples_frame(recording, slice(first, first + ROWS_AT_ONCE))
            part.to_csv(file, index=False, header=first == 0, lineterminator="\n", quoting=csv.QUOTE_MINIMAL)
            if progress is not None:
                progress(min(first + ROWS_AT_ONCE, recording.n), recording.n)


def _comment(text: str) -> str:
    """Return a comment line. A comma would begin a cell, and so perhaps a formula; the sidecar has the exact text."""
    return "# " + " ".join(text.replace(",", ";").split()) + "\n"


def _write_parquet(recording: Recording, path: Path) -> None:
    pa, pq = optional("pyarrow"), optional("pyarrow.parquet")
    table = pa.Table.from_pandas(samples_frame(recording), preserve_index=False)
    description = {"boat_daq": json.dumps(_description(recording), default=str)}
    if recording.simulated:
        description["SIMULATED"] = "recorded from the virtual board"
    pq.write_table(table.replace_schema_metadata({**(table.schema.metadata or {}), **description}), path)


def _description(recording: Recording) -> dict[str, Any]:
    meta = {key: value for key, value in recording.meta.items() if key != "sample_dtype"}
    return {
        "SIMULATED": recording.simulated,
        "samples": recording.n,
        "duration_s": recording.duration_s,
        "rate_hz": recording.rate_hz if np.isfinite(recording.rate_hz) else None,
        "gaps": [{"time_s": gap.time_s, "lost": gap.lost} for gap in recording.gaps],
        "masked": dict(recording.masked),
        "columns": {name: _unit(name) for name in samples_frame(recording, slice(0, 1)).columns},
        "session": meta,
        "steps": json.loads(recording.steps.to_json(orient="records")),
        "readings": json.loads(recording.readings.to_json(orient="records")),
    }


def _unit(name: str) -> str:
    if name in ("index", "state", "flags", "segment"):
        return "1"
    return {"s": "s", "kpa": "kPa", "mv": "mV", "lit": "ADC counts", "dark": "ADC counts"}[name.rpartition("_")[2]]
