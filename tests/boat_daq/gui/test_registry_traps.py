"""Keys in a real window: each does what its command says, wherever the focus is, and nothing else."""

from __future__ import annotations

from functools import partial
from itertools import product

import pytest
from PySide6.QtCore import QEvent, QObject, QPoint, QRect, Qt
from PySide6.QtGui import QGuiApplication, QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QPushButton, QTableView

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import SessionState
from boat_daq.gui.widgets.text_dialog import TextDialog
from boat_daq.viewmodels.common.services import PLACES, Page, Panel
from boat_daq.workflows import jobs
from tests.boat_daq.gui.windows import PATIENCE_MS, RAMPING, choose, run_command
from tests.conftest import mostly_at_night

Key = Qt.Key
NO, CTRL = Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ControlModifier
PRINTED = [Key(code) for code in range(Key.Key_Space.value, Key.Key_AsciiTilde.value + 1) if code < 0x60 or code > 0x7A]
NAMED = [
    Key.Key_Tab, Key.Key_Backtab, Key.Key_Backspace, Key.Key_Return, Key.Key_Enter, Key.Key_Insert, Key.Key_Delete,
    Key.Key_Home, Key.Key_End, Key.Key_Left, Key.Key_Up, Key.Key_Right, Key.Key_Down, Key.Key_PageUp, Key.Key_PageDown,
    Key.Key_Escape, *(Key(Key.Key_F1.value + i) for i in range(12)),
]  # fmt: skip
RUN_KEYS = {  # the only keys that reach the session, and with what
    "idle": {Key.Key_Escape: ["vent"], Key.Key_F4: ["vent"], Key.Key_F5: ["arm"]},
    "running": {Key.Key_Escape: ["vent"], Key.Key_F4: ["vent"], Key.Key_F7: ["pause"], Key.Key_F8: ["stop"]},
}


class NoProcess:
    """In place of the helper processes: a job that never ends."""

    def __init__(self, *_, **__):
        self.start = self.terminate = self.close = lambda: None
        self.join = self.poll = lambda *_: False


@pytest.fixture
def front(live, qtbot, monkeypatch):
    """A window in front; its jobs do not run."""
    monkeypatch.setattr(jobs._SPAWN, "Process", NoProcess)
    monkeypatch.setattr(jobs._SPAWN, "Pipe", lambda **_: (NoProcess(), NoProcess()))
    live.resize(1280, 800)
    live.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live, timeout=PATIENCE_MS)
    for timer in (live.frame_timer, live.calm_timer):
        timer.stop()  # the tests refresh themselves
    return live


def press(window, key, modifier=NO):
    """Press a key where the keyboard is, and let what follows happen."""
    QTest.keyClick(QGuiApplication.focusWindow() or window.windowHandle(), key, modifier)
    QApplication.processEvents()


def close_all(window):
    """Close what a key has opened."""
    while (popup := QApplication.activePopupWidget()) is not None:
        popup.close()
    for dialog in window.findChildren(QDialog):
        dialog.close()
    window.live.close_marker()
    window.strip.close_details()
    window.live.overlaid = False
    if window.isFullScreen():
        window.toggle_full_screen()
    window.activateWindow()
    QApplication.processEvents()


def run(window):
    """Bring the window into a run, between two plateaus."""
    window.model.sequence._needs_readings = True
    window.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    window.refresh()


@pytest.mark.parametrize("state", mostly_at_night("running", "idle"))
@pytest.mark.parametrize("everywhere", mostly_at_night(False, True))
def test_no_key_commands_the_board_but_the_documented_one(front, state, everywhere):
    """Press every key with the focus nowhere and on the plots, and Space after each: none acts by where focus fell.

    Keys are pressed on the live page and each on one of the others; at night those with a name on all of them.
    """
    if state == "running":
        run(front)
    calls, documented = front.model.session.calls, RUN_KEYS[state]
    wrong = []
    keys, rest = [*PRINTED, *NAMED], [page for page in PLACES if page is not Page.MEASURE]
    pressed = [(Page.MEASURE, key) for key in keys]
    for i, page in enumerate(rest):
        once = keys[i :: len(rest)]
        pressed += [(page, key) for key in dict.fromkeys([*once, *(NAMED if everywhere else [])])]
    for (page, key), clicked in product(pressed, (False, True)):
        if clicked and page is not Page.MEASURE:
            continue
        front.go(page)
        front.refresh()
        if (focus := QApplication.focusWidget()) is not None:
            focus.clearFocus()
        plot = front.live.plots.view
        if clicked and plot.isVisible():
            QTest.mouseClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=QPoint(80, 60))
        calls.clear()
        press(front, key)
        front.refresh()
        commanded = list(calls)
        calls.clear()
        after = "" if key in (Key.Key_Tab, Key.Key_Backtab) else press_space(front)
        if commanded != documented.get(key, []) or calls or after:
            wrong.append((page, key.name, clicked, commanded, list(calls), after))
        close_all(front)
    assert wrong == []


