"""Scenarios of the real window, each in a process of its own: started by `test_window_scenarios.py` under Xvfb.

    python -m tests.system.window_scenarios NAME FOLDER [light|dark]

Every action is a click on a visible button or a key press; screenshots of the screen go to FOLDER, the
times to standard output as JSON.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QPixmap
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QMenu, QPushButton, QWidget

from boat_daq.engine.snapshot import SessionState
from boat_daq.gui.app import make_application, make_window
from boat_daq.gui.main_window import MainWindow
from boat_daq.viewmodels.common.services import Page, Tab
from tests.system.window_driver import SPEED, RestartedBoard, by_mouse, trial


class Scenario:
    """A window and the actions of its user."""

    def __init__(self, folder: Path, theme: str = "light") -> None:
        self.folder = folder
        self.began = time.perf_counter()
        self.times: dict[str, float] = {}
        self.pictures: list[tuple[str, QPixmap]] = []
        self.app: QApplication = make_application()
        self.window: MainWindow = make_window()
        self.window.choose_theme(theme)
        self.window.resize(self.window.screen().size())
        self.window.show()
        QTest.qWaitForWindowExposed(self.window)
        self.app.processEvents()
        self.note("window up")

    def note(self, what: str) -> None:
        self.times[what] = round(time.perf_counter() - self.began, 2)

    def until(self, condition, what: str, timeout_s: float = 60.0) -> None:
        end = time.perf_counter() + timeout_s
        while not condition():
            if time.perf_counter() > end:
                self.keep("failed")
                self.save_pictures()
                raise SystemExit(
                    f"timed out waiting for: {what}; strip: {self.strip()}; {self.window.model.snapshot.state}"
                )
            QTest.qWait(20)

    def strip(self) -> str:
        return self.window.strip.text.text()

    def click(self, button: QAbstractButton | str, within: QWidget | None = None) -> None:
        """Click a button that is shown, by itself or by its text."""
        if isinstance(button, str):
            shown = (within or self.window).findChildren(QPushButton)
            button = next(b for b in shown if b.text() == button and b.isVisible())
        assert button.isVisible() and button.isEnabled(), button.text()
        QTest.mouseClick(button, Qt.MouseButton.LeftButton, pos=QPoint(button.width() // 2, button.height() // 2))

    def keys(self, text: str, widget: QWidget | None = None) -> None:
        QTest.keyClicks(widget or self.app.focusWidget(), text)

    def keep(self, name: str) -> None:
        """Take a screenshot now; it is written at the end, when no board is under pressure."""
        QTest.qWait(120)
        self.pictures.append((name, self.window.screen().grabWindow(0)))

    def save_pictures(self) -> None:
        for name, picture in self.pictures:
            picture.save(str(self.folder / f"{name}.png"))

    def done(self, **more) -> None:
        """Write screenshots and times, close the window, end the process."""
        self.window.close()
        self.note("closed")
        self.save_pictures()
        print(json.dumps({"times": self.times, **more}), flush=True)
        os._exit(0)  # the interpreter's own shutdown is not part of the test

    # ---- parts of a session --------------------------------------------------------------------------------------

    def connect_virtual(self) -> None:
        """Start a virtual board at `SPEED` from the connect panel."""
        self.click(self.window.header.link)
        panel = self.window.connect_panel
        self.until(panel.isVisible, "the connect panel")
        panel.speed.setCurrentIndex(panel.speed.findData(SPEED))
        self.click(panel.virtual_button)
        self.until(self.window.model.connected, "the board")
        self.until(self.window.model.live.has_data, "the first sample")
        self.note("connected")

    def choose_cycles(self, cycles: int) -> None:
        """Type the number of cycles into the plan's form."""
        self.window.live.pane.setCurrentWidget(self.window.live.plan)
        field = self.window.live.plan.fields["cycles"]
        field.setFocus()
        field.selectAll()
        self.keys(f"{cycles}", field)
        QTest.keyClick(field, Qt.Key.Key_Return)
        self.window.live.pane.setCurrentWidget(self.window.live.readings)

    def connect_to(self, port: str) -> None:
        """Type a port into the connect panel and connect."""
        self.click(self.window.header.link)
        panel = self.window.connect_panel
        self.until(panel.isVisible, "the connect panel")
        panel.port.lineEdit().selectAll()
        self.keys(port, panel.port.lineEdit())
        self.click(panel.connect_button)
        self.until(self.window.model.connected, "the board")
        self.until(self.window.model.live.has_data, "the first sample")
        self.note("connected")

    def start_run(self) -> None:
        """Arm and start the plan."""
        sequence = self.window.live.sequence
        self.click(sequence.buttons["arm"])
        self.until(lambda: self.state() is SessionState.ARMED, "armed")
        self.click(sequence.buttons["start"])
        self.until(lambda: self.state() is SessionState.RUNNING, "running")
        self.note("started")

    def state(self) -> SessionState:
        return self.window.model.session.snapshot().state

    def run_plan(self, picture_at: int = 9) -> int:
        """Arm, start, type every reading with Enter until the run has ended; return the number of readings."""
        model, bar = self.window.model, self.window.live.reading
        self.start_run()
        read, last_step = 0, None
        while self.state() is SessionState.RUNNING or self.state() is SessionState.FINISHING:
            waiting = model.session.snapshot().waiting_for_reading
            if waiting is None or waiting.step_id == last_step:
                QTest.qWait(10)
                continue
            self.until(lambda w=waiting: bar.isVisible() and bar.step_id == w.step_id, "the reading field", 5)
            if read == picture_at:
                self.keep("2-running")
            millimetres = model.connection.simulated_mm()
            self.keys(f"{millimetres:.1f}", bar.field)
            QTest.keyClick(bar.field, Qt.Key.Key_Return)
            last_step, read = waiting.step_id, read + 1
        self.until(lambda: self.state() is SessionState.IDLE, "the end of the run")
        self.note("run ended")
        return read

    def calibrate(self, *, sampled: bool) -> None:
        """Analyse, sample where it is asked for, accept."""
        model = self.window.model
        self.click(self.window.navigation.buttons[Page.RESULTS])
        self.click("Analyse the last run")
        self.until(
            lambda: model.calibration.result is not None or model.calibration.failure is not None, "the analysis", 300
        )
        self.note("analysed")
        page = self.window.pages[Tab.CALIBRATION]
        QTest.qWait(300)
        if sampled:
            self.until(page.sample.isEnabled, "the intervals", 90)
            page.sample.trigger()
            self.until(lambda: bool(model.calibration.posterior), "the posterior", 90)
            self.note("sampled")
            QTest.qWait(300)
        self.keep("3-calibration")
        self.click(page.accept)
        self.until(lambda: model.live.inverse is not None, "the live elongation", 60)
        self.note("accepted and live")

    def report(self) -> Path:
        """Make the PDF report through the Runs page."""
        model = self.window.model
        self.click(self.window.navigation.buttons[Page.RECORDINGS])
        page = self.window.pages[Page.RECORDINGS]
        self.until(lambda: page.list.rowCount() > 0, "the list of runs")
        page.list.selectRow(0)
        self.until(page.buttons["report"].isEnabled, "the report's button")
        self.keep("4-runs")
        target = self.folder / "report.pdf"
        model.runs.report([model.runs.runs[0].path], target)
        self.until(lambda: model.jobs.get(f"report {target}") is None, "the report", 90)
        self.note("report made")
        return target


