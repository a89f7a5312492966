"""Every command of the window with its keys, added to the window's registry."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import Any

from PySide6.QtWidgets import QApplication

from analysis.fidelity import LEVELS
from boat_daq.gui.main_window import MainWindow
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.registry import Command
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.services import Page, Panel
from boat_daq.viewmodels.live.shadow_live import SCALES


def register(window: MainWindow) -> None:
    """Add every command of `window`."""
    makers = (session, edit, view, sequence, calibration, recordings, models, pages, help_)
    for command in (command for make in makers for command in make(window)):
        window.commands.add(command)


def session(window: MainWindow) -> list[Command]:
    """Return the commands of the link and the recording."""
    model = window.model
    run, connection, attempt = model.run, model.connection, model.notices.attempt

    def has_port() -> bool:
        return model.snapshot.port is not None

    return [
        Command("Session", "Vent now", "Esc", window.vent),
        Command("Session", "Connect …", "Ctrl+K", partial(model.services.show, Panel.CONNECT), apart=True),
        Command("Session", "Start the virtual board", "Ctrl+Shift+B", partial(attempt, connection.start_virtual_board)),
        Command("Session", "Disconnect", "Ctrl+Shift+K", partial(attempt, connection.disconnect), has_port),
        Command("Session", "Start or close the recording", "Ctrl+R", run.toggle_recording, model.connected, apart=True),
        Command("Session", "Mark this moment …", "M", window.live.ask_marker, model.connected),
        Command(
            "Session", "Do what the message proposes", "Ctrl+J", window.strip.do_it, window.strip.offers, apart=True
        ),
        Command("Session", "Dismiss the message", "Ctrl+D", window.strip.dismiss, window.strip.stands),
        Command("Session", "Cancel the work under way", "Ctrl+.", window.strip.cancel_work, window.strip.works),
        Command("Session", "Close the window", "Ctrl+Q", window.leave, apart=True),
    ]


def edit(window: MainWindow) -> list[Command]:
    """Return the commands of undo and of the readings."""
    undo, attempt = window.model.undo, window.model.notices.attempt
    return [
        Command("Edit", "Undo", "Ctrl+Z", partial(attempt, undo.undo), lambda: bool(undo.done)),
        Command("Edit", "Redo", "Ctrl+Shift+Z", partial(attempt, undo.redo), lambda: bool(undo.undone)),
        Command("Edit", "Read from a photograph …", "Ctrl+P", window.live.open_photograph, apart=True),
        Command("Edit", "Paste readings", "Ctrl+Shift+V", window.live.paste_readings),
        Command("Edit", "Import readings …", "Ctrl+Shift+I", window.live.import_readings),
        Command("Edit", "Go on without a reading", "Ctrl+Shift+N", window.live.reading.go_without, window.live.asks),
    ]


def view(window: MainWindow) -> list[Command]:
    """Return the commands of the picture and the look."""
    live = window.live

    def plot(deed: str) -> None:
        """Take away the plot that has the focus, else the page's first."""
        cards: list[PlotCard | ShadowPane] = [*window.findChildren(PlotCard), *window.findChildren(ShadowPane)]
        shown = [card for card in cards if card.isVisible()]
        focus = QApplication.focusWidget() or window.focusWidget()
        chosen = next((card for card in shown if focus is not None and card.isAncestorOf(focus)), None)
        if not any(isinstance(card, PlotCard) for card in shown):
            window.model.notices.say(Severity.WARNING, "no plot is shown", "Go to a page that shows one.")
        elif deed == "copy":
            window.copy_plot(chosen or shown[0])
        else:
            window.save_plot(chosen or shown[0], deed)

    return [
        Command("View", "Hold or follow the picture", "Space", live.toggle_hold),
        Command("View", "Zoom in on time", "Ctrl+=", lambda: live.zoom(0.5)),
        Command("View", "Zoom out on time", "Ctrl+-", lambda: live.zoom(2.0)),
        Command("View", "Show the last 10 s", "Ctrl+0", lambda: live.set_window(10.0)),
        Command("View", "Show the whole session", "Ctrl+9", live.show_all),
        Command("View", "Cursor A", "A", lambda: live.plots.place_cursor("a"), apart=True),
        Command("View", "Cursor B", "B", lambda: live.plots.place_cursor("b")),
        Command("View", "Both signals on one axis", "T", live.toggle_together),
        Command("View", "Overlay the last cycles", "O", live.toggle_overlay),
        Command("View", "Copy the plot", "Ctrl+Shift+C", lambda: plot("copy"), apart=True),
        Command("View", "Save the plot as PNG …", "Ctrl+S", lambda: plot("png")),
        Command("View", "Save the plot as SVG …", "Ctrl+Shift+S", lambda: plot("svg")),
        Command("View", "Save the plot's data as CSV …", "Ctrl+E", lambda: plot("csv")),
        Command("View", "Follow the system's theme", "Ctrl+Alt+S", lambda: window.choose_theme("system"), apart=True),
        Command("View", "Light", "Ctrl+Alt+L", lambda: window.choose_theme("light")),
        Command("View", "Dark", "Ctrl+Alt+D", lambda: window.choose_theme("dark")),
        Command("View", "Full screen", "F11", window.toggle_full_screen),
    ]


