"""Every command of the window with its keys, added to the window's registry."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import cast

from PySide6.QtWidgets import QApplication

from analysis.fidelity import LEVELS
from boat_daq.gui.live.units_panel import UnitsPanel
from boat_daq.gui.main_window import MainWindow
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.registry import PAGES, SELDOM, Command, always
from boat_daq.gui.results.metadata_form import MetadataForm
from boat_daq.gui.results.runs_page import RunsPage
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.open_windows import start_window
from boat_daq.viewmodels.common.services import PLACES, Page, Panel, Place, Tab
from boat_daq.viewmodels.live.shadow_live import SCALES
from boat_daq.viewmodels.results.metadata import MetadataModel

CONNECTED = "Disconnect the board first."
NO_CURVE = "Analyse a run with readings first."
NOT_NOW = {  # by the button of the run
    "arm": "End the run first.",
    "start": "Arm the plan first (F5).",
    "pause": "No run is in progress.",
    "stop": "No run is in progress.",
    "disarm": "No plan is armed.",
    "clear": "There is no fault.",
}
NO_GRID = "No plateau of the virtual board waits for a reading."
ON_MEASURE = "Go to Measure (Ctrl+1)."
NO_READING = "No plateau waits for a reading."
CONTENTS = {  # what an operator types to find a page or a tab
    Page.MEASURE: "live run plot",
    Page.RECORDINGS: "runs units export compare recover report history",
    Tab.CALIBRATION: "calibrate fit curve hysteresis",
    Tab.REPEATABILITY: "repeat drift hysteresis cycles",
    Tab.OPTICS: "light rays design cavities sweep",
    Tab.SHADOW: "actuator elongation monitor alarms",
    Tab.VALUES: "limits unit preferences options rate baud folder import export defaults settings",
    Tab.ACCURACY: "trade-off precision time error",
}


def register(window: MainWindow) -> None:
    menus = (session, edit, view, run, results, recordings, models, pages, help_)
    for command in (command for menu in menus for command in menu(window)):
        window.commands.add(command)


def session(window: MainWindow) -> list[Command]:
    model, strip = window.model, window.strip
    run, connection, attempt = model.run, model.connection, model.notices.attempt
    add, seldom = partial(Command, "Session"), _seldom

    def has_port() -> bool:
        return model.snapshot.port is not None

    def busy() -> bool:
        return bool(model.jobs.running())

    def state_metadata() -> None:
        units, unit = model.units.of(simulated=model.snapshot.simulated), model.unit.name(model.snapshot)
        path, about = model.snapshot.recording, (units, unit, model.undo)

        def show() -> None:
            stated = MetadataModel.of_unit(*about)
            if path is not None:
                stated = MetadataModel.of_session(model.session, path, *about)
            MetadataForm(window, stated, model.services).show()

        attempt(show)

    first = partial(add, shortcut="", available=run.trial.possible, why=lambda: CONNECTED)
    live = partial(add, available=model.connected, why=model.why_not)
    start = partial(attempt, connection.start_virtual_board)
    more, stamp = partial(attempt, start_window), "operator customer item serial note ambient"
    streams = "lsl secop outlet server network"
    return [
        add("Vent now", "F4", window.vent, also="emergency release deflate"),
        add("Vent all windows now", "Shift+F4", model.windows.vent_all, also="emergency release every board"),
        add("Close what is open, else vent", "Esc", window.escape, also="cancel escape"),
        add("Connect …", "Ctrl+K", partial(model.services.show, Panel.CONNECT), apart=True, also="port serial board"),
        first("Start the virtual board", run=start, also="demo simulate simulation"),
        first("Quick trial", run=partial(attempt, run.trial.start), also="demo"),
        add("Open a window for another board", "", more, also="second session new"),
        add("Streams and remote control …", "", window.show_outlets, also=streams),
        add("Disconnect", "", partial(attempt, connection.disconnect), has_port, why=lambda: "No board is connected."),
        live("Start or close the recording", "Ctrl+R", run.toggle_recording, apart=True),
        live("Add marker …", "Ctrl+M", window.live.ask_marker, also="mark note comment moment"),
        add("Metadata …", "", state_metadata, also=stamp),
        add("Close the window", "Ctrl+Q", window.leave, apart=True, also="quit exit leave"),
        seldom("Apply suggested action", strip.apply, strip.has_action, "No message offers one.", also="message do"),
        seldom("Dismiss message", strip.dismiss, strip.has_notice, "There is no message."),
        seldom("Cancel task", strip.cancel_job, busy, "No task is running.", also="work job stop"),
    ]


def edit(window: MainWindow) -> list[Command]:
    undo, attempt, live, run = window.model.undo, window.model.notices.attempt, window.live, window.model.run
    add, seldom = partial(Command, "Edit"), _seldom
    table, redo_keys = live.show_readings, "Ctrl+Shift+Z"
    return [
        add("Undo", "Ctrl+Z", partial(attempt, undo.undo), lambda: bool(undo.done), why=lambda: "Nothing to undo."),
        add("Redo", redo_keys, partial(attempt, undo.redo), lambda: bool(undo.undone), why=lambda: "Nothing to redo."),
        add("Simulate this reading", "F2", run.read_grid, run.may_read_grid, apart=True, why=lambda: NO_GRID),
        add("Read from a photograph …", "", live.open_photograph),
        add("Paste readings", "", lambda: table().paste()),
        add("Import readings …", "", lambda: table().import_()),
        seldom("Skip this reading", run.skip_reading, live.reading_is_due, NO_READING, also="without"),
        seldom("Simulate the reading at every plateau", run.toggle_read_all, also="all automatic grid elongation"),
        seldom("Show the readings", table),
    ]


def view(window: MainWindow) -> list[Command]:
    live, add, seldom = window.live, partial(Command, "View"), _seldom

    def show_units() -> None:
        if window.units_panel is None:
            choice, services = window.model.unit_choice, window.model.services
            window.units_panel = UnitsPanel(window, choice, services, window.follow_theme)
        window.units_panel.refresh()
        window.units_panel.show()
        window.units_panel.raise_()

    def is_measure() -> bool:
        return window.page is Page.MEASURE

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

    def in_theme(name: str) -> bool:
        return window.theme.name == name

    save, plots, theme = partial(export_plot, "png svg csv"), live.plots, window.choose_theme
    held = "hold pause picture"
    every = "psi bar volt percent celsius fahrenheit inch"
    return [
        add("Freeze or follow the plot", "Space", plots.toggle_freeze, is_measure, why=lambda: ON_MEASURE, also=held),
        seldom("Show the whole session", partial(live.model.set_window, math.inf)),
        add("Overlay the last cycles", "", live.toggle_overlay),
        add("Usual layout of the plots", "", live.use_usual_layout, apart=True, also="hidden axis show all"),
        add("Units of the values …", "", show_units, also=every),
        seldom("Copy the plot", partial(export_plot, "copy"), also="screenshot clipboard"),
        add("Save the plot …", "Ctrl+S", save, apart=True, also="screenshot picture image export png svg csv data"),
        add("Light", "", partial(theme, "light"), apart=True, also="day theme", checked=partial(in_theme, "light")),
        add("Dark", "", partial(theme, "dark"), also="night theme", checked=partial(in_theme, "dark")),
        add("Full screen", "", window.toggle_full_screen, checked=window.isFullScreen),
        seldom("Follow the system's theme", partial(theme, "system")),
        seldom("Cursor A", partial(plots.place_cursor, "a"), also="statistics measure"),
        seldom("Cursor B", partial(plots.place_cursor, "b"), also="statistics measure"),
    ]


def run(window: MainWindow) -> list[Command]:
    model, live = window.model, window.live
    add, seldom = partial(Command, "Run"), _seldom

    def button(text: str, keys: str, key: str, also: str = "", menu: str = "Run") -> Command:
        def allowed() -> bool:
            return key in model.sequence.allowed(model.run.snapshot)  # now: F6 may follow F5 at once

        def why() -> str:
            return NOT_NOW[key] if model.snapshot.can_command else model.why_not()

        return Command(menu, text, keys, partial(model.run.press, key), allowed, why=why, also=also)

    return [
        button("Arm the plan", "F5", "arm"),
        button("Start", "F6", "start", "begin run"),
        button("Pause", "F7", "pause"),
        add("Resume", "", model.run.resume, model.run.may_resume, why=lambda: "No run is paused."),
        button("Stop", "F8", "stop", "abort end"),
        button("Disarm", "", "disarm", menu=SELDOM),
        button("Clear the fault", "", "clear", menu=SELDOM),
        add("Manual pressure", "", live.show_manual, apart=True, also="set by hand elongation target"),
        add("Edit a plan of segments …", "", live.edit_segments, also="step ramp sine loop profile"),
        seldom("Open a plan …", live.plan.open),
        seldom("Save the plan …", live.plan.save),
        seldom("Edit the plan", live.show_plan, also="cycles staircase highest lowest wait readings"),
    ]


def results(window: MainWindow) -> list[Command]:
    """Return the commands of the calibration: analyse, sample, accept, report."""
    app_model, model = window.model, window.model.calibration
    add, seldom = partial(Command, "Results"), _seldom
    on_page = partial(_on_page, window, Tab.CALIBRATION)

    def open_file() -> None:
        ask_open(window, app_model.services, "Open a file", "boat csv tsv txt dat toml", window.open_file)

    def prepare_control() -> None:
        services = app_model.services
        ask_open(window, services, "A calibration run, or a step test", "boat", model.prepare_control)

    def acceptable() -> bool:
        return window.place is Tab.CALIBRATION and not model.obstacle() and model.accepted is None

    def not_acceptable() -> str:
        obstacle = model.obstacle()
        return str(obstacle) if obstacle else "It is accepted already." if model.accepted else "Go to Results first."

    def has_report() -> bool:
        return app_model.analysed_path(window.place) is not None

    def export() -> None:
        window.pages[Tab.CALIBRATION].ask_export()

    def certify() -> None:
        window.pages[Tab.CALIBRATION].show_certificate()

    kinds = "recording csv import table plan profile"
    bands, fitted = "mcmc posterior sample", partial(add, shortcut="", available=model.exports, why=lambda: NO_CURVE)
    last = partial(add, available=lambda: not model.no_last_run(), why=model.no_last_run, also="calibrate fit")
    shown = partial(add, available=has_report, why=lambda: "Analyse a run first.", also="pdf html print")

    return [
        add("Open a file …", "Ctrl+O", open_file, also=kinds),
        last("Analyse the last run", "", on_page(model.analyse_current)),
        add("Accept the calibration", "Ctrl+Return", model.request_acceptance, acceptable, why=not_acceptable),
        shown("Report of the run shown …", "", window.ask_report, apart=True),
        fitted("Certificate …", run=on_page(certify), also="iso 17025 dcc pdf xml customer laboratory"),
        fitted("Export calibration …", run=on_page(export), also="c matlab octave json code table"),
        add("Prepare the control of elongation …", "", prepare_control, also="identify tune hysteresis gains"),
        seldom(
            "Compute uncertainty bands (emcee)",
            on_page(model.sample),
            lambda: model.result is not None,
            NO_CURVE,
            also=bands,
        ),
    ]


def recordings(window: MainWindow) -> list[Command]:
    """Return the commands for the recordings that are selected on the page Recordings, whose menu lists them too."""

    def page() -> RunsPage:
        return cast(RunsPage, window.pages[Page.RECORDINGS])

    def command(text: str, key: str, entry: int = 0, *, also: str = "") -> Command:
        def available() -> bool:
            return window.page is Page.RECORDINGS and bool(page().offers(key))

        def why() -> str:
            if window.page is not Page.RECORDINGS:
                return "Go to the page Recordings (Ctrl+3) and select a recording."
            return page().why_not(key) or "The selected recording does not need it."

        return Command(SELDOM, text, "", lambda: page().press(key, entry), available, why=why, also=also)

    return [
        command("Analyse the selected recording", "open", also="calibrate repeatability"),
        command("Correct its readings …", "readings"),
        command("Rename it …", "rename"),
        command("Write a note on it …", "note", also="comment"),
        command("Add a marker to it …", "marker", also="event moment"),
        command("Enter its metadata …", "metadata", also="customer item serial number ambient"),
        command("Resume this run", "resume"),
        command("Export it as CSV …", "export"),
        command("Export it as Parquet …", "export", 1),
        command("Report of the selected runs …", "report", also="pdf html print"),
        command("Compare the selected runs", "compare"),
        command("The selected unit over time …", "unit", also="history due interval calibrations"),
        command("Recover the selected recordings", "recover"),
    ]


def models(window: MainWindow) -> list[Command]:
    """Return the commands of the tabs Optics, Shadow, and Speed and accuracy."""
    m, on = window.model, partial(_on_page, window)

    def next_colouring() -> None:
        names = list(SCALES)
        m.shadow.quantity = names[(names.index(m.shadow.quantity) + 1) % len(names)]

    return [
        *(_seldom(f"Precision: {n}", partial(m.precision.choose, n), also="precision") for n in LEVELS),
        _seldom("Sweep all designs, or stop", on(Tab.OPTICS, m.optics.toggle_sweep)),
        _seldom("Next shadow colouring", next_colouring),
        _seldom("Measure this computer, or stop", on(Tab.ACCURACY, m.tradeoff.toggle)),
    ]


def pages(window: MainWindow) -> list[Command]:
    go = window.go_by_key
    keys = {page: f"Ctrl+{i}" for i, page in enumerate(Page, 1)}
    places = dict.fromkeys((*Page, *PLACES))
    return [Command(PAGES, str(p), keys.get(p, ""), partial(go, p), also=CONTENTS.get(p, "")) for p in places]


def help_(window: MainWindow) -> list[Command]:
    add = partial(Command, "Help")

    def save_bug_report() -> None:
        name = f"boat-daq-report-{datetime.now(UTC).astimezone():%Y%m%d-%H%M%S}"
        ask_save(window, window.model.services, name, "zip", window.model.save_bug_report, done="")

    return [
        add("Find a command …", "Ctrl+Shift+P", window.palette_.open_fresh),
        add("Keys", "", window.show_keys, also="shortcuts help"),
        add("First steps", "F1", window.live.show_first_steps),
        add("Tutorial", "", partial(window.model.notices.attempt, window.show_tutorial), also="manual learn"),
        add("Save a bug report …", "", save_bug_report),
    ]


def _seldom(
    text: str, run: Callable[[], object], available: Callable[[], bool] = always, why: str = "", *, also: str = ""
) -> Command:
    return Command(SELDOM, text, "", run, available, why=lambda: why, also=also)


def _on_page(window: MainWindow, page: Place, run: Callable[[], object]) -> Callable[[], None]:
    """Return a function that shows a page or a tab, then runs one of its actions."""

    def show_and_run() -> None:
        window.go(page)
        window.model.notices.attempt(run)

    return show_and_run
