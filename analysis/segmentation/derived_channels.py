"""What the derived channels of a run were: over all of it, and in each plateau."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.data.recording import Recording
from analysis.segmentation.plateaus import Plateau
from protocol.base.arrays import BoolArray, FloatArray


def derived_json(recording: Recording, plateaus: Sequence[Plateau]) -> list[dict[str, Any]]:
    """Return mean, sd and count of each derived channel, of the run and of the settled plateaus."""
    values = recording.derived_values()
    usable = np.asarray(recording.usable.any(axis=1), dtype=bool)
    found = []
    for channel in recording.derived.channels:
        column = values[channel.name]
        windows = [slice(plateau.settled_first, plateau.last + 1) for plateau in plateaus]
        each = [
            {"number": plateau.number, "pressure_kpa": plateau.pressure_kpa, **_statistics(column[rows], usable[rows])}
            for plateau, rows in zip(plateaus, windows, strict=True)
        ]
        found.append({**channel._asdict(), **_statistics(column, usable), "plateaus": each})
    return found


def _statistics(values: FloatArray, usable: BoolArray) -> dict[str, float]:
    kept = values[usable & np.isfinite(values)]
    mean = float(kept.mean()) if kept.size else float("nan")
    return {"mean": mean, "sd": float(kept.std(ddof=1)) if kept.size > 1 else float("nan"), "n": kept.size}
