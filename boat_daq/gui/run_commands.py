"""The commands of calibrations and recordings; each does what its button does, under the same conditions."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any

from boat_daq.gui.registry import Command
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save

if TYPE_CHECKING:
    from boat_daq.gui.main_window import MainWindow

MENU = "Runs"


def calibration(window: MainWindow) -> list[Command]:
    """Return the commands of the calibration: analyse, sample, accept, report."""
    model = window.desk.calibration

    def open_recording() -> None:
        window.go("Calibrate")
        ask_open(window, window.desk, "Open a recording", "boat csv", model.analyse)

    def sample() -> None:
        window.go("Calibrate")
        window.desk.notices.attempt(model.sample)

    def acceptable() -> bool:
        return window.page == "Calibrate" and not model.obstacle() and model.accepted is None

    def analyse() -> None:
        window.go("Calibrate")
        window.desk.analyse_current()

    return [
        Command(MENU, "Calibrate with the last run", "Ctrl+Shift+A", analyse),
        Command(MENU, "Open a recording …", "Ctrl+O", open_recording),
        Command(MENU, "Compute uncertainty bands (emcee)", "Ctrl+Shift+M", sample, lambda: model.result is not None),
        Command(MENU, "Accept the calibration", "Ctrl+Return", window.desk.accept_calibration, acceptable),
        Command(
            MENU, "Report of the run shown …", "Ctrl+Shift+R", window.ask_report,
            lambda: window.desk.analysed_path(window.page) is not None,
        ),
    ]  # fmt: skip


def recordings(window: MainWindow) -> list[Command]:
    """Return the commands for the recordings that are chosen on the Runs page."""

    def page() -> Any:
        return window.pages.get("Runs")

    def able(key: str) -> bool:
        return window.page == "Runs" and page() is not None and page().offers(key)

    def why(key: str) -> str:
        if window.page != "Runs" or page() is None:
            return "Go to the Runs page (Ctrl+4) and choose a recording."
        said: str = page().buttons[key].accessibleDescription()
        return said or "The chosen recording does not need it."

    def command(text: str, keys: str, key: str, deed: Callable[[], object], *, apart: bool = False) -> Command:
        return Command(MENU, text, keys, deed, partial(able, key), apart, partial(why, key))

    return [
        command("Calibrate with the chosen recording", "Ctrl+Alt+C", "open", lambda: page().open(), apart=True),
        command("Repeatability of the chosen recording", "Ctrl+Alt+R", "repeat", lambda: page().repeat()),
        command("Correct its readings …", "Ctrl+Alt+E", "readings", lambda: page().edit_readings()),
        command("Resume this run", "Ctrl+Alt+G", "resume", lambda: page().resume()),
        command("Replay it in real time", "Ctrl+Alt+P", "replay", lambda: page().replay(1)),
        command("Export it as CSV …", "Ctrl+Alt+X", "export", lambda: page().export("csv")),
        command("Export it as Parquet …", "Ctrl+Alt+Q", "export", lambda: page().export("parquet")),
        command("Report of the chosen runs …", "Ctrl+Alt+T", "report", lambda: page().ask_report()),
        command("Compare the chosen runs", "Ctrl+Alt+M", "compare", lambda: page().compare()),
        command("Recover the chosen recordings", "Ctrl+Alt+V", "recover", lambda: page().recover()),
    ]


def bug_report(window: MainWindow) -> None:
    """Ask where to put a bug report."""
    name = f"boat-daq-report-{datetime.now(UTC).astimezone():%Y%m%d-%H%M%S}"
    ask_save(window, window.desk, name, "zip", window.desk.save_bug_report, done="")