def press_space(window) -> str:
    """Press Space; return what it should not have done."""
    following, page, focus = window.model.live.following, window.page, QApplication.focusWidget()
    running = len(window.model.jobs.running())
    over = is_open(window)
    typing = hasattr(focus, "isReadOnly") and not focus.isReadOnly() and focus.property("role") != "reading"
    press(window, Key.Key_Space)
    froze = window.model.live.following is not following
    if over:
        return ""
    if len(window.model.jobs.running()) > running:
        return f"started a job with the focus on {focus}"
    return "" if froze is (page is Page.MEASURE and not typing) else f"froze {froze} with the focus on {focus}"


def test_space_freezes_after_the_plot_is_clicked_and_overlaid(front):
    """Click the plot, press the key of the overlay, then Space: the focus fell on Pause, and Space vented the run."""
    run(front)
    QTest.mouseClick(front.live.plots.view.viewport(), Qt.MouseButton.LeftButton, pos=QPoint(80, 60))
    run_command(front, "Overlay the last cycles")
    front.refresh()
    QApplication.processEvents()
    assert QApplication.focusWidget() is None
    press(front, Key.Key_Space)
    assert (front.model.live.following, front.model.session.calls) == (False, [])


def test_focus_is_nowhere_at_the_start(front):
    """The connection's button had the focus of a new window: the first Space opened its panel."""
    assert QApplication.focusWidget() is None


def test_tab_reaches_the_buttons_of_the_run(front):
    """What the focus does not fall on, the keyboard still reaches; Enter presses it, Space freezes the plots."""
    run(front)
    pause = front.live.sequence.buttons["pause"]
    for _ in range(60):
        press(front, Key.Key_Tab)
        if QApplication.focusWidget() is pause:
            break
    assert QApplication.focusWidget() is pause
    assert (QApplication.activeWindow(), QApplication.activePopupWidget()) == (front, None)
    press(front, Key.Key_Space)
    assert (front.model.live.following, front.model.session.calls) == (False, [])
    press(front, Key.Key_Return)
    assert front.model.session.calls == ["pause"]