def sequence(window: MainWindow) -> list[Command]:
    """Return the commands of the run."""
    model = window.model

    def button(text: str, keys: str, key: str, *, apart: bool = False) -> Command:
        def allowed() -> bool:
            return key in model.sequence.allowed(model.snapshot)

        return Command("Sequence", text, keys, partial(model.run.press, key), allowed, apart)

    return [
        button("Arm the plan", "F5", "arm"),
        button("Start", "F6", "start"),
        button("Pause", "F7", "pause"),
        button("Resume", "Shift+F7", "resume"),
        button("Stop", "F8", "stop"),
        button("Put the armed plan away", "Shift+F5", "disarm"),
        button("Clear the fault", "Shift+F8", "clear"),
        Command("Sequence", "Edit the plan", "P", window.live.show_plan, apart=True),
        Command("Sequence", "Open a plan …", "Ctrl+Alt+O", window.live.plan.open),
        Command("Sequence", "Save the plan …", "Ctrl+Alt+W", window.live.plan.save),
        Command("Sequence", "Set the pressure by hand", "Ctrl+G", window.live.show_manual),
        Command("Sequence", "Show the readings", "R", window.live.show_readings),
    ]


def calibration(window: MainWindow) -> list[Command]:
    """Return the commands of the calibration: analyse, sample, accept, report."""
    model = window.model.calibration

    def open_recording() -> None:
        window.go(Page.CALIBRATE)
        ask_open(window, window.model.services, "Open a recording", "boat csv", model.analyse)

    def sample() -> None:
        window.go(Page.CALIBRATE)
        window.model.notices.attempt(model.sample)

    def acceptable() -> bool:
        return window.page is Page.CALIBRATE and not model.obstacle() and model.accepted is None

    def analyse() -> None:
        window.go(Page.CALIBRATE)
        window.model.notices.attempt(model.analyse_current)

    return [
        Command("Runs", "Calibrate with the last run", "Ctrl+Shift+A", analyse),
        Command("Runs", "Open a recording …", "Ctrl+O", open_recording),
        Command("Runs", "Compute uncertainty bands (emcee)", "Ctrl+Shift+M", sample, lambda: model.result is not None),
        Command("Runs", "Accept the calibration", "Ctrl+Return", model.request_acceptance, acceptable),
        Command(
            "Runs", "Report of the run shown …", "Ctrl+Shift+R", window.ask_report,
            lambda: window.model.analysed_path(window.page) is not None,
        ),
    ]  # fmt: skip


def recordings(window: MainWindow) -> list[Command]:
    """Return the commands for the recordings that are chosen on the Runs page."""

    def page() -> Any:
        return window.pages.get(Page.RUNS)

    def able(key: str) -> bool:
        return window.page is Page.RUNS and page() is not None and page().offers(key)

    def why(key: str) -> str:
        if window.page is not Page.RUNS or page() is None:
            return "Go to the Runs page (Ctrl+4) and choose a recording."
        said: str = page().buttons[key].accessibleDescription()
        return said or "The chosen recording does not need it."

    def command(text: str, keys: str, key: str, deed: Callable[[], object], *, apart: bool = False) -> Command:
        return Command("Runs", text, keys, deed, partial(able, key), apart, partial(why, key))

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
    ask_save(window, window.model.services, name, "zip", window.model.save_bug_report, done="")


def models(window: MainWindow) -> list[Command]:
    """Return the commands of the pages Optics, Shadow and Trade-off."""
    m = window.model

    def on(page: Page, deed: Callable[[], object]) -> Callable[[], None]:
        def run() -> None:
            window.go(page)
            m.notices.attempt(deed)

        return run

    def next_colour() -> None:
        names = list(SCALES)
        m.shadow.quantity = names[(names.index(m.shadow.quantity) + 1) % len(names)]

    def show_cost() -> None:
        m.shadow.show_cost = not m.shadow.show_cost

    def sweep_map() -> None:
        m.atlas.toggle(m.tradeoff.shown)

    fidelities = [
        Command("Models", f"Compute: {level}", f"Ctrl+Alt+{i}", partial(m.precision.choose, level))
        for i, level in enumerate(LEVELS, 1)
    ]
    return [
        *fidelities,
        Command("Models", "Sweep all designs, or stop", "F9", on(Page.OPTICS, m.optics.toggle_sweep), apart=True),
        Command("Models", "Optimise beyond the grid, or stop", "Shift+F9", on(Page.OPTICS, m.optics.toggle_search)),
        Command("Models", "Colour the shadow by the next quantity", "Ctrl+F9", next_colour, apart=True),
        Command("Models", "Show what a frame of the shadow costs", "Ctrl+Shift+F9", show_cost),
        Command("Models", "Measure the trade-off, or stop", "F12", on(Page.TRADE_OFF, m.tradeoff.toggle), apart=True),
        Command("Models", "Map where the method fails, or stop", "Shift+F12", on(Page.TRADE_OFF, sweep_map)),
    ]


def pages(window: MainWindow) -> list[Command]:
    """Return the commands that go to a page."""
    return [Command("Go", name, f"Ctrl+{i}", partial(window.go_by_key, name)) for i, name in enumerate(Page, 1)]


def help_(window: MainWindow) -> list[Command]:
    """Return the commands that help."""
    return [
        Command("Help", "Find a command …", "Ctrl+Shift+P", window.show_palette),
        Command("Help", "Keys", "?", window.show_keys),
        Command("Help", "First steps", "F1", window.show_first_steps),
        Command("Help", "Save a bug report …", "Ctrl+Shift+F1", partial(bug_report, window)),
    ]
