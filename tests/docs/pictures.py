"""Take the pictures of the documents again: `make pictures`.

The steps of the tutorial in the real window, on the virtual board, under Xvfb. Each picture is one of the whole window
(1280 x 800) and replaces the one in docs/images.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from PySide6.QtTest import QTest

from boat_daq.viewmodels.common.services import Page, Tab
from tests.docs.pages import ROOT
from tests.system.window_scenarios import Scenario

NAMES = {"2-running": "sequence", "3-calibration": "calibration"}  # of the pictures that a scenario takes itself


def main(folder: Path) -> None:
    """Take all pictures; recordings are kept in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    scenario = Scenario(ROOT / "docs" / "images")
    window, model = scenario.window, scenario.window.model
    scenario.keep("first-steps")
    scenario.click(window.header.link)
    scenario.until(window.connect_panel.isVisible, "the connect panel")
    scenario.keep("connect")
    window.connect_panel.hide()
    scenario.connect_virtual()
    window.live.pane.setCurrentWidget(window.live.plan)
    QTest.qWait(2000)
    scenario.keep("plan")
    scenario.choose_cycles(2)
    scenario.run_plan()
    scenario.calibrate(sampled=True)
    scenario.click(window.navigation.buttons[Page.RECORDINGS])
    runs = window.pages[Page.RECORDINGS]
    scenario.until(lambda: runs.list.rowCount() > 0, "the list of runs")
    runs.list.selectRow(0)
    scenario.keep("runs")
    scenario.click(window.navigation.buttons[Page.MEASURE])
    window.live.pane.setCurrentWidget(window.live.shadow)
    scenario.until(lambda: model.shadow.model is not None, "the shadow", 120)
    model.session.set_pressure(30.0, 10.0)
    QTest.qWait(2500)
    scenario.keep("live")
    model.session.vent()
    window.show_outlets()
    model.outlets.stream(True)
    model.outlets.serve(True)
    QTest.qWait(1000)
    scenario.keep("outlets")
    model.outlets.stream(False)
    model.outlets.serve(False)
    window.outlets_panel.hide()
    scenario.click(window.navigation.buttons[Page.SETTINGS])
    settings = window.pages[Tab.VALUES]
    settings.list.setCurrentRow(1)
    model.settings.enter(settings.subject, {"min_kpa": "-25", "note": "buckles below"})
    QTest.qWait(500)
    settings.path.clear()  # it is another on each computer
    scenario.keep("settings")
    scenario.click(window.navigation.buttons[Page.MODELS])
    QTest.qWait(500)
    model.optics.set_rays(250)  # the paper's; more take minutes
    scenario.click("Sweep all designs")
    scenario.until(lambda: model.optics.sweep is not None, "the sweep", 600)
    QTest.qWait(1500)
    scenario.keep("optics")
    scenario.pictures = [(NAMES.get(name, name), picture) for name, picture in scenario.pictures]
    scenario.done()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
