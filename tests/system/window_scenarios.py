"""A journey through the real window, in a process of its own: started by `test_window_scenarios.py` under Xvfb.

    python -m tests.system.window_scenarios NAME FOLDER [light|dark]

Every deed is a click on a button that can be seen or a key on the window; screenshots of the screen go to FOLDER, the
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
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QPushButton, QWidget

from boat_daq.engine.snapshot import SessionState
from boat_daq.gui.app import make_application, make_window
from boat_daq.gui.main_window import MainWindow
from tests.system.window_driver import SPEED, RestartedBoard, by_mouse


class Journey:
    """A window and what a hand does with it."""

    def __init__(self, folder: Path, theme: str = "light") -> None:
        self.folder = folder
        self.began = time.perf_counter()
        self.times: dict[str, float] = {}
        self.pictures: list[tuple[str, object]] = []
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
                    f"waited in vain for: {what}; strip: {self.strip()}; {self.window.model.snapshot.state}"
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
        """Take a picture of the screen now; it is written at the end, when no board waits for us."""
        QTest.qWait(120)
        self.pictures.append((name, self.window.screen().grabWindow(0)))

    def save_pictures(self) -> None:
        for name, picture in self.pictures:
            picture.save(str(self.folder / f"{name}.png"))

    def done(self, **more) -> None:
        """Write pictures and times, close the window, leave."""
        self.window.close()
        self.note("closed")
        self.save_pictures()
        print(json.dumps({"times": self.times, **more}), flush=True)
        os._exit(0)  # the interpreter's own end is not what is looked at here

    # ---- parts of a session --------------------------------------------------------------------------------------

    def connect_virtual(self) -> None:
        """Start a virtual board at `SPEED` from the panel, as a hand would."""
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
        self.window.live.pane.setCurrentWidget(self.window.live.table)

    def connect_to(self, port: str) -> None:
        """Type a port into the panel and connect, as a hand would."""
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
        """Arm, start, type every reading with Enter until the run has ended; returns the number of readings."""
        model, bar = self.window.model, self.window.live.reading
        self.start_run()
        read, asked = 0, None
        while self.state() is SessionState.RUNNING or self.state() is SessionState.FINISHING:
            waiting = model.session.snapshot().waiting_for_reading
            if waiting is None or waiting.step_id == asked:
                QTest.qWait(10)
                continue
            self.until(lambda w=waiting: bar.isVisible() and bar.asked == w.step_id, "the question", 5)
            if read == picture_at:
                self.keep("2-running")
            millimetres = model.connection.simulated_mm()
            self.keys(f"{millimetres:.1f}", bar.field)
            QTest.keyClick(bar.field, Qt.Key.Key_Return)
            asked, read = waiting.step_id, read + 1
        self.until(lambda: self.state() is SessionState.IDLE, "the end of the run")
        self.note("run ended")
        return read

    def calibrate(self) -> None:
        """Analyse, sample, accept."""
        model = self.window.model
        self.click(self.window.navigation.buttons["Calibrate"])
        self.click("Analyse the last run")
        self.until(
            lambda: model.calibration.result is not None or model.calibration.failure is not None, "the analysis", 90
        )
        self.note("analysed")
        page = self.window.pages["Calibrate"]
        QTest.qWait(300)
        self.click(page.sample)
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
        self.click(self.window.navigation.buttons["Runs"])
        page = self.window.pages["Runs"]
        self.until(lambda: page.list.rowCount() > 0, "the list of runs")
        page.list.selectRow(0)
        self.until(page.buttons["report"].isEnabled, "the report's button")
        self.keep("4-runs")
        target = self.folder / "report.pdf"
        model.runs.report([model.runs.runs[0].path], target)
        self.until(lambda: model.jobs.get("report") is None, "the report", 90)
        self.note("report made")
        return target


def whole_session(journey: Journey) -> None:
    """From the first start to an accepted calibration, its live elongation and a report."""
    assert journey.window.live.first_steps.isVisible()
    journey.keep("1-first-start")
    journey.connect_virtual()
    journey.choose_cycles(1)  # two are gone through by mouse, at night
    read = journey.run_plan()
    journey.calibrate()
    journey.click(journey.window.navigation.buttons["Live"])
    journey.window.live.pane.setCurrentWidget(journey.window.live.shadow)
    journey.until(lambda: journey.window.model.shadow.model is not None, "the shadow", 90)
    journey.window.model.session.set_pressure(30.0, 10.0)
    QTest.qWait(1500)
    journey.keep("5-live-calibrated")
    target = journey.report()
    model = journey.window.model
    stored = model.units.load("SA1").calibration
    fits = [sensor["fit"] for sensor in stored.content["sensors"]]
    journey.done(
        readings=read,
        report=target.read_bytes()[:5].decode("latin-1"),
        r2=[fit["r2"] for fit in fits],
        sensitivity=[s["figures"]["sensitivity_mv_per_mm"] for s in stored.content["sensors"]],
        simulated=stored.content["simulated"],
    )


def killed(journey: Journey) -> None:
    """Begin a run and be killed in it."""
    journey.connect_virtual()
    journey.choose_cycles(1)
    journey.start_run()
    journey.until(lambda: journey.window.model.session.snapshot().recorded_s > 12, "some seconds of recording")
    os.kill(os.getpid(), signal.SIGKILL)


def recover(journey: Journey) -> None:
    """The next start finds what was left and recovers it at a click."""
    strip = journey.window.strip
    journey.until(strip.act.isVisible, "the offer to recover")
    offer = journey.strip()
    journey.keep("6-recovery")
    journey.click(strip.act)
    model = journey.window.model
    journey.until(lambda: model.jobs.get("recover") is None, "the recovery")
    journey.click(journey.window.navigation.buttons["Runs"])
    journey.until(
        lambda: any(r.summary and r.summary.status == "recovered" for r in model.runs.runs), "the recovered run"
    )
    journey.note("recovered")
    killed_run, status = model.runs.runs[0].path, [r.summary.status for r in model.runs.runs if r.summary]
    samples = model.runs.runs[0].summary.samples
    journey.connect_virtual()
    journey.click(journey.window.navigation.buttons["Runs"])
    page = journey.window.pages["Runs"]
    page.list.selectRow(0)
    journey.until(page.buttons["resume"].isVisible, "the offer to resume", 10)
    journey.keep("6-resume")
    journey.click(page.buttons["resume"])
    journey.until(lambda: journey.state() is SessionState.ARMED, "armed again", 30)
    journey.note("armed again")
    snapshot = model.session.snapshot()
    journey.keep("7-recovered")
    journey.done(
        offer=offer, status=status, samples=samples, same_file=snapshot.recording == killed_run,
        target=snapshot.last.target_kpa == snapshot.last.target_kpa,
    )  # fmt: skip


def vent(journey: Journey) -> None:
    """Esc vents: with the window in front, with a menu open, with a field being typed in, while a helper computes."""
    model = journey.window.model
    journey.connect_virtual()
    measured = {}
    for name in ("page", "menu", "field", "working"):
        model.session.set_pressure(30.0, 10.0)
        journey.until(lambda: model.session.snapshot().last.pressure_kpa > 20, "pressure", 20)
        prepare_for_vent(journey, name)
        QTest.qWait(100)
        began = time.perf_counter()
        subprocess.run(["xdotool", "key", "Escape"], check=True)
        journey.until(lambda: model.session.snapshot().last.pressure_kpa < 5, f"vented from {name}", 20)
        measured[name] = round(time.perf_counter() - began, 3)
        for popup in (QApplication.activePopupWidget(),):
            if popup is not None:
                popup.close()
        model.jobs.close()
        journey.until(lambda: abs(model.session.snapshot().last.pressure_kpa) < 0.5, "at rest again", 20)
        QTest.qWait(800)  # the check before the next pressure looks back a moment
    journey.done(vented_s=measured)


def prepare_for_vent(journey: Journey, name: str) -> None:
    """Bring the window into a state in which Esc must still vent."""
    window = journey.window
    subprocess.run(["xdotool", "windowfocus", "--sync", str(int(window.winId()))], check=True)  # no manager is here to
    if name == "menu":
        menu = window.menuBar().actions()[0].menu()
        menu.popup(window.mapToGlobal(QPoint(5, 20)))
    if name == "field":
        window.live.pane.setCurrentWidget(window.live.plan)
        window.live.plan.target.setFocus()
    if name == "working":
        from boat_daq.viewmodels.common.jobs import Job

        window.model.jobs.start("busy", Job("Working hard", keep_busy), lambda job: None)
        QTest.qWait(300)


def keep_busy() -> None:
    """Compute for a minute."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        sum(i * i for i in range(10_000))


