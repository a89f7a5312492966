"""The live conversion of a stored calibration."""

from __future__ import annotations

from types import SimpleNamespace

from boat_daq.viewmodels.common.jobs import Background
from boat_daq.viewmodels.live.conversion import UnitInUse, prepare
from boat_daq.viewmodels.live.live_model import LiveModel
from tests.boat_daq.viewmodels.helpers import until


def test_conversion_is_prepared_on_a_helper_thread(tmp_path, result):
    """The inverse comes from the helper thread once, and not again."""
    preparation = Background("calibration")
    preparation.call(prepare, {"sensors": [dict(s.fit.content) for s in result.sensors]})
    found = []
    until(lambda: found.append(preparation.take()) or found[-1] is not None)
    assert preparation.take() is None
    preparation.close()


def test_conversion_in_preparation_is_discarded_with_its_calibration():
    """A unit without a calibration used to be shown by the one that was still being prepared for the unit before it."""
    unit = UnitInUse(None, None, LiveModel(lambda: None))
    unit.use(SimpleNamespace(content={"sensors": []}, utc="2026-11-22"))
    assert unit.preparation.pending
    unit.use(None)
    assert not unit.preparation.pending
    unit.close()
