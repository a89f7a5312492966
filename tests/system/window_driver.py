"""Drives a scenario of the window from outside: a board that is unplugged, and mouse and keyboard of the screen."""

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
    """A virtual board in a process that is killed and started again, with one identity at one port."""

    def __init__(self, folder: Path, carrier: str, speed: float = SPEED) -> None:
        self._speed = speed
        if carrier == "pty":
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
        """Start the board and return when its port can be opened."""
        command = [sys.executable, "-m", "boat_daq", "board", *self._place, "--speed", f"{self._speed:g}", "--json"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        self._process.stdout.readline()

    def kill(self) -> None:
        """Kill the board's process, as an unplugged cable."""
        self._process.kill()
        self._process.wait()


class UserInput:
    """Mouse and keyboard events of the screen by xdotool: the window receives them as a user's."""

    def __init__(self, scenario) -> None:
        self.scenario = scenario
        self.clicks = self.keys = 0

    def click(self, widget: QWidget | str, *, at: QPoint | None = None) -> None:
        """Click a widget that is shown, by itself or by its text, where it is on the screen."""
        if isinstance(widget, str):
            found = (w for top in QApplication.topLevelWidgets() for w in top.findChildren(QPushButton))
            widget = next(b for b in found if b.text() == widget and b.isVisible())
        self.scenario.until(lambda: widget.isVisible() and widget.isEnabled(), f"to click {widget}", 30)
        place = widget.mapToGlobal(at or widget.rect().center())
        self._do("mousemove", str(place.x()), str(place.y()), "click", "1")
        self.clicks += 1

    def type(self, text: str) -> None:
        """Type a text and Enter."""
        self._do("type", "--delay", "2", "--", text)
        self._do("key", "Return")
        self.keys += len(text) + 1

    @staticmethod
    def _do(*arguments: str) -> None:
        subprocess.run(["xdotool", *arguments], check=True)
        QTest.qWait(40)


def by_mouse(scenario) -> None:
    """Run the first start to accepted calibration and PDF by mouse and keyboard alone; two cycles."""
    window, model, user = scenario.window, scenario.window.model, UserInput(scenario)
    focus(window)
    user.click("Connect a board \u2026")
    panel = window.connect_panel
    scenario.until(panel.isVisible, "the panel")
    panel.speed.setCurrentIndex(panel.speed.findData(SPEED))  # a real session has no speed: not counted
    user.click(panel.virtual_button)
    scenario.until(model.live.has_data, "the first sample")
    scenario.note("connected")
    focus(window)
    field = window.live.plan.fields["cycles"]
    user.click(field)
    field.selectAll()
    user.type("2")
    scenario.until(lambda: model.sequence.plan.cycles == 2, "two cycles", 5)
    user.click("Arm")
    user.click("Start")
    scenario.until(lambda: scenario.state() is SessionState.RUNNING, "running")
    scenario.note("started")
    bar, last_step, read = window.live.reading, None, 0
    while scenario.state() in (SessionState.RUNNING, SessionState.FINISHING):
        waiting = model.session.snapshot().waiting_for_reading
        if waiting is None or waiting.step_id == last_step or bar.step_id != waiting.step_id:
            QTest.qWait(10)
            continue
        user.type(f"{model.connection.simulated_mm():.1f}")  # the field has the focus already
        last_step, read = waiting.step_id, read + 1
    scenario.note("run ended")
    scenario.until(window.strip.act.isVisible, "the next step's offer", 10)
    user.click(window.strip.act)
    scenario.until(lambda: model.calibration.result is not None, "the analysis", 90)
    scenario.note("analysed")
    page = window.pages["Calibration"]
    user.click(page.accept)
    scenario.until(lambda: model.live.inverse is not None, "the live elongation", 60)
    scenario.note("accepted")
    user.click(page.report)
    target = save_as(scenario, user, scenario.folder / "by-mouse.pdf")
    scenario.until(lambda: target.exists() and model.jobs.get(f"report {target}") is None, "the report", 120)
    scenario.note("PDF made")
    scenario.keep("12-done")
    scenario.done(
        clicks=user.clicks, keys=user.keys, readings=read, message=scenario.strip(),
        report=target.read_bytes()[:5].decode("latin-1"),
    )  # fmt: skip


def trial(scenario) -> None:
    """Press Quick trial, then make the report of what it shows: by mouse, on a machine without recordings."""
    window, model, user = scenario.window, scenario.window.model, UserInput(scenario)
    focus(window)
    user.click("Quick trial")
    scenario.until(lambda: model.calibration.result is not None, "the analysis", 120)
    scenario.note("analysed")
    user.click(window.pages["Calibration"].report)
    target = save_as(scenario, user, scenario.folder / "trial.pdf")
    scenario.until(lambda: target.exists() and model.jobs.get(f"report {target}") is None, "the report", 120)
    scenario.note("PDF made")
    scenario.done(clicks=user.clicks, report=target.read_bytes()[:5].decode("latin-1"))


def save_as(scenario, user: UserInput, target: Path) -> Path:
    """Type a name into the file dialog and return its path."""
    dialog = scenario.window.findChild(QFileDialog)
    scenario.until(dialog.isVisible, "the dialog")
    scenario.keep("11-report-dialog")
    names = dialog.findChild(QLineEdit)
    focus(dialog)
    scenario.until(names.hasFocus, "the name's field to have the focus", 5)
    names.selectAll()
    user.type(str(target))
    return target


def focus(window: QWidget) -> None:
    """Give a window the keyboard focus: without a window manager nothing else does."""
    subprocess.run(["xdotool", "windowfocus", "--sync", str(int(window.winId()))], check=True)
    QTest.qWait(50)