def unplug(journey: Journey, way: str = "pty") -> None:
    """Lose the board in the middle of a run and find it again: shown, data kept, nothing under pressure by itself."""
    board = RestartedBoard(journey.folder, way)
    window, model = journey.window, journey.window.model
    journey.connect_to(board.port)
    journey.choose_cycles(1)
    journey.start_run()
    journey.until(lambda: model.session.snapshot().last.pressure_kpa > 30, "pressure")
    recorded_s, kept = model.session.snapshot().recorded_s, len(model.session.ring)

    board.kill()
    began = time.perf_counter()
    journey.until(lambda: "unplugged" in window.header.link.text(), "the loss in the head", 10)
    shown_s = time.perf_counter() - began
    journey.until(lambda: journey.state() is SessionState.FAULT, "the fault", 5)
    journey.keep("7-unplugged")
    said = journey.strip()

    board.start()
    began = time.perf_counter()
    journey.until(lambda: "connected" in window.header.link.text(), "the board again", 15)
    back_s = time.perf_counter() - began
    journey.until(lambda: len(model.session.ring) > kept + 300, "samples again", 15)
    journey.keep("8-replugged")
    at_rest = max(abs(float(p)) for p in model.session.ring.view(last=200)["pressure_kpa"])
    state, target = journey.state(), model.session.snapshot().last.target_kpa

    journey.click(window.live.sequence.buttons["clear"])
    journey.until(lambda: journey.state() is not SessionState.FAULT, "the fault cleared", 10)
    QTest.qWait(500)
    target_later = model.session.snapshot().last.target_kpa
    recording = model.session.snapshot().recording
    window.model.undo.clear()
    model.run.toggle_recording()
    journey.until(lambda: model.session.snapshot().recording is None, "the recording closed")
    board.kill()
    journey.done(
        shown_s=round(shown_s, 2), back_s=round(back_s, 2), said=said, state=state.value, at_rest_kpa=at_rest,
        targets=[target == target, target_later == target_later], recorded_s=recorded_s, recording=str(recording),
    )  # fmt: skip


