"""Units with accepted calibrations, made of sessions."""

from __future__ import annotations

import numpy as np

from boat_daq.engine.settings import StoredCalibration, Unit
from tests.analysis.calibration.sessions import CUBIC, session


def accepted(utc: str, offset_mv: float = 0.0) -> StoredCalibration:
    """Return a calibration of two sensors as acceptance stores it."""
    sensors = []
    for shift in (0.0, 5.0):
        one = session(lambda x, up=offset_mv + shift: CUBIC(x) + up)
        fit = one.fit(3)
        reading_sd = one.grid_mm / np.sqrt(12.0)
        sensors.append({
            "name": "s", "fit": fit.as_json(), "elongation_mm": one.x.tolist(), "signal_mv": one.y.tolist(),
            "positions": np.asarray(one.position).tolist(), "branches": np.asarray(one.branch).tolist(),
            "reading_sd_mm": reading_sd, "noise_mv": 1.0, "model_mv": 0.5, "type_b": {}, "figures": {},
        })  # fmt: skip
    return StoredCalibration(utc, True, {"simulated": True, "sensors": sensors, "recording_id": utc})


def unit(*offsets_mv: float) -> Unit:
    """Return SA1 with a calibration every 60 days, each off by so much."""
    days = ("2026-01-10", "2026-03-11", "2026-05-10", "2026-07-09")
    entries = (accepted(f"{day}T10:00:00+00:00", mv) for day, mv in zip(days, offsets_mv, strict=False))
    return Unit("SA1", history=tuple(entries))
