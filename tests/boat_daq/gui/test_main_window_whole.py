"""A window with every page made: pages, themes, names of controls, commands."""

from __future__ import annotations

import re

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence, QShortcut
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QProgressBar,
    QSpinBox,
    QWidget,
)

from boat_daq.gui import style
from boat_daq.gui.command_palette import shown
from boat_daq.viewmodels.common.services import PLACES, page_of
from tests.boat_daq.gui.windows import run_command, shared_window

PANELS = (
    "Connect …", "Streams and remote control …", "Metadata …", "Read from a photograph …",
    "Units of the values …", "Edit a plan of segments …",
    "Find a command …",
)  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory, qapp):
    """A window on a connected board with every page made; the module opens no other one, which would be slow."""
    with shared_window(tmp_path_factory.mktemp("whole")) as window:
        window.model.optics.choose = lambda *_: None  # no helper process traces
        for name in PLACES:
            window.open_page(name)
        yield window


def test_every_page_opens(whole):
    """Each page of the navigation can be gone to and refreshed."""
    for name in PLACES:
        whole.go(name)
        whole.refresh()
        assert whole.place == name
        assert whole.navigation.buttons[page_of(name)].isChecked()


def test_tabs_of_a_page_are_shown_and_kept(whole):
    """A click on a tab shows it; the page comes back with the tab that was left."""
    whole.go("Results")
    assert [whole.tabs.tabText(i) for i in range(whole.tabs.count())] == ["Calibration", "Repeatability"]
    QApplication.processEvents()
    QTest.mouseClick(whole.tabs, Qt.MouseButton.LeftButton, pos=whole.tabs.tabRect(1).center())
    assert whole.place == "Repeatability"
    whole.go("Measure")
    assert not whole.tab_row.isVisible()
    whole.go("Results")
    assert (whole.place, whole.tabs.currentIndex(), whole.tab_row.isVisible()) == ("Repeatability", 1, True)
    whole.choose("Calibration")
    assert whole.place == "Calibration"
    whole.go("Program and units")
    whole.choose("Repeatability")  # of a page that is not shown
    assert whole.place == "Program and units"
    whole.go("Results")
    assert whole.place == "Repeatability"


def test_theme_repaints_without_an_error(whole):
    """Light and dark can be changed at any time, with every page open."""
    for name in PLACES:
        whole.go(name)
    whole.set_theme(style.DARK)
    assert whole.styleSheet() == style.style_sheet(style.DARK)
    assert whole.live.plots.theme is style.DARK
    whole.set_theme(style.LIGHT)
    assert whole.live.plots.theme is style.LIGHT


def test_tab_goes_from_the_header_over_the_page_to_the_strip(whole):
    """Messages came before the page on all pages that were opened later."""
    for name in ("Measure", "Calibration", "Program and units"):
        whole.go(name)
        chain = [whole]
        while (after := chain[-1].nextInFocusChain()) is not whole:
            chain.append(after)
        where = [
            next((i for i, part in enumerate((whole.header, whole.stack, whole.strip)) if part.isAncestorOf(w)), None)
            for w in chain
            if w.focusPolicy() & Qt.FocusPolicy.TabFocus and w.isVisible()
        ]
        found = [i for i in where if i is not None]
        assert found == sorted(found)
        assert {0, 1, 2} <= set(found)


def test_every_widget_that_shows_or_takes_has_a_name(whole):
    """Tables, sliders, bars and text fields too: a screen reader can name each."""
    kinds = (QAbstractItemView, QAbstractSlider, QPlainTextEdit, QProgressBar, QSpinBox)
    nameless = [
        f"{type(w).__name__} in {type(w.parent()).__name__}"
        for w in whole.findChildren(QWidget)
        if isinstance(w, kinds)
        and not w.accessibleName()
        and not w.objectName().startswith("qt_")
        and type(w).__name__ not in ("QScrollBar", "QHeaderView", "QComboBoxListView", "QListView")
    ]
    assert nameless == []


def test_no_text_is_longer_than_a_line(whole):
    """Of tooltips, labels and lists, in pages and panels: 120 characters are a line of a small window."""
    for panel in PANELS:
        run_command(whole, panel)
    shown = {w.toolTip() for w in whole.findChildren(QWidget)}
    shown |= {w.text() for kind in (QLabel, QAbstractButton) for w in whole.findChildren(kind)}
    shown |= {w.placeholderText() for kind in (QLineEdit, QPlainTextEdit) for w in whole.findChildren(kind)}
    shown |= {action.toolTip() for action in whole.findChildren(QAction)}
    lines = {line for text in shown for line in re.sub("<br>|<p>", "\n", text).splitlines()}
    for dialog in whole.findChildren(QDialog):
        dialog.close()
    assert [line for line in lines if len(re.sub("<[^>]*>", "", line)) > 120] == []


def test_every_control_has_an_accessible_name(whole):
    """A screen reader can name every button, field and choice."""
    nameless = [
        f"{type(widget).__name__} {widget.toolTip()} in {widget.parent()}"
        for widget in whole.findChildren(QWidget)
        if isinstance(widget, QAbstractButton | QLineEdit | QComboBox)
        and not isinstance(widget.parent(), QAbstractSpinBox)
        and not (widget.accessibleName() or (isinstance(widget, QAbstractButton) and widget.text()))
        and not widget.objectName().startswith("qt_")
    ]
    assert nameless == []


def test_menus_sheet_and_keys_are_made_of_the_commands(whole):
    """Walk all actions of the menu bar: each is a command, and the sheet names those with keys."""
    letters = [action.text().partition("&")[2][0] for action in whole.menuBar().actions()]
    assert len(set(letters)) == len(letters)  # else Alt and a letter opens now one menu, now another
    actions = [
        action for menu in whole.menuBar().actions() for action in menu.menu().actions() if not action.isSeparator()
    ]
    commands = whole.commands.actions
    entries = ["\t".join(filter(None, (c.text, shown(c)))) for m in menus(whole) for c in commands if c.menu == m]
    assert [a.text() for a in actions] == entries
    assert {a for a in whole.findChildren(QAction) if a.shortcut().toString()} == set()
    keys = {shortcut.key().toString() for shortcut in whole.findChildren(QShortcut)}
    assert {QKeySequence(c.shortcut).toString() for c in commands if c.shortcut} <= keys
    whole.show_keys()
    texts = {label.text() for label in whole.keys.findChildren(QLabel)}
    assert {text for c in commands if c.shortcut for text in (c.text, shown(c))} <= texts


def menus(window):
    return [action.text().replace("&", "") for action in window.menuBar().actions()]


def test_every_action_of_the_recordings_is_a_command(whole):
    """What a button or the menu of the list does, the palette finds."""
    page = whole.pages["Recordings"]
    texts = [c.text for c in whole.commands.actions if "Recordings" in c.why()]
    assert len(texts) == len(page.buttons) + len(page.actions_) + 1  # an export is of two kinds
