"""The live conversion of a stored calibration."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from analysis.calibration.fit import fit_by_branch
from analysis.calibration.record import CalibrationRecord
from boat_daq.engine.settings import UnitLibrary
from boat_daq.viewmodels.live.live_model import LiveModel
from boat_daq.viewmodels.live.unit_in_use import UnitInUse
from boat_daq.workflows.jobs import Background
from boat_daq.workflows.live_conversion import prepare
from tests.boat_daq.gui.recorded_session import connected
from tests.boat_daq.viewmodels.helpers import until


def record_of(sensors: list[dict]) -> CalibrationRecord:
    """Return the record of stored sensors."""
    return CalibrationRecord.parse({"simulated": True, "sensors": sensors})


def test_conversion_is_prepared_on_a_helper_thread(tmp_path, result):
    """The inverse comes from the helper thread once, and not again."""
    preparation = Background("calibration")
    preparation.call(prepare, CalibrationRecord(tuple(s.record for s in result.sensors), simulated=True))
    found = []
    until(lambda: found.append(preparation.take()) or found[-1] is not None)
    assert preparation.take() is None
    preparation.close()


def test_calibration_of_the_virtual_unit_is_not_used_on_a_real_board(tmp_path, result):
    """Nor the reverse: the header names the calibration of the board that is connected, and so does the live value."""
    units, live = UnitLibrary(tmp_path), LiveModel(lambda: None)
    content = {"simulated": True, "sensors": [s.record.as_json() for s in result.sensors]}
    units.of(simulated=True).add_calibration("SA1", content)
    unit, virtual = UnitInUse(units, SimpleNamespace(unit="SA1"), live), connected()
    real = dataclasses.replace(virtual, simulated=False)
    unit.follow(virtual, 0)
    assert live.loading
    until(lambda: (unit.follow(virtual, 0), unit.conversion)[1] is not None)
    assert live.inverse is not None
    assert "calibrated" in unit.texts(virtual)[-1]
    unit.follow(real, 0)
    assert (unit.conversion, live.inverse, live.loading) == (None, None, False)
    assert "not calibrated" in unit.texts(real)[-1]
    units.add_calibration("SA1", content | {"simulated": False})
    unit.follow(real, 0)  # a command accepted it
    assert "not calibrated" not in unit.texts(real)[-1]
    unit.close()


def test_conversion_in_preparation_is_discarded_with_its_calibration():
    """A unit without a calibration used to be shown by the one that was still being prepared for the unit before it."""
    unit = UnitInUse(None, None, LiveModel(lambda: None))
    unit.use(CalibrationRecord((), simulated=True))
    assert unit.preparation.pending
    unit.use(None)
    assert not unit.preparation.pending
    unit.close()


def test_spline_is_converted_as_a_spline(result):
    """A calibration accepted with a spline was shown live by a cubic through its points."""
    stored = result.sensors[0].record.as_json()
    cubic, spline = (
        prepare(record_of([stored | {"fit": stored["fit"] | {"curve": curve}}])) for curve in ("3", "spline")
    )
    fit = fit_by_branch(
        stored["elongation_mm"], stored["signal_mv"], "spline", positions=stored["positions"],
        branch=stored["branches"], reading_sd=stored["reading_sd_mm"],
        shared=np.asarray(stored["ambient_mv"]) if "ambient_mv" in stored else None,
    )  # fmt: skip
    x = np.array([-1.0, 0.3, 2.0])
    assert spline(fit.predict(x)[:, None]).mm == pytest.approx(x, abs=1e-6)
    assert np.abs(cubic(fit.predict(x)[:, None]).mm - x).max() > 1e-3


def test_range_end_is_read_and_marked_and_stated_contributions_widen_it(result):
    """Both signals one u past the upper end: read, marked, by each sensor too; a scale of 2 % widens U."""
    contents = [s.record.as_json() for s in result.sensors]
    conversion = prepare(record_of(contents))
    end = np.array([[float(np.interp(s.fit.grid[-1], s.fit.grid, s.fit.curve)) + 0.5 for s in result.sensors]])
    found = conversion(end)
    assert found.beyond.tolist() == [True]
    assert found.mm[0] > result.sensors[0].fit.grid[-1]
    assert np.isfinite(conversion.each(end)).all()
    assert np.isnan(conversion(end + 100.0).mm).all()
    stated = [content | {"type_b": {"scale": {"u_percent": 2.0}}} for content in contents]
    wider = prepare(record_of(stated))(end)
    both = np.hypot(found.expanded_mm, 2 * 0.02 * found.mm)
    np.testing.assert_allclose(wider.expanded_mm, both, rtol=0.02)
