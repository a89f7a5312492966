"""Arrays kept in the user's cache folder: the reduced model's table, and the fifteen states.

Rules: a file that cannot be read is computed again; a folder that cannot be written costs time, never the answer.
"""

from __future__ import annotations

import os
import struct
import tempfile
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from analysis.arrays import FloatArray

# what zipfile, zlib and numpy raise of a damaged cache: other versions, other methods, passwords, sizes beyond memory
UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, MemoryError, zlib.error, struct.error,
               zipfile.BadZipFile)  # fmt: skip


def cache_folder() -> Path:
    """Return the folder in which arrays are kept."""
    return platformdirs.user_cache_path("boat-daq") / "shadow"


def load_arrays(path: Path, names: tuple[str, ...]) -> dict[str, FloatArray] | None:
    """Return the named arrays of a file; None if there is none or it cannot be read."""
    with suppress(*UNREADABLE), path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
        return {name: kept[name] for name in names}
    return None


def keep_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write arrays, where the folder can be written, so that a reader sees all of them or nothing."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(dir=path.parent, suffix=".part")
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)
        Path(part).replace(path)
