"""What a certificate takes from the settings: the laboratory, and the calibration that was in force before."""

from __future__ import annotations

import pytest

from analysis.certificates.laboratory import Laboratory
from boat_daq.engine.settings import HOME_VARIABLE, UnitLibrary
from boat_daq.workflows.calibration_in_force import calibration_before
from boat_daq.workflows.certificate import load_laboratory, store_laboratory
from protocol.base.errors import RequestError


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv(HOME_VARIABLE, str(tmp_path))
    return tmp_path


def test_laboratory_is_stored_once_and_refused_by_key(home):
    assert load_laboratory() is None
    store_laboratory(Laboratory("Lab", country_code="DE"))
    assert load_laboratory() == Laboratory("Lab", country_code="DE")
    for text, cause in (('nam = "A"', "nam"), ('name = " "', "empty 'name'"), ("name = 1", "type str")):
        (home / "lab.toml").write_text(text)
        with pytest.raises(RequestError, match=cause):
            load_laboratory(home / "lab.toml")


def test_calibration_before_is_the_newest_accepted_one_of_another_recording():
    """Of the same kind of board: neither the run itself, nor one that was not accepted, nor a simulated one."""
    units = UnitLibrary()
    for number, accepted in (("a", True), ("b", True), ("c", False), ("own", True)):
        units.add_calibration("SA1", {"recording_id": number, "sensors": []}, accepted=accepted)
    assert calibration_before(units, "SA1", "own").recording_id == "b"
    assert calibration_before(units, "SA1", "own").calibrated_utc
    assert calibration_before(units.of(simulated=True), "SA1", "own") is None
    assert calibration_before(units, "SA2", "own") is None
