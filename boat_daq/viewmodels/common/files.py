"""What kind of file the operator gives to the window: by its ending, a TOML file by its content."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from boat_daq.engine.plan import KINDS
from boat_daq.engine.toml_values import parse_toml, read_text
from protocol.base.errors import RequestError
from protocol.recording import SUFFIX

TABLE_SUFFIXES = (
    ".csv", ".tsv", ".txt", ".dat", ".log", ".lvm", ".xlsx", ".xls", ".ods", ".mat", ".h5", ".hdf5", ".parquet",
)  # fmt: skip
TABLE_KINDS = " ".join(ending[1:] for ending in TABLE_SUFFIXES)
OPENED = "Open a recording (.boat), a table (.csv, .xlsx, .mat \u2026), or a plan or a profile (.toml)."


class FileKind(Enum):
    """What a file is opened as."""

    RECORDING = "recording"
    TABLE = "table"
    PLAN = "plan"
    PROFILE = "profile"


def kind_of(path: Path) -> FileKind:
    if not path.is_file():
        raise RequestError(f"{path.name} {'is a folder' if path.is_dir() else 'does not exist'}", OPENED)
    suffix = path.suffix.lower()
    if suffix == SUFFIX:
        return FileKind.RECORDING
    if suffix in TABLE_SUFFIXES:
        return FileKind.TABLE
    if suffix == ".toml":
        content = parse_toml(read_text(path), path.name)
        if content.get("kind") in KINDS:
            return FileKind.PLAN
        if "device" in content:
            return FileKind.PROFILE
        raise RequestError(f"{path.name} is neither a plan nor a profile", "A plan has a kind, a profile a [device].")
    raise RequestError(f"{path.name} cannot be opened here", OPENED)
