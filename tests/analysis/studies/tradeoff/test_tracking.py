"""The settings of the camera's tracker, on pictures of the virtual camera."""

from __future__ import annotations

import pytest

from analysis.studies.tradeoff.measure import measure_setting
from analysis.studies.tradeoff.tracking import USED
from boat_daq.workflows.measured_methods import camera_tracker


def test_the_setting_in_use_is_among_those_measured() -> None:
    """At every fidelity."""
    method = camera_tracker()
    names = {setting.name for setting in method.settings(True)}
    assert set(method.in_code.values()) == {USED}
    assert names >= {USED, "detector, 640 px", "corners, 640 px"}


@pytest.mark.nightly
def test_each_setting_reads_within_a_tenth_of_a_millimetre() -> None:
    """The edges within the tolerance, and better than the detector's corners."""
    errors = {setting.name: measure_setting(setting, 1).error for setting in camera_tracker().settings(True)}
    assert max(errors.values()) < 0.1
    assert errors[USED] < 0.01
    assert errors[USED] < errors["corners, 640 px"] < errors["detector, 640 px"]
