"""Take the pictures and the moving picture of the documents again: `make pictures`.

The steps of the tutorial in the real window, on the virtual board, under Xvfb. Each picture is one of the whole window
(1280 x 800) and replaces the one in docs/images.
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path

from PIL import Image, ImageChops
from PySide6.QtCore import QBuffer, QIODevice, Qt, QTimer
from PySide6.QtGui import QPixmap
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel

from boat_daq.viewmodels.common.services import Page, Tab
from tests.docs.pages import ROOT
from tests.system.window_scenarios import Scenario

NAMES = {"2-running": "sequence", "3-calibration": "calibration"}  # of the pictures that a scenario takes itself


class Film:
    """A moving picture of the window, a frame each `every_ms`, at most `most` of them spread over its time."""

    def __init__(self, scenario: Scenario, every_ms: int = 500, most: int = 60, width: int = 800) -> None:
        self._scenario, self._most, self._width = scenario, most, width
        self._frames: list[QPixmap] = []
        self._timer = QTimer()
        self._timer.timeout.connect(self._take)
        self._timer.start(every_ms)

    def _take(self) -> None:
        picture = self._scenario.window.grab()
        self._frames.append(picture.scaledToWidth(self._width, Qt.TransformationMode.SmoothTransformation))

    def save(self, path: Path) -> None:
        """Stop, and write the frames as GIF: 64 colours, 0.4 s each, the last for three seconds."""
        self._timer.stop()
        images = _changing([_as_image(frame) for frame in self._frames])
        images = [*images[:: max(1, len(images) // self._most)], images[-1]]
        times = [400] * (len(images) - 1) + [3000]
        images[0].save(path, save_all=True, append_images=images[1:], duration=times, loop=0, optimize=True)


def _changing(images: list[Image.Image]) -> list[Image.Image]:
    """Return the pictures in which something moved: a hundredth of the points differs from the picture before."""
    kept = [images[0]]
    for image in images[1:]:
        changed = ImageChops.difference(image.convert("L"), kept[-1].convert("L")).point(lambda grey: 255 * (grey > 24))
        if sum(changed.histogram()[128:]) > image.width * image.height // 100:
            kept.append(image)
    return kept


def _as_image(picture: QPixmap) -> Image.Image:
    buffer = QBuffer()
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    picture.save(buffer, "PNG")
    return Image.open(io.BytesIO(bytes(buffer.data().data()))).convert("RGB").quantize(64, dither=Image.Dither.NONE)


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
    film = Film(scenario)
    scenario.choose_cycles(2)
    scenario.run_plan()
    scenario.click(window.navigation.buttons[Page.RESULTS])
    scenario.click("Analyse the last run")
    scenario.until(lambda: model.calibration.result is not None, "the analysis", 600)
    QTest.qWait(2000)
    film.save(ROOT / "docs" / "images" / "calibration.gif")
    scenario.keep("calibration")
    scenario.click(window.pages[Tab.CALIBRATION].accept)
    scenario.until(lambda: model.live.inverse is not None, "the live elongation", 60)
    scenario.click(window.navigation.buttons[Page.RECORDINGS])
    runs = window.pages[Page.RECORDINGS]
    scenario.until(lambda: runs.list.rowCount() > 0, "the list of runs")
    runs.list.selectRow(0)
    named = [label for label in runs.findChildren(QLabel) if label.accessibleName() == "Folder of the recordings"]
    named[0].setText("")  # it is another on each computer
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
    scenario.until(lambda: model.optics.result is not None, "the rays of the paper's design", 240)
    QTest.qWait(1500)
    scenario.keep("optics")
    scenario.pictures = [(NAMES.get(name, name), picture) for name, picture in scenario.pictures]
    scenario.done()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
