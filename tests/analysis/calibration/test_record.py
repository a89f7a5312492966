"""The stored form of a calibration: the same numbers after it is read again, from records of every version."""

from __future__ import annotations

import json

import numpy as np
import pytest

from analysis.calibration.fit import Calibration, fit_by_branch, fit_calibration
from analysis.calibration.inverse import Inverse
from analysis.calibration.record import CalibrationRecord, SensorRecord
from protocol.base.errors import BoatDaqError
from tests.analysis.calibration.sessions import session

READ = session(lambda x: 1650 + 40 * x - 2 * x**2, seed=4)
SD_MM = READ.grid_mm / np.sqrt(12.0)


def fitted(ambient: float = 0.0) -> tuple[SensorRecord, Calibration]:
    """Return the record of a session, and the fit that it is made of."""
    shared = ambient * np.sin(np.asarray(READ.position, dtype=float))
    fit = fit_by_branch(READ.x, READ.y, positions=READ.position, branch=READ.branch, reading_sd=SD_MM, shared=shared)
    record = SensorRecord(
        "s1", fit.as_json(), fit.x, fit.y, np.asarray(READ.position, float), np.asarray(READ.branch, float),
        shared if ambient else None, float(SD_MM), 0.3, 0.2, np.array([0.4, 0.5, 0.1]),
        {"scale": {"u_percent": 0.1, "distribution": "normal"}}, {"snr_db": 40.0}, fitted=fit,
    )  # fmt: skip
    return record, fit


def read_again(record: SensorRecord) -> SensorRecord:
    """Return a record that was stored as text."""
    whole = CalibrationRecord((record,), simulated=False, recording_id="a", curve="3", cycles=2)
    text = json.dumps(whole.as_json(), allow_nan=False)
    again = CalibrationRecord.parse(json.loads(text), unit="SA1", calibrated_utc="2026-11-26")
    assert (again.unit, again.recording_id, again.curve, again.cycles) == ("SA1", "a", "3", 2)
    assert again.as_json() == whole.as_json()
    return again.sensors[0]


def assert_same(found: Inverse, expected: Inverse) -> None:
    """Both inverses have the same numbers."""
    for key in ("x_range", "starts", "powers", "nodes", "noise_mm", "shared_mm", "half_division_mm", "reference"):
        np.testing.assert_array_equal(getattr(found, key), getattr(expected, key), key)


@pytest.mark.parametrize("ambient_mv", [0.0, 3.0])
def test_inverse_is_that_of_the_run(ambient_mv: float) -> None:
    """Ambient light weighs the positions of the run's fit, and of the fit of the stored points."""
    record, fit = fitted(ambient_mv)
    again = read_again(record)
    assert again.calibration().coefficients.tolist() == fit.coefficients.tolist()
    assert_same(again.inverse(), record.inverse())


def test_records_of_older_versions_keep_their_numbers() -> None:
    """0.1.0 stored positions without branches, and the loop within `model_mv`; the oldest stored points alone."""
    record, fit = fitted()
    stored = record.as_json()
    kept = (
        "name",
        "fit",
        "elongation_mm",
        "signal_mv",
        "positions",
        "reading_sd_mm",
        "noise_mv",
        "model_mv",
        "figures",
    )
    plain = fit_calibration(fit.x, fit.y, 3)
    first = SensorRecord.parse({key: stored[key] for key in kept}).inverse()
    read = plain.with_reading(float(SD_MM), stored["positions"])
    assert_same(first, Inverse.of(read, noise_sd=0.3, model_sd=stored["model_mv"]))
    assert stored["model_mv"] == pytest.approx(np.sqrt(0.2**2 + 0.42 / 3))
    oldest = SensorRecord.parse({key: stored[key] for key in ("fit", "elongation_mm", "signal_mv")}).inverse()
    assert_same(oldest, Inverse.of(plain))


def test_sensor_without_a_curve_gives_its_reason() -> None:
    whole = CalibrationRecord((SensorRecord("s2", void="no elongation was read"),), simulated=True)
    with pytest.raises(BoatDaqError, match="s2 is not calibrated: no elongation was read"):
        whole.fusion()
    assert CalibrationRecord.parse({"note": "withdrawn"}).sensors == ()