def first_session(scenario: Scenario, sampled: str = "") -> None:
    """From the first start to an accepted calibration, its live elongation and a report; `sampled` as it is named."""
    assert scenario.window.live.first_steps.isVisible()
    scenario.keep("1-first-start")
    scenario.connect_virtual()
    scenario.choose_cycles(1)  # the nightly test by mouse runs two
    read = scenario.run_plan()
    scenario.calibrate(sampled=bool(sampled))
    scenario.click(scenario.window.navigation.buttons[Page.MEASURE])
    scenario.window.live.pane.setCurrentWidget(scenario.window.live.shadow)
    scenario.until(lambda: scenario.window.model.shadow.model is not None, "the shadow", 90)
    scenario.window.model.session.set_pressure(30.0, 10.0)
    QTest.qWait(1500)
    scenario.keep("5-live-calibrated")
    target = scenario.report()
    model = scenario.window.model
    stored = model.units.of(simulated=True).load("SA1").calibration
    fits = [sensor["fit"] for sensor in stored.content["sensors"]]
    scenario.done(
        readings=read,
        report=target.read_bytes()[:5].decode("latin-1"),
        r2=[fit["r2"] for fit in fits],
        sensitivity=[s["figures"]["sensitivity_mv_per_mm"] for s in stored.content["sensors"]],
        simulated=stored.content["simulated"],
    )