class ShownWindows(QObject):
    """Records the widgets that are shown as windows."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def eventFilter(self, watched, event):
        """Record; nothing is handled here."""
        if event.type() is QEvent.Type.Show and watched.isWidgetType() and watched.isWindow():
            self.seen.append(type(watched).__name__)
        return False


def test_space_presses_the_focused_button_of_other_pages_and_does_nothing_else(front):
    """Each button of each page but Live is pressed once; the plots are not frozen, the board not commanded.

    While a page was made, parts of it without a parent were windows for a moment, which took the keyboard from it.
    """
    shown = ShownWindows()
    QApplication.instance().installEventFilter(shown)
    for page in PLACES:
        front.go(page)
    QApplication.instance().removeEventFilter(shown)
    assert (shown.seen, QApplication.activeWindow()) == ([], front)
    pressed, wrong, calls = 0, [], front.model.session.calls
    for page in (page for page in PLACES if page is not Page.MEASURE):
        front.go(page)
        for button in front.pages[page].findChildren(QPushButton):
            front.go(page)
            if not (button.isVisible() and button.isEnabled()):
                continue
            clicked: list[str] = []
            button.clicked.connect(partial(clicked.append, button.text()))
            choose(front, button)
            press(front, Key.Key_Space)
            pressed += 1
            if (clicked, calls, front.model.live.following) != ([button.text()], [], True):
                wrong.append((page, button.text(), clicked, list(calls), front.model.live.following))
            close_all(front)
    assert wrong == []
    assert pressed >= 8


def complete(window):
    """Type into the field of the port until its list of completions is open."""
    window.show_place(Panel.CONNECT)
    port = window.connect_panel.port
    port.addItem("port 1")
    port.lineEdit().setFocus()
    QTest.keyClicks(port.lineEdit(), "po")


OPENED = {
    "menu": lambda window: window.menuBar().actions()[0].menu().popup(window.mapToGlobal(QPoint(5, 20))),
    "menu by key": lambda window: press(window, Key.Key_S, Qt.KeyboardModifier.AltModifier),
    "palette": lambda window: window.palette_.open_fresh(),
    "list": lambda window: window.live.window_choice.showPopup(),
    "connect": lambda window: window.show_place(Panel.CONNECT),
    "keys": lambda window: window.show_keys(),
    "photograph": lambda window: window.live.open_photograph(),
    "marker": lambda window: window.live.ask_marker(),
    "messages": lambda window: window.strip.messages.click(),
}
ALSO = {
    "overlay": lambda window: run_command(window, "Overlay the last cycles"),
    "menu of a plot": lambda window: window.live.plots.view.customContextMenuRequested.emit(QPoint(200, 60)),
    "menu of a table": lambda window: window.live.show_readings().view.customContextMenuRequested.emit(QPoint(9, 9)),
    "cell": lambda window: window.live.table.view.edit(window.live.show_readings().model.index(0, 3)),
    "tutorial": lambda window: window.show_tutorial(),
    "text": lambda window: TextDialog(window, "Note", "Note on it.", "", "Save", bool),
    "completions": complete,
}
DIALOGS = {
    "segments": lambda window: window.show_place(Panel.SEGMENTS),
    "outlets": lambda window: window.show_place(Panel.OUTLETS),
    "import": lambda window: window.import_panel.show(),
    "units": lambda window: run_command(window, "Units of the values \u2026"),
    "metadata": lambda window: run_command(window, "Metadata \u2026"),
    "file": lambda window: run_command(window, "Open a plan \u2026"),
}
OFF_PAGE = {
    "navigation": lambda window: window.navigation.buttons[Page.MEASURE],
    "header": lambda window: window.header.link,
    "strip": lambda window: window.strip.messages,
    "menu bar": lambda window: window.menuBar(),
}


def escapes(window, qtbot, name) -> list[tuple[bool, bool]]:
    """Press Esc until it vents; return for each press whether the page alone had the keyboard, and whether it vented.

    A press that vents ends it, with five at most.
    """
    calls, seen = window.model.session.calls, []
    for _ in range(5):
        focus = QApplication.focusWidget()
        alone = not is_open(window) and (focus is None or window.stack.isAncestorOf(focus))
        calls.clear()
        press(window, Key.Key_Escape)
        seen.append((alone, calls == ["vent"]))
        if calls:
            break
        if not is_open(window):
            to_front(window, qtbot)
    calls.clear()
    return seen


def test_escape_vents_only_with_nothing_open_and_the_focus_on_the_page(front, qtbot):
    """Nobody closes a menu to stop a pump, nor presses Esc twice to do so: both ended runs."""
    run(front)
    front.model.session.marks = (StepMark(1, 1, "unloading", 20.0, 10.0, 0),)  # a line of the table of readings
    wrong = {}
    for name in (*OPENED, *DIALOGS, *ALSO):
        open_(front, qtbot, name)
        seen = escapes(front, qtbot, name)
        if any(alone is not vented for alone, vented in seen) or seen[0][1] or not seen[-1][1]:
            wrong[name] = seen
        close_all(front)
        to_front(front, qtbot)
    for name, place in OFF_PAGE.items():
        choose(front, place(front))
        seen = escapes(front, qtbot, name)
        if seen != [(False, False), (True, True)]:
            wrong[name] = seen
    assert wrong == {}
    field = front.live.plan.target
    front.live.pane.setCurrentWidget(front.live.plan)
    field.setFocus()
    QTest.keyClicks(field, "12")
    press(front, Key.Key_Escape)
    assert (front.model.session.calls, field.text()) == ([], "0")  # the typing is undone
    assert escapes(front, qtbot, "field") == [(True, True)]


def test_escape_closes_a_dialog_behind_the_window(front, qtbot):
    """Its dialog may be hidden by the window that has the keyboard: it is closed before anything is vented."""
    run(front)
    open_(front, qtbot, "keys")
    to_front(front, qtbot)
    assert escapes(front, qtbot, "keys") == [(False, False), (True, True)]


@pytest.mark.parametrize("size", [(853, 600), pytest.param((1280, 800), marks=pytest.mark.nightly)])
def test_no_dialog_covers_vent(front, qtbot, size):
    """Certificate and Keys did, at 1280 x 800; one that is dragged over it gives way."""
    front.resize(*size)
    front.move(0, 0)
    QApplication.processEvents()
    head = QRect(front.header.mapToGlobal(QPoint(0, 0)), front.header.size())
    covering = []
    for name in ("connect", "keys", "photograph", *DIALOGS):
        open_(front, qtbot, name)
        dialog = next(each for each in front.findChildren(QDialog) if each.isVisible())
        for at in (None, QPoint(front.width() // 2, 0)):
            if at is not None:
                dialog.move(at)
            QApplication.processEvents()
            if dialog.frameGeometry().intersects(head):
                covering.append((name, at, dialog.frameGeometry()))
        close_all(front)
        to_front(front, qtbot)
    assert covering == []


def test_vent_key_and_button_vent_whatever_is_open(front, qtbot):
    """F4 vents over everything, and leaves it open; a press of the button vents too."""
    run(front)
    calls, seen = front.model.session.calls, []
    for name in OPENED:
        open_(front, qtbot, name)
        press(front, Key.Key_F4)
        seen.append((name, is_open(front), list(calls)))
        calls.clear()
        close_all(front)
        to_front(front, qtbot)
    assert seen == [(name, True, ["vent"]) for name in OPENED]
    QTest.mousePress(front.header.vent, Qt.MouseButton.LeftButton)
    assert calls == ["vent"]
    for name in ("menu", "palette", "list"):  # Qt gives the click to the popup, and only closes it
        calls.clear()
        open_(front, qtbot, name)
        front.window_keys.watch_all()
        popup, vent = QApplication.activePopupWidget(), front.header.vent
        at = popup.mapFromGlobal(vent.mapToGlobal(vent.rect().center()))
        QTest.mousePress(popup.windowHandle(), Qt.MouseButton.LeftButton, NO, at)
        assert calls == ["vent"], name
        close_all(front)
        to_front(front, qtbot)


def test_menu_gives_the_keyboard_back_where_nothing_had_it(front):
    """The menu bar kept it behind the dialog that was opened: after it letters opened menus."""
    press(front, Key.Key_V, Qt.KeyboardModifier.AltModifier)
    press(front, Key.Key_Return)
    assert (QApplication.activePopupWidget(), front.model.live.following) == (None, False)
    assert QApplication.focusWidget() is None


def test_escape_vents_after_a_command_of_the_palette(front, qtbot):
    """In a run without readings its hidden field kept the keyboard, and the first Esc vented nothing."""
    front.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    front.refresh()
    open_(front, qtbot, "palette")
    QTest.keyClicks(front.palette_.field, "zoom in on time")
    press(front, Key.Key_Return)
    assert QApplication.focusWidget() is None
    assert escapes(front, qtbot, "after the palette") == [(True, True)]


def test_what_is_typed_counts_for_the_next_command(front):
    """3 cycles were typed, F5 armed the 5 before them, and the form then showed 3."""
    armed = []
    front.model.session.arm = lambda plan, **_: armed.append(plan.cycles)
    front.live.pane.setCurrentWidget(front.live.plan)
    field = front.live.plan.fields["cycles"]
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, "3")
    press(front, Key.Key_F5)
    assert armed == [3]


def open_(window, qtbot, name):
    """Open something, and wait until it has the keyboard."""
    (OPENED | DIALOGS | ALSO)[name](window)
    qtbot.waitUntil(lambda: is_open(window), timeout=PATIENCE_MS)
    if name not in ("marker", "messages", "overlay", "cell"):
        main = window.windowHandle()
        qtbot.waitUntil(lambda: QGuiApplication.focusWindow() not in (None, main), timeout=PATIENCE_MS)


def to_front(window, qtbot):
    """Give the keyboard to the window, as a window system does when a panel is closed."""
    window.activateWindow()
    qtbot.waitUntil(lambda: QGuiApplication.focusWindow() is window.windowHandle(), timeout=PATIENCE_MS)


def is_open(window):
    """Return whether a menu, a list, a panel or the marker's field is open."""
    dialogs = any(dialog.isVisible() for dialog in window.findChildren(QDialog))
    editing = window.live.table.view.state() is QTableView.State.EditingState
    shown = window.live.marker.isVisible() or window.strip.is_open() or window.live.overlaid or editing
    return QApplication.activePopupWidget() is not None or dialogs or shown


