"""A day at a glance: the extremes that the recorder kept, without reading a sample.

Rules: memory grows with the rows of the table `overview`, one for about 1,000 samples, not with the samples.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.arrays import FloatArray
from analysis.data.boat_file import opened
from analysis.errors import FileError


@dataclass(frozen=True, slots=True)
class Overview:
    """Extremes of consecutive stretches, [rows] and [rows, sensors]; start and end in board time."""

    start_s: FloatArray
    end_s: FloatArray
    samples: int
    pressure_min_kpa: FloatArray
    pressure_max_kpa: FloatArray
    signal_min_mv: FloatArray
    signal_max_mv: FloatArray


def load_overview(path: str | Path) -> Overview:
    """Read the overview of a recording.

    Raises
    ------
    FileError : the recording holds none, or is damaged.
    """
    path = Path(path)
    with opened(path) as db:
        rows = db.execute(
            "SELECT first_time_us, last_time_us, n, pressure_min_kpa, pressure_max_kpa, signal_min_mv, signal_max_mv"
            " FROM overview ORDER BY id"
        ).fetchall()
    if not rows:
        raise FileError(f"{path.name} holds no overview", "Load it whole: it is short.")
    numbers = np.asarray([[np.nan if v is None else v for v in row[:5]] for row in rows], dtype=np.float64)
    try:
        low, high = (np.asarray([json.loads(row[k]) for row in rows], dtype=np.float64) for k in (5, 6))
    except (ValueError, TypeError, RecursionError) as error:
        raise FileError(f"{path.name} has an overview that cannot be read: {error}", "Load it whole.") from error
    return Overview(
        numbers[:, 0] / 1e6, numbers[:, 1] / 1e6, int(numbers[:, 2].sum()), numbers[:, 3], numbers[:, 4], low, high
    )
