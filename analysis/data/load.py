"""Load a run from any file that it may be in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from analysis.data.boat_file import is_boat_file, read_boat_file
from analysis.data.csv_import import import_csv
from analysis.data.recording import Recording
from protocol.base.errors import FileError, RequestError
from protocol.recording import SUFFIX


def load_recording(path: str | Path, **import_options: Any) -> Recording:
    """Load a run from a `.boat` file, or from a CSV by the options of `csv_import.import_csv`; the file is only read.

    Raises FileError if it does not exist, or is of another kind; RequestError for a column map of a recording.
    """
    if not isinstance(path, str | Path):
        cause = f"a run is a path or a Recording, not a {type(path).__name__}"  # type: ignore[unreachable]  # untyped calls
        raise RequestError(cause, "From arrays: Recording.from_arrays(time_s, pressure_kpa, signal_mv).")
    path = Path(path)
    if not path.is_file():
        raise FileError(f"{path} does not exist" if not path.exists() else f"{path} is not a file", "Check the name.")
    if is_boat_file(path):
        if any(value is not None for value in import_options.values()):
            raise RequestError(f"{path.name} is a recording: its columns are known", "Leave out --map and --rate.")
        return read_boat_file(path)
    if path.suffix == SUFFIX:
        raise FileError(f"{path.name} is not a boat-daq recording, or the copy is incomplete", "Copy the file again.")
    return import_csv(path, **import_options)