def test_keys_work_after_a_menu_was_closed_by_a_click_elsewhere(front):
    """F6 was dead after the Sequence menu had been looked at and clicked away."""
    bar, calls = front.menuBar(), front.model.session.calls
    front.model.session.change(state=SessionState.ARMED)
    seen = []
    for action in bar.actions():
        front.model.session.change(state=SessionState.IDLE)
        QTest.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.actionGeometry(action).center())
        QApplication.processEvents()
        opened = QApplication.activePopupWidget()
        QTest.mouseClick(opened, Qt.MouseButton.LeftButton, pos=QPoint(-40, opened.height() + 60))
        QApplication.processEvents()
        front.model.session.change(state=SessionState.ARMED)
        front.refresh()
        closed = QApplication.activePopupWidget() is None
        press(front, Key.Key_F6)
        seen.append((opened is action.menu(), closed, list(calls)))
        calls.clear()
    assert seen == [(True, True, ["start_recording", "start"])] * len(bar.actions())


def test_no_command_is_a_plain_character(front):
    """Letters of commands went into the reading: a command has a modifier or is no character."""
    in_field = []
    for command in (command for command in front.commands.actions if command.shortcut):
        combination = QKeySequence(command.shortcut)[0]
        text = QKeySequence(combination.key()).toString()
        if combination.keyboardModifiers() in (NO, Qt.KeyboardModifier.ShiftModifier) and len(text) == 1:
            in_field.append(command.text)
    assert in_field == []
