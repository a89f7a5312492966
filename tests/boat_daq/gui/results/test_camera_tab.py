"""The camera's tab of the calibration page."""

from __future__ import annotations

import dataclasses

from boat_daq.viewmodels.results.camera import camera_result
from tests.analysis.tracking.filmed_run import camera_analysis
from tests.boat_daq.gui.results.run_results import run_result


def test_a_run_with_a_camera_has_a_tab(live):
    """Plots, figures and delay; the next run without one hides it."""
    model = live.model
    model.unit.preparation.call = lambda *_: None  # the live conversion is not looked at here
    live.go("Calibration")
    page = live.pages["Calibration"]
    tab = page.tabs.indexOf(page.camera)
    model.calibration.show(dataclasses.replace(run_result(), camera=camera_result(camera_analysis())))
    live.refresh()
    assert page.tabs.isTabVisible(tab)
    assert page.camera.table.rowCount() == 5
    assert "corrected" in page.camera.text.text()
    (loop, cycles, speed), _ = page.camera.card.layers
    assert loop.x.size > 40
    assert cycles.x.tolist() == [1.0, 2.0]
    assert speed.x.size == 16
    model.calibration.show(run_result())
    live.refresh()
    assert not page.tabs.isTabVisible(tab)
