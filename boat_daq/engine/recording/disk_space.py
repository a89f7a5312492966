"""The disk space that a recording needs, checked before it begins."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from protocol.base.errors import StorageError
from protocol.recording import sample_dtype

SPACE_FLOOR_BYTES = 32 * 2**20  # below this a recording is ended while it can still be closed
_WIRE_BYTES = 26  # of a SAMPLE frame beside its sensors: COBS, head, CRC, delimiter
_ROW_BYTES = 40  # SQLite's share of a chunk row, when every sample comes in its own
_MARGIN = 1.25  # events, health, the write-ahead log


def bytes_per_second(rate_hz: float, n_sensors: int) -> float:
    """Return what a recording grows by: raw bytes, samples, and the rows around them."""
    return rate_hz * (_WIRE_BYTES + 4 * n_sensors + sample_dtype(n_sensors).itemsize + _ROW_BYTES) * _MARGIN


def check_space(folder: Path, *, rate_hz: float, duration_s: float, n_sensors: int) -> None:
    """Refuse a recording that does not fit into a folder."""
    if not folder.is_dir():
        raise StorageError(f"there is no folder {folder}", "Create it, or choose another.")
    if not os.access(folder, os.W_OK):
        raise StorageError(f"the folder {folder} cannot be written", "Choose one with write permission.")
    needed = int(bytes_per_second(rate_hz, n_sensors) * duration_s) + SPACE_FLOOR_BYTES
    free = shutil.disk_usage(folder).free
    if free < needed:
        cause = f"the recording needs about {needed / 1e6:.0f} MB and {folder} has {free / 1e6:.0f} MB free"
        raise StorageError(cause, "Free disk space, choose another disk, or record less.")