def killed(scenario: Scenario) -> None:
    """Begin a run and kill this process in it."""
    scenario.connect_virtual()
    scenario.choose_cycles(1)
    scenario.start_run()
    scenario.until(lambda: scenario.window.model.session.snapshot().recorded_s > 12, "some seconds of recording")
    os.kill(os.getpid(), signal.SIGKILL)


def recover(scenario: Scenario) -> None:
    """Recover the interrupted recording at a click and arm the rest of its run."""
    strip = scenario.window.strip
    scenario.until(strip.act.isVisible, "the offer to recover")
    offer = scenario.strip()
    scenario.keep("6-recovery")
    scenario.click(strip.act)
    model = scenario.window.model
    scenario.until(lambda: not model.jobs.running(), "the recovery")
    scenario.click(scenario.window.navigation.buttons[Page.RECORDINGS])
    scenario.until(
        lambda: any(r.summary and r.summary.status == "recovered" for r in model.runs.runs), "the recovered run"
    )
    scenario.note("recovered")
    killed_run, status = model.runs.runs[0].path, [r.summary.status for r in model.runs.runs if r.summary]
    samples = model.runs.runs[0].summary.samples
    scenario.connect_virtual()
    scenario.click(scenario.window.navigation.buttons[Page.RECORDINGS])
    page = scenario.window.pages[Page.RECORDINGS]
    page.list.selectRow(0)
    scenario.until(page.actions_["resume"].isVisible, "the offer to resume", 10)
    scenario.keep("6-resume")
    page.actions_["resume"].trigger()
    scenario.until(lambda: scenario.state() is SessionState.ARMED, "armed again", 30)
    scenario.note("armed again")
    snapshot = model.session.snapshot()
    scenario.keep("7-recovered")
    scenario.done(
        offer=offer, status=status, samples=samples, same_file=snapshot.recording == killed_run,
        target=snapshot.last.target_kpa == snapshot.last.target_kpa,
    )  # fmt: skip


def vent(scenario: Scenario) -> None:
    """Press F4 under pressure: with the window in front, a menu open, a field in use, a helper computing."""
    model = scenario.window.model
    scenario.connect_virtual()
    measured = {}
    for name in ("page", "menu", "field", "working"):
        model.session.set_pressure(30.0, 10.0)
        scenario.until(lambda: model.session.snapshot().last.pressure_kpa > 20, "pressure", 20)
        prepare_for_vent(scenario, name)
        QTest.qWait(100)
        began = time.perf_counter()
        subprocess.run(["xdotool", "key", "F4"], check=True)
        scenario.until(lambda: model.session.snapshot().last.pressure_kpa < 5, f"vented from {name}", 20)
        measured[name] = round(time.perf_counter() - began, 3)
        for popup in (QApplication.activePopupWidget(),):
            if popup is not None:
                popup.close()
        model.jobs.close()
        scenario.until(lambda: abs(model.session.snapshot().last.pressure_kpa) < 0.5, "at rest again", 20)
        QTest.qWait(800)  # the check before the next pressure averages over a moment
    scenario.done(vented_s=measured)


def prepare_for_vent(scenario: Scenario, name: str) -> None:
    """Bring the window into a state in which F4 must still vent."""
    window = scenario.window
    subprocess.run(["xdotool", "windowfocus", "--sync", str(int(window.winId()))], check=True)  # no window manager does
    if name == "menu":
        menu = window.menuBar().actions()[0].menu()
        assert isinstance(menu, QMenu)
        menu.popup(window.mapToGlobal(QPoint(5, 20)))
    if name == "field":
        window.live.pane.setCurrentWidget(window.live.plan)
        window.live.plan.target.setFocus()
    if name == "working":
        from boat_daq.workflows.jobs import Job

        window.model.jobs.start("busy", Job("Computing", keep_busy), lambda job: None)
        QTest.qWait(300)