def hundred_cycles(journey: Journey, speed: str = "100") -> None:
    """The plan of a hundred cycles, watched on its page while it runs; then its figures."""
    board = RestartedBoard(journey.folder, "pty", float(speed))
    window, model = journey.window, journey.window.model
    journey.connect_to(board.port)
    journey.click(window.navigation.buttons["Repeat"])
    journey.click("Choose the plan")
    journey.until(lambda: model.sequence.plan.name == "repeatability", "the plan")
    journey.start_run()
    journey.click(window.navigation.buttons["Repeat"])
    while_running = 0
    model = model.repeatability
    while journey.state() in (SessionState.RUNNING, SessionState.FINISHING):
        QTest.qWait(50)
        if model.result is not None and not while_running:
            while_running = model.result.cycles
            journey.keep("9-repeat-running")
    journey.note("run ended")
    ended = model.session.snapshot().run_ended
    assert ended is not None
    journey.until(
        lambda: model.result is not None and model.result.cycles == model.sequence.plan.cycles, "all cycles", 120
    )
    journey.note("all cycles shown")
    QTest.qWait(300)
    journey.keep("10-repeat")
    figures = [
        {"cycles": s.cycles.snr_db.size, "snr_db": float(s.cycles.snr_db.mean()), "unit": s.cycles.sensitivity_unit,
         "sensitivity": float(s.cycles.sensitivity.mean()), "hysteresis": float(s.cycles.hysteresis_percent_fso.mean())}
        for s in model.result.sensors
    ]  # fmt: skip
    board.kill()
    journey.done(
        ended=str(ended.end),
        while_running=while_running,
        figures=figures,
        lost=model.session.snapshot().health.statistics.lost,
    )


JOURNEYS = {
    "unplug": unplug,
    "hundred_cycles": hundred_cycles,
    "whole_session": whole_session,
    "killed": killed,
    "recover": recover,
    "vent": vent,
    "by_mouse": by_mouse,
}

if __name__ == "__main__":
    name, _, of = sys.argv[1].partition(":")
    JOURNEYS[name](Journey(Path(sys.argv[2]), *sys.argv[3:]), *filter(None, [of]))
