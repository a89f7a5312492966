"""What journeys through the window need from outside it: a board that is unplugged, and a hand on the mouse."""

from __future__ import annotations

import atexit
import socket
import subprocess
import sys
from pathlib import Path

from PySide6.QtCore import QPoint
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QLineEdit, QPushButton, QWidget

from boat_daq.engine.snapshot import SessionState

SPEED = 20.0


class RestartedBoard:
    """A virtual board in a process that is killed and started again, with one identity, at one place."""

    def __init__(self, folder: Path, way: str, speed: float = SPEED) -> None:
        self._speed = speed
        if way == "pty":
            self.port = str(folder / "board")
            self._place = ["--pty", "--link", self.port]
        else:
            with socket.create_server(("127.0.0.1", 0)) as probe:
                number = probe.getsockname()[1]
            self.port = f"socket://127.0.0.1:{number}"
            self._place = ["--tcp", f"127.0.0.1:{number}"]
        atexit.register(self.kill)
        self.start()

    def start(self) -> None:
        """Plug it in; returns when it can be found."""
        command = [sys.executable, "-m", "boat_daq", "board", *self._place, "--speed", f"{self._speed:g}", "--json"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        self._process.stdout.readline()

    def kill(self) -> None:
        """Pull the plug."""
        self._process.kill()
        self._process.wait()


class Hand:
    """A hand on the mouse and the keyboard of the screen: xdotool, so that the window cannot tell it from one."""

    def __init__(self, journey) -> None:
        self.journey = journey
        self.clicks = self.keys = 0

    def click(self, widget: QWidget | str, *, at: QPoint | None = None) -> None:
        """Click a widget that is shown, by itself or by its text, where it is on the screen."""
        if isinstance(widget, str):
            found = (w for top in QApplication.topLevelWidgets() for w in top.findChildren(QPushButton))
            widget = next(b for b in found if b.text() == widget and b.isVisible())
        self.journey.until(lambda: widget.isVisible() and widget.isEnabled(), f"to click {widget}", 30)
        place = widget.mapToGlobal(at or widget.rect().center())
        self._do("mousemove", str(place.x()), str(place.y()), "click", "1")
        self.clicks += 1

    def type(self, text: str) -> None:
        """Type a text and Enter."""
        self._do("type", "--delay", "2", "--", text)
        self._do("key", "Return")
        self.keys += len(text) + 1

    @staticmethod
    def _do(*words: str) -> None:
        subprocess.run(["xdotool", *words], check=True)
        QTest.qWait(40)


def by_mouse(journey) -> None:
    """First start to accepted calibration and PDF as a tired person does it: what is seen is clicked; two cycles."""
    window, model, hand = journey.window, journey.window.model, Hand(journey)
    focus(window)
    hand.click("Connect a board \u2026")
    panel = window.connect_panel
    journey.until(panel.isVisible, "the panel")
    panel.speed.setCurrentIndex(panel.speed.findData(SPEED))  # a real session has no speed: not counted
    hand.click(panel.virtual_button)
    journey.until(model.live.has_data, "the first sample")
    journey.note("connected")
    focus(window)
    tabs, field = window.live.pane, window.live.plan.fields["cycles"]
    hand.click(tabs.tabBar(), at=tabs.tabBar().tabRect(1).center())
    hand.click(field)
    field.selectAll()
    hand.type("2")
    journey.until(lambda: model.sequence.plan.cycles == 2, "two cycles", 5)
    hand.click("Arm")
    hand.click("Start")
    journey.until(lambda: journey.state() is SessionState.RUNNING, "running")
    journey.note("started")
    bar, asked, read = window.live.reading, None, 0
    while journey.state() in (SessionState.RUNNING, SessionState.FINISHING):
        waiting = model.session.snapshot().waiting_for_reading
        if waiting is None or waiting.step_id == asked or bar.asked != waiting.step_id:
            QTest.qWait(10)
            continue
        hand.type(f"{model.connection.simulated_mm():.1f}")  # the field has the focus already
        asked, read = waiting.step_id, read + 1
    journey.note("run ended")
    journey.until(window.strip.act.isVisible, "the next step's offer", 10)
    hand.click(window.strip.act)
    journey.until(lambda: model.calibration.result is not None, "the analysis", 90)
    journey.note("analysed")
    page = window.pages["Calibrate"]
    hand.click(page.accept)
    journey.until(lambda: model.live.inverse is not None, "the live elongation", 60)
    journey.note("accepted")
    hand.click(page.report)
    target = save_as(journey, hand, journey.folder / "by-mouse.pdf")
    journey.until(lambda: target.exists() and model.jobs.get("report") is None, "the report", 120)
    journey.note("PDF made")
    journey.keep("12-done")
    journey.done(
        clicks=hand.clicks, keys=hand.keys, readings=read, said=journey.strip(),
        report=target.read_bytes()[:5].decode("latin-1"),
    )  # fmt: skip


def save_as(journey, hand: Hand, target: Path) -> Path:
    """Type a name into the dialog that asks for one."""
    dialog = journey.window.findChild(QFileDialog)
    journey.until(dialog.isVisible, "the dialog")
    journey.keep("11-report-dialog")
    names = dialog.findChild(QLineEdit)
    focus(dialog)
    journey.until(names.hasFocus, "the name's field to have the focus", 5)
    names.selectAll()
    hand.type(str(target))
    return target


def focus(window: QWidget) -> None:
    """Give a window the keyboard: no window manager is here to do it."""
    subprocess.run(["xdotool", "windowfocus", "--sync", str(int(window.winId()))], check=True)
    QTest.qWait(50)