def keep_busy() -> None:
    """Compute for a minute."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        sum(i * i for i in range(10_000))


def unplug(scenario: Scenario, carrier: str = "pty") -> None:
    """Lose the board in a run and find it again: shown, data stored, no pressure until requested."""
    board = RestartedBoard(scenario.folder, carrier)
    window, model = scenario.window, scenario.window.model
    scenario.connect_to(board.port)
    scenario.choose_cycles(1)
    scenario.start_run()
    scenario.until(lambda: model.session.snapshot().last.pressure_kpa > 30, "pressure")
    recorded_s, kept = model.session.snapshot().recorded_s, len(model.session.live.ring)

    board.kill()
    began = time.perf_counter()
    scenario.until(lambda: "disconnected" in window.header.link.text(), "the loss in the header", 10)
    shown_s = time.perf_counter() - began
    scenario.until(lambda: scenario.state() is SessionState.FAULT, "the fault", 5)
    scenario.keep("7-unplugged")
    message = scenario.strip()

    board.start()
    began = time.perf_counter()
    scenario.until(lambda: window.header.link.text().endswith("SA1  connected"), "the board again", 15)
    back_s = time.perf_counter() - began
    scenario.until(lambda: len(model.session.live.ring) > kept + 300, "samples again", 15)
    scenario.keep("8-replugged")
    at_rest = max(abs(float(p)) for p in model.session.live.ring.view(last=200)["pressure_kpa"])
    state, target = scenario.state(), model.session.snapshot().last.target_kpa

    scenario.click(window.live.sequence.buttons["clear"])
    scenario.until(lambda: scenario.state() is not SessionState.FAULT, "the fault cleared", 10)
    QTest.qWait(500)
    target_later = model.session.snapshot().last.target_kpa
    recording = model.session.snapshot().recording
    model.run.toggle_recording()
    scenario.until(lambda: model.session.snapshot().recording is None, "the recording closed")
    board.kill()
    scenario.done(
        shown_s=round(shown_s, 2), back_s=round(back_s, 2), message=message, state=state.value, at_rest_kpa=at_rest,
        targets=[target == target, target_later == target_later], recorded_s=recorded_s, recording=str(recording),
    )  # fmt: skip


def hundred_cycles(scenario: Scenario, speed: str = "100") -> None:
    """Run the plan of a hundred cycles with its page open, then print its figures."""
    board = RestartedBoard(scenario.folder, "pty", float(speed))
    window, model = scenario.window, scenario.window.model
    scenario.connect_to(board.port)
    window.go(Tab.REPEATABILITY)
    scenario.click("Choose the plan")
    scenario.until(lambda: model.sequence.plan.name == "repeatability", "the plan")
    scenario.start_run()
    scenario.click(window.navigation.buttons[Page.RESULTS])
    while_running = 0
    repeatability = model.repeatability
    while scenario.state() in (SessionState.RUNNING, SessionState.FINISHING):
        QTest.qWait(50)
        if repeatability.result is not None and not while_running:
            while_running = repeatability.result.cycles
            scenario.keep("9-repeat-running")
    scenario.note("run ended")
    ended = model.session.snapshot().run_ended
    assert ended is not None
    scenario.until(
        lambda: repeatability.result is not None and repeatability.result.cycles == model.sequence.plan.cycles,
        "all cycles",
        120,
    )
    scenario.note("all cycles shown")
    QTest.qWait(300)
    scenario.keep("10-repeat")
    figures = [
        {"cycles": s.cycles.snr_db.size, "snr_db": float(s.cycles.snr_db.mean()), "unit": s.cycles.sensitivity_unit,
         "sensitivity": float(s.cycles.sensitivity.mean()), "hysteresis": float(s.cycles.hysteresis_percent_fso.mean())}
        for s in repeatability.result.sensors
    ]  # fmt: skip
    board.kill()
    scenario.done(
        ended=str(ended.end),
        while_running=while_running,
        figures=figures,
        lost=model.session.snapshot().health.statistics.lost,
    )


SCENARIOS = {
    "unplug": unplug,
    "hundred_cycles": hundred_cycles,
    "first_session": first_session,
    "killed": killed,
    "recover": recover,
    "vent": vent,
    "by_mouse": by_mouse,
    "trial": trial,
}


def play(name: str, folder: str, *theme: str) -> None:
    """Play a scenario; `name` may end in a colon and its option."""
    name, _, option = name.partition(":")
    SCENARIOS[name](Scenario(Path(folder), *theme), *filter(None, [option]))


if __name__ == "__main__":
    play(*sys.argv[1:])
