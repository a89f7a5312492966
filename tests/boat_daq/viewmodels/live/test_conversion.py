"""The live conversion of a stored calibration."""

from __future__ import annotations

from boat_daq.viewmodels.common.jobs import Background
from boat_daq.viewmodels.live.conversion import prepare
from tests.boat_daq.viewmodels.helpers import until


def test_conversion_is_prepared_on_a_helper_thread(tmp_path, result):
    """The inverse comes from the helper thread once, and not again."""
    preparation = Background("calibration")
    preparation.call(prepare, {"sensors": [dict(s.fit.content) for s in result.sensors]})
    found = []
    until(lambda: found.append(preparation.take()) or found[-1] is not None)
    assert preparation.take() is None
    preparation.close()
