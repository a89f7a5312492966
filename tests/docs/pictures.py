"""Take the pictures of the documents again: `make pictures`.

The steps of the tutorial in the real window, on the virtual board, under Xvfb. Each picture is one of the whole window
(1280 x 800) and replaces the one in docs/images.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from boat_daq.engine.snapshot import SessionState
from tests.docs.pages import ROOT
from tests.system.window_scenarios import Scenario

IMAGES = ROOT / "docs" / "images"


def main() -> None:
    """Take all pictures."""
    os.chdir(sys.argv[1])  # recordings go into a folder of their own
    scenario = Scenario(IMAGES)
    window, model = scenario.window, scenario.window.model
    scenario.keep("first-steps")
    scenario.click(window.header.link)
    panel = window.connect_panel
    scenario.until(panel.isVisible, "the connect panel")
    QTest.qWait(300)
    scenario.keep("connect")
    panel.hide()
    scenario.connect_virtual()
    window.live.pane.setCurrentWidget(window.live.plan)
    QTest.qWait(2000)
    scenario.keep("plan")
    scenario.choose_cycles(2)
    run(scenario)
    scenario.click(window.navigation.buttons["Calibrate"])
    scenario.click("Analyse the last run")
    scenario.until(lambda: model.calibration.result is not None, "the analysis", 120)
    page = window.pages["Calibrate"]
    QTest.qWait(500)
    scenario.click(page.sample)
    scenario.until(lambda: bool(model.calibration.posterior), "the posterior", 120)
    QTest.qWait(500)
    scenario.keep("calibration")
    scenario.click(page.accept)
    scenario.until(lambda: model.live.inverse is not None, "the live elongation", 90)
    scenario.click(window.navigation.buttons["Runs"])
    runs = window.pages["Runs"]
    scenario.until(lambda: runs.list.rowCount() > 0, "the list of runs")
    runs.list.selectRow(0)
    QTest.qWait(500)
    scenario.keep("runs")
    scenario.click(window.navigation.buttons["Live"])
    window.live.pane.setCurrentWidget(window.live.shadow)
    scenario.until(lambda: model.shadow.model is not None, "the shadow", 120)
    model.session.set_pressure(30.0, 10.0)
    QTest.qWait(2500)
    scenario.keep("live")
    model.session.vent()
    scenario.click(window.navigation.buttons["Optics"])
    QTest.qWait(500)
    model.optics.set_rays(250)  # the paper's; more take minutes
    scenario.click("Sweep all designs")
    scenario.until(lambda: model.optics.sweep is not None, "the sweep", 600)
    QTest.qWait(1500)
    scenario.keep("optics")
    scenario.done()


def run(scenario: Scenario) -> None:
    """Run the plan, with a picture of a plateau that waits for its reading."""
    model, field = scenario.window.model, scenario.window.live.reading
    scenario.start_run()
    asked, read = None, 0
    while scenario.state() in (SessionState.RUNNING, SessionState.FINISHING):
        waiting = model.session.snapshot().waiting_for_reading
        if waiting is None or waiting.step_id == asked:
            QTest.qWait(10)
            continue
        scenario.until(lambda step=waiting.step_id: field.isVisible() and field.asked == step, "the prompt", 10)
        if read == 9:
            scenario.window.live.pane.setCurrentWidget(scenario.window.live.table)
            scenario.keep("sequence")
        scenario.keys(f"{model.connection.simulated_mm():.1f}", field.field)
        QTest.keyClick(field.field, Qt.Key.Key_Return)
        asked, read = waiting.step_id, read + 1
    scenario.until(lambda: scenario.state() is SessionState.IDLE, "the end of the run")


if __name__ == "__main__":
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    main()
