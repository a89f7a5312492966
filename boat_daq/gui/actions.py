"""Every command of the window with its keys, added to the window's registry."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import cast

from PySide6.QtWidgets import QApplication

from analysis.fidelity import LEVELS
from boat_daq.gui.live.units_panel import UnitsPanel
from boat_daq.gui.main_window import MainWindow
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.registry import Command
from boat_daq.gui.results.metadata_form import MetadataForm
from boat_daq.gui.results.runs_page import RunsPage
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.gui.widgets.text_dialog import TextDialog
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.open_windows import start_window
from boat_daq.viewmodels.common.services import Page, Panel
from boat_daq.viewmodels.live.shadow_live import SCALES
from boat_daq.viewmodels.results.metadata import MetadataModel

CONNECTED = "Disconnect the board first."
NO_GRID = "No plateau of the virtual board waits for a reading."
DERIVED = (
    "One a line: NAME [UNIT] = EXPRESSION, such as ratio = s1_mv / s2_mv. Use pressure_kpa, s1_mv, s1_lit, s1_dark, "
    "those above, + - * / ** < >, and abs, sqrt, exp, log, min, max, where and others. They are plotted, and stored "
    "with the next recordings."
)
CONTENTS = {  # what an operator types to find a page
    Page.CALIBRATE: "fit curve hysteresis",
    Page.REPEAT: "repeatability drift hysteresis",
    Page.RUNS: "recordings units export replay compare recover report",
    Page.SETTINGS: "limits unit preferences options rate baud folder import export defaults",
}


def register(window: MainWindow) -> None:
    """Add every command of `window`."""
    menus = (session, edit, view, sequence, calibration, recordings, models, pages, help_)
    for command in (command for menu in menus for command in menu(window)):
        window.commands.add(command)


def session(window: MainWindow) -> list[Command]:
    """Return the commands of the link and the recording."""
    model, strip = window.model, window.strip
    run, connection, attempt = model.run, model.connection, model.notices.attempt
    add = partial(Command, "Session")

    def has_port() -> bool:
        return model.snapshot.port is not None

    def state_metadata() -> None:
        units, unit = model.units.of(simulated=model.snapshot.simulated), model.unit.name(model.snapshot)
        path, about = model.snapshot.recording, (units, unit, model.undo)

        def show() -> None:
            stated = MetadataModel.of_unit(*about)
            if path is not None:
                stated = MetadataModel.of_session(model.session, path, *about)
            MetadataForm(window, stated, model.services).show()

        attempt(show)

    start = partial(attempt, connection.start_virtual_board)
    describe = partial(model.services.show, Panel.PROFILE)
    return [
        add("Vent now", "F4", window.vent, also="emergency release deflate"),
        add("Vent all windows now", "Shift+F4", model.windows.vent_all, also="emergency release every board"),
        add("Close what is open, else vent", "Esc", window.escape, also="cancel escape"),
        add("Connect …", "Ctrl+K", partial(model.services.show, Panel.CONNECT), apart=True, also="port serial board"),
        add("Describe a board …", "Ctrl+Shift+D", describe, also="profile wizard text firmware Arduino RX8"),
        add("Start the virtual board", "Ctrl+Shift+B", start, also="demo simulate simulation"),
        add(
            "Quick trial",
            "F3",
            partial(attempt, run.trial.start),
            run.trial.possible,
            why=lambda: CONNECTED,
            also="demo",
        ),
        add(
            "Open a window for another board", "Ctrl+Shift+W", partial(attempt, start_window), also="second session new"
        ),
        add(
            "Streams and remote control …", "Ctrl+Shift+H", window.show_outlets, also="lsl secop outlet server network"
        ),
        add("Disconnect", "Ctrl+Shift+K", partial(attempt, connection.disconnect), has_port),
        add("Start or close the recording", "Ctrl+R", run.toggle_recording, model.connected, apart=True),
        add("Add marker …", "Ctrl+M", window.live.ask_marker, model.connected, also="mark note comment moment"),
        add("Metadata …", "Ctrl+Shift+E", state_metadata, also="operator customer item serial note ambient recording"),
        add("Apply suggested action", "Ctrl+J", strip.apply, strip.has_action, apart=True, also="message do"),
        add("Dismiss message", "Ctrl+D", strip.dismiss, strip.has_notice),
        add("Cancel task", "Ctrl+.", strip.cancel_job, lambda: bool(model.jobs.running()), also="work job stop"),
        add("Close the window", "Ctrl+Q", window.leave, apart=True, also="quit exit leave"),
    ]


def edit(window: MainWindow) -> list[Command]:
    """Return the commands of undo and of the readings."""
    undo, attempt, live, run = window.model.undo, window.model.notices.attempt, window.live, window.model.run
    add = partial(Command, "Edit")
    return [
        add("Undo", "Ctrl+Z", partial(attempt, undo.undo), lambda: bool(undo.done)),
        add("Redo", "Ctrl+Shift+Z", partial(attempt, undo.redo), lambda: bool(undo.undone)),
        add("Read from a photograph …", "Ctrl+P", live.open_photograph, apart=True),
        add("Paste readings", "Ctrl+Shift+V", lambda: live.show_readings().paste()),
        add("Import readings …", "Ctrl+Shift+I", lambda: live.show_readings().import_()),
        add("Read the simulated grid", "F2", run.read_grid, run.may_read_grid, why=lambda: NO_GRID, also="elongation"),
        add("Read the simulated grid at every plateau", "Shift+F2", run.toggle_read_all, also="all automatic"),
        add("Skip this reading", "Ctrl+Shift+N", run.skip_reading, live.reading_is_due, also="without"),
    ]


def view(window: MainWindow) -> list[Command]:
    """Return the commands of the plots and the theme."""
    live, run, attempt = window.live, window.model.run, window.model.notices.attempt
    add = partial(Command, "View")

    def edit_derived() -> None:
        def take(text: str) -> bool:
            return attempt(partial(run.set_derived, text), done="The derived channels are in use.")

        TextDialog(window, "Derived channels", DERIVED, run.derived_text(), "Use", take, lines=8)

    def show_units() -> None:
        if window.units_panel is None:
            choice, services = window.model.unit_choice, window.model.services
            window.units_panel = UnitsPanel(window, choice, services, window.follow_theme)
        window.units_panel.refresh()
        window.units_panel.show()
        window.units_panel.raise_()

    def is_live() -> bool:
        return window.page is Page.LIVE

    def export_plot(kind: str) -> None:
        """Copy or save the plot that has the focus, else the first of the page."""
        cards: list[PlotCard | ShadowPane] = [*window.findChildren(PlotCard), *window.findChildren(ShadowPane)]
        visible = [card for card in cards if card.isVisible()]
        focus = QApplication.focusWidget() or window.focusWidget()
        chosen = next((card for card in visible if focus is not None and card.isAncestorOf(focus)), None)
        if not any(isinstance(card, PlotCard) for card in visible):
            window.model.notices.add(Severity.WARNING, "no plot is shown", "Go to a page that shows one.")
        elif kind == "copy":
            window.copy_plot(chosen or visible[0])
        else:
            window.save_plot(chosen or visible[0], kind)

    return [
        add("Freeze or follow the plot", "Space", live.model.toggle_freeze, is_live, also="hold pause picture"),
        add("Zoom in on time", "Ctrl+=", partial(live.model.zoom, 0.5)),
        add("Zoom out on time", "Ctrl+-", partial(live.model.zoom, 2.0)),
        add("Show the last 10 s", "Ctrl+0", partial(live.model.set_window, 10.0)),
        add("Show the whole session", "Ctrl+9", partial(live.model.set_window, math.inf)),
        add("Cursor A", "Ctrl+Alt+A", partial(live.plots.place_cursor, "a"), apart=True, also="statistics measure"),
        add("Cursor B", "Ctrl+Alt+B", partial(live.plots.place_cursor, "b"), also="statistics measure"),
        add("All signals on one axis", "Ctrl+T", live.toggle_together),
        add("Layout of the plots …", "Ctrl+Shift+L", live.show_layout, also="hide order overlay axis curves xy"),
        add("Overlay the last cycles", "Ctrl+Shift+O", live.toggle_overlay),
        add("Units of the values …", "Ctrl+Alt+J", show_units, also="psi bar volt percent celsius fahrenheit inch"),
        add("Derived channels …", "Ctrl+Alt+H", edit_derived, also="expression formula ratio virtual channel"),
        add("Copy the plot", "Ctrl+Shift+C", partial(export_plot, "copy"), apart=True, also="screenshot clipboard"),
        add("Save the plot as PNG …", "Ctrl+S", partial(export_plot, "png"), also="screenshot picture image export"),
        add("Save the plot as SVG …", "Ctrl+Shift+S", partial(export_plot, "svg")),
        add("Save the plot's data as CSV …", "Ctrl+E", partial(export_plot, "csv"), also="export"),
        add("Follow the system's theme", "Ctrl+Alt+S", partial(window.choose_theme, "system"), apart=True),
        add("Light", "Ctrl+Alt+L", partial(window.choose_theme, "light"), also="day theme"),
        add("Dark", "Ctrl+Alt+D", partial(window.choose_theme, "dark"), also="night theme"),
        add("Full screen", "F11", window.toggle_full_screen),
    ]


def sequence(window: MainWindow) -> list[Command]:
    """Return the commands of the run."""
    model, live = window.model, window.live
    add = partial(Command, "Sequence")

    def open_queue() -> None:
        ask_open(window, model.services, "Open a queue", "toml", show_queue)

    def show_queue(path: Path) -> None:
        queue, attempt = model.run.queue, model.notices.attempt

        def show() -> None:
            runs = queue.load(path)
            words = "Each run has a recording of its own. One that does not finish ends the queue."

            def start(_: str) -> bool:
                return attempt(partial(queue.start, runs))

            TextDialog(window, f"Queue {path.name}", words, queue.preview(runs), "Start", start, 8).show_only()

        attempt(show)

    def button(text: str, keys: str, key: str, also: str = "") -> Command:
        def allowed() -> bool:
            return key in model.sequence.allowed(model.snapshot)

        return add(text, keys, partial(model.run.press, key), allowed, also=also)

    return [
        button("Arm the plan", "F5", "arm"),
        button("Start", "F6", "start", "begin run"),
        button("Pause", "F7", "pause"),
        add("Resume", "Shift+F7", model.run.resume, model.run.may_resume),
        button("Stop", "F8", "stop", "abort end"),
        button("Disarm", "Shift+F5", "disarm"),
        button("Clear the fault", "Shift+F8", "clear"),
        add("Edit the plan", "Ctrl+L", live.show_plan, apart=True),
        add("Edit a plan of segments …", "Ctrl+Shift+G", live.edit_segments, also="step ramp sine loop profile"),
        add("Open a plan …", "Ctrl+Alt+O", live.plan.open),
        add("Save the plan …", "Ctrl+Alt+W", live.plan.save),
        add("Run a queue …", "Ctrl+Alt+Shift+Q", open_queue, apart=True, also="several runs one after the other"),
        add("Stop the queue", "Ctrl+Alt+Shift+S", model.run.queue.stop, lambda: model.run.queue.active),
        add("Manual pressure", "Ctrl+G", live.show_manual, also="set by hand"),
        add("Show the readings", "Ctrl+Shift+T", live.show_readings),
    ]


def calibration(window: MainWindow) -> list[Command]:
    """Return the commands of the calibration: analyse, sample, accept, report."""
    app_model, model = window.model, window.model.calibration
    add, on_page = partial(Command, "Runs"), partial(_on_page, window, Page.CALIBRATE)

    def open_file() -> None:
        ask_open(window, app_model.services, "Open a file", "boat csv tsv txt dat toml", window.open_file)

    def prepare_control() -> None:
        services = app_model.services
        ask_open(window, services, "A calibration run, or a step test", "boat", model.prepare_control)

    def acceptable() -> bool:
        return window.page is Page.CALIBRATE and not model.obstacle() and model.accepted is None

    def has_report() -> bool:
        return app_model.analysed_path(window.page) is not None

    def has_result() -> bool:
        return model.result is not None

    def edit_contributions() -> None:
        window.pages[Page.CALIBRATE].edit_contributions()

    def export() -> None:
        window.pages[Page.CALIBRATE].ask_export()

    def certify() -> None:
        window.pages[Page.CALIBRATE].show_certificate()

    def exportable() -> bool:
        return window.page is Page.CALIBRATE and model.exports()

    bands = "Compute uncertainty bands (emcee)"
    return [
        add("Calibrate with the last run", "Ctrl+Shift+A", on_page(model.analyse_current)),
        add("Open a file …", "Ctrl+O", open_file, also="recording csv import table plan profile"),
        add(bands, "Ctrl+Shift+M", on_page(model.sample), has_result, also="mcmc posterior sample"),
        add("Accept the calibration", "Ctrl+Return", model.request_acceptance, acceptable),
        add("Type B contributions …", "Ctrl+Alt+U", on_page(edit_contributions), has_result, also="uncertainty scale"),
        add(
            "Prepare the control of elongation …",
            "Ctrl+Alt+Shift+E",
            prepare_control,
            also="identify tune hysteresis gains",
        ),
        add("Export calibration …", "Ctrl+Alt+K", export, exportable, also="c matlab octave json code table"),
        add("Certificate …", "Ctrl+Alt+Z", certify, exportable, also="iso 17025 dcc pdf xml customer laboratory"),
        add("Report of the run shown …", "Ctrl+Shift+R", window.ask_report, has_report, also="pdf html print"),
    ]


def recordings(window: MainWindow) -> list[Command]:
    """Return the commands for the recordings that are selected on the Runs page."""

    def page() -> RunsPage:
        return cast(RunsPage, window.pages[Page.RUNS])

    def command(text: str, keys: str, key: str, entry: int = 0, *, apart: bool = False, also: str = "") -> Command:
        def available() -> bool:
            return window.page is Page.RUNS and bool(page().offers(key))

        def why() -> str:
            if window.page is not Page.RUNS:
                return "Go to the Runs page (Ctrl+4) and select a recording."
            return page().buttons[key].accessibleDescription() or "The selected recording does not need it."

        return Command("Runs", text, keys, lambda: page().press(key, entry), available, apart, why, also)

    return [
        command("Calibrate with the selected recording", "Ctrl+Alt+C", "open", apart=True),
        command("Repeatability of the selected recording", "Ctrl+Alt+R", "repeat"),
        command("Dynamics of its control …", "Ctrl+Alt+Shift+D", "dynamics", also="step response bode elongation"),
        command("Correct its readings …", "Ctrl+Alt+E", "readings"),
        command("Rename it …", "Ctrl+Alt+F", "rename"),
        command("Write a note on it …", "Ctrl+Alt+N", "note", also="comment"),
        command("State its metadata …", "Ctrl+Alt+I", "metadata", also="customer item serial number ambient"),
        command("Resume this run", "Ctrl+Alt+G", "resume"),
        command("Replay it in real time", "Ctrl+Alt+P", "replay"),
        command("Export it as CSV …", "Ctrl+Alt+X", "export"),
        command("Export it as Parquet …", "Ctrl+Alt+Q", "export", 1),
        command("Report of the selected runs …", "Ctrl+Alt+T", "report", also="pdf html print"),
        command("Compare the selected runs", "Ctrl+Alt+M", "compare"),
        command("The selected unit over time …", "Ctrl+Alt+Y", "unit", also="history due interval calibrations"),
        command("Recover the selected recordings", "Ctrl+Alt+V", "recover"),
    ]


def models(window: MainWindow) -> list[Command]:
    """Return the commands of the pages Optics, Shadow and Trade-off."""
    m = window.model
    add, on = partial(Command, "Models"), partial(_on_page, window)

    def next_colouring() -> None:
        names = list(SCALES)
        m.shadow.quantity = names[(names.index(m.shadow.quantity) + 1) % len(names)]

    def show_frame_time() -> None:
        m.shadow.show_cost = not m.shadow.show_cost

    def map_method() -> None:
        m.atlas.toggle(m.tradeoff.shown)

    return [
        *(add(f"Compute: {n}", f"Ctrl+Alt+{i}", partial(m.precision.choose, n)) for i, n in enumerate(LEVELS, 1)),
        add("Sweep all designs, or stop", "F9", on(Page.OPTICS, m.optics.toggle_sweep), apart=True),
        add("Optimise beyond the grid, or stop", "Shift+F9", on(Page.OPTICS, m.optics.toggle_search)),
        add("Next shadow colouring", "Ctrl+F9", next_colouring, apart=True),
        add("Show frame time", "Ctrl+Shift+F9", show_frame_time, also="cost shadow"),
        add("Measure this computer, or stop", "F12", on(Page.TRADE_OFF, m.tradeoff.toggle), apart=True),
        add("Map where the method fails, or stop", "Shift+F12", on(Page.TRADE_OFF, map_method)),
    ]


def pages(window: MainWindow) -> list[Command]:
    """Return the commands that show a page."""
    return [
        Command("Go", str(page), f"Ctrl+{i}", partial(window.go_by_key, page), also=CONTENTS.get(page, ""))
        for i, page in enumerate(Page, 1)
    ]


def help_(window: MainWindow) -> list[Command]:
    """Return the commands of the help menu."""
    add = partial(Command, "Help")

    def save_bug_report() -> None:
        name = f"boat-daq-report-{datetime.now(UTC).astimezone():%Y%m%d-%H%M%S}"
        ask_save(window, window.model.services, name, "zip", window.model.save_bug_report, done="")

    return [
        add("Find a command …", "Ctrl+Shift+P", window.palette_.open_fresh),
        add("Keys", "Ctrl+F1", window.show_keys, also="shortcuts help"),
        add("First steps", "F1", window.live.show_first_steps),
        add("Save a bug report …", "Ctrl+Shift+F1", save_bug_report),
    ]


def _on_page(window: MainWindow, page: Page, run: Callable[[], object]) -> Callable[[], None]:
    """Return a function that shows a page, then runs one of its actions."""

    def show_and_run() -> None:
        window.go(page)
        window.model.notices.attempt(run)

    return show_and_run
