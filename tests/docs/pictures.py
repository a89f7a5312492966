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
from tests.system.window_scenarios import Journey

IMAGES = ROOT / "docs" / "images"


def main() -> None:
    """Take all pictures."""
    os.chdir(sys.argv[1])  # recordings go into a folder of their own
    journey = Journey(IMAGES)
    window, model = journey.window, journey.window.model
    journey.keep("first-steps")
    journey.click(window.header.link)
    panel = window.connect_panel
    journey.until(panel.isVisible, "the connect panel")
    QTest.qWait(300)
    journey.keep("connect")
    panel.hide()
    journey.connect_virtual()
    window.live.pane.setCurrentWidget(window.live.plan)
    QTest.qWait(2000)
    journey.keep("plan")
    journey.choose_cycles(5)
    run(journey)
    journey.click(window.navigation.buttons["Calibrate"])
    journey.click("Analyse the last run")
    journey.until(lambda: model.calibration.result is not None, "the analysis", 120)
    page = window.pages["Calibrate"]
    QTest.qWait(500)
    journey.click(page.sample)
    journey.until(lambda: bool(model.calibration.posterior), "the posterior", 120)
    QTest.qWait(500)
    journey.keep("calibration")
    journey.click(page.accept)
    journey.until(lambda: model.live.inverse is not None, "the live elongation", 90)
    journey.click(window.navigation.buttons["Runs"])
    runs = window.pages["Runs"]
    journey.until(lambda: runs.list.rowCount() > 0, "the list of runs")
    runs.list.selectRow(0)
    QTest.qWait(500)
    journey.keep("runs")
    journey.click(window.navigation.buttons["Live"])
    window.live.pane.setCurrentWidget(window.live.shadow)
    journey.until(lambda: model.shadow.model is not None, "the shadow", 120)
    model.session.set_pressure(30.0, 10.0)
    QTest.qWait(2500)
    journey.keep("live")
    model.session.vent()
    journey.click(window.navigation.buttons["Optics"])
    QTest.qWait(500)
    model.optics.set_rays(250)  # the paper's; more take minutes
    journey.click("Sweep all designs")
    journey.until(lambda: model.optics.sweep is not None, "the sweep", 600)
    QTest.qWait(1500)
    journey.keep("optics")
    journey.done()


def run(journey: Journey) -> None:
    """Run the plan, with a picture of a plateau that waits for its reading."""
    model, field = journey.window.model, journey.window.live.reading
    journey.start_run()
    asked, read = None, 0
    while journey.state() in (SessionState.RUNNING, SessionState.FINISHING):
        waiting = model.session.snapshot().waiting_for_reading
        if waiting is None or waiting.step_id == asked:
            QTest.qWait(10)
            continue
        journey.until(lambda step=waiting.step_id: field.isVisible() and field.asked == step, "the prompt", 10)
        if read == 9:
            journey.window.live.pane.setCurrentWidget(journey.window.live.table)
            journey.keep("sequence")
        journey.keys(f"{model.connection.simulated_mm():.1f}", field.field)
        QTest.keyClick(field.field, Qt.Key.Key_Return)
        asked, read = waiting.step_id, read + 1
    journey.until(lambda: journey.state() is SessionState.IDLE, "the end of the run")


if __name__ == "__main__":
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    main()
