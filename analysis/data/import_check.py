"""An imported recording derived again from the bytes of the file that it was imported from.

Rules: the kept bytes and the kept column map are all that is used; the samples must come out bit for bit.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from analysis.data.boat_file import opened
from analysis.data.boat_writer import packed_samples
from analysis.data.csv_import import import_csv
from analysis.errors import FileError
from protocol.recording import dtype_from_description, read_session


def is_imported(path: str | Path) -> bool:
    """True where a recording came from a CSV."""
    with opened(Path(path)) as db:
        return str(read_session(db).get("port") or "").startswith("import:")


def first_difference(path: str | Path) -> str:
    """Import the kept bytes again and compare the samples.

    Returns
    -------
    "" where they are identical, else a text naming the first difference.

    Raises
    ------
    FileError : the recording was not imported.
    """
    path = Path(path)
    if not is_imported(path):
        raise FileError(f"{path.name} was not imported", "Use `boat-daq verify`.")
    with opened(path) as db:
        meta = read_session(db)
        original = b"".join(raw for (raw,) in db.execute("SELECT raw FROM chunk WHERE direction = 0 ORDER BY id"))
        blobs = [blob for (blob,) in db.execute("SELECT samples FROM block ORDER BY id")]
    kept = np.frombuffer(b"".join(blobs), dtype_from_description(meta["sample_dtype"]))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "original.csv"
        file.write_bytes(original)
        again = packed_samples(import_csv(file, columns=meta["import_map"], rate_hz=meta.get("import_rate_hz")))
    if again.dtype != kept.dtype or again.size != kept.size:
        return f"the file gives {again.size} samples where {kept.size} are kept"
    different = np.flatnonzero(again != kept)
    return f"sample {int(different[0])} differs from the file it was imported from" if different.size else ""
