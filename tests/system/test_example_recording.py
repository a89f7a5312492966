"""The example recording opens, verifies and is read by the six lines of the schema's docstring."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import numpy as np

from analysis import analyse, load_recording
from boat_daq.engine.recording.verify import verify_recording

EXAMPLE = Path(__file__).resolve().parents[2] / "recordings" / "simulated_SA1_two_cycles.boat"


def test_documented_lines_read_the_samples() -> None:
    """The lines in the docstring of protocol/recording/schema.py read the same samples as the program."""
    db = sqlite3.connect(f"file:{EXAMPLE}?mode=ro", uri=True)
    meta = {key: json.loads(value) for key, value in db.execute("SELECT key, value FROM session")}
    dtype = np.dtype([(name, code, *([tuple(shape)] if shape else [])) for name, code, shape in meta["sample_dtype"]])
    rows = db.execute("SELECT samples FROM block ORDER BY id").fetchall()
    samples = np.concatenate([np.frombuffer(blob, dtype) for (blob,) in rows])
    db.close()
    recording = load_recording(EXAMPLE)
    np.testing.assert_array_equal(samples["lit"], recording.lit)
    np.testing.assert_allclose(samples["pressure_pa"] / 1000, recording.pressure_kpa, rtol=0, atol=1e-12)


def test_example_verifies_and_calibrates() -> None:
    """Its samples derive again from its bytes, and its two cycles give a calibration marked SIMULATED."""
    assert verify_recording(EXAMPLE).identical
    analysis = analyse(EXAMPLE, mcmc=False)
    assert analysis.recording.simulated
    assert len(analysis.cycles.used) == 2
    assert all(sensor.calibration is not None and sensor.calibration.r2 > 0.999 for sensor in analysis.sensors)
