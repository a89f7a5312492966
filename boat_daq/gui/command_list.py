"""The list of all commands with their keys, handed to the registry of a window."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QApplication

from boat_daq.gui.model_commands import models
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.registry import Command, Registry
from boat_daq.gui.run_commands import bug_report, calibration, recordings
from boat_daq.viewmodels.app_model import PAGES
from boat_daq.viewmodels.common.notices import Level

if TYPE_CHECKING:
    from boat_daq.gui.main_window import MainWindow


def register(registry: Registry, window: MainWindow) -> None:
    """Add every command of `window`."""
    makers = (session, edit, view, sequence, calibration, recordings, models, pages, help_)
    for command in (command for make in makers for command in make(window)):
        registry.add(command)


def session(window: MainWindow) -> list[Command]:
    """Return the commands of the link and the recording."""
    desk = window.desk
    return [
        Command("Session", "Vent now", "Esc", window.vent),
        Command("Session", "Connect …", "Ctrl+K", desk.ask_connect, apart=True),
        Command("Session", "Start the virtual board", "Ctrl+Shift+B", desk.start_virtual_board),
        Command("Session", "Disconnect", "Ctrl+Shift+K", desk.disconnect, lambda: desk.snapshot.port is not None),
        Command("Session", "Start or close the recording", "Ctrl+R", desk.toggle_recording, desk.connected, apart=True),
        Command("Session", "Mark this moment …", "M", window.live.ask_marker, desk.connected),
        Command(
            "Session", "Do what the message proposes", "Ctrl+J", window.strip.do_it, window.strip.offers, apart=True
        ),
        Command("Session", "Dismiss the message", "Ctrl+D", window.strip.dismiss, window.strip.stands),
        Command("Session", "Cancel the work under way", "Ctrl+.", window.strip.cancel_work, window.strip.works),
        Command("Session", "Close the window", "Ctrl+Q", window.leave, apart=True),
    ]


def edit(window: MainWindow) -> list[Command]:
    """Return the commands of undo and of the readings."""
    stack = window.undo.stack
    return [
        Command("Edit", "Undo", "Ctrl+Z", stack.undo, stack.canUndo),
        Command("Edit", "Redo", "Ctrl+Shift+Z", stack.redo, stack.canRedo),
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
            window.desk.notices.say(Level.WARNING, "no plot is shown", "Go to a page that shows one.")
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
    desk = window.desk

    def button(text: str, keys: str, key: str, *, apart: bool = False) -> Command:
        return Command(
            "Sequence", text, keys, lambda: desk.press(key), lambda: key in desk.sequence.allowed(desk.snapshot), apart
        )

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


def pages(window: MainWindow) -> list[Command]:
    """Return the commands that go to a page."""
    return [Command("Go", name, f"Ctrl+{i}", partial(window.go_to_work, name)) for i, name in enumerate(PAGES, 1)]


def help_(window: MainWindow) -> list[Command]:
    """Return the commands that help."""
    return [
        Command("Help", "Find a command …", "Ctrl+Shift+P", window.show_palette),
        Command("Help", "Keys", "?", window.show_keys),
        Command("Help", "First steps", "F1", window.show_first_steps),
        Command("Help", "Save a bug report …", "Ctrl+Shift+F1", partial(bug_report, window)),
    ]
