"""Small makers of the controls that every page uses, so that a page reads as what it shows.

Rules: a control has an accessible name (its text, where it has one); a role names its look in the style sheet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from html import escape
from typing import Any, TypeVar

from PySide6.QtCore import QSize, Qt, QTimer
from PySide6.QtGui import QCursor, QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QMenu,
    QPushButton,
    QSizePolicy,
    QStyle,
    QStyleOptionComboBox,
    QTabWidget,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from boat_daq.gui import style
from protocol.base.units import unbroken

Item = QWidget | QLayout | int | None | tuple[QWidget | QLayout, int]
"""A part of a row or column: a widget or layout, with its share of the length or without; a space; None a stretch."""
Margins = tuple[int, int, int, int]
"""Left, top, right, bottom."""
W = TypeVar("W", bound=QWidget)
Box = TypeVar("Box", bound=QBoxLayout)


class ElidedLabel(QLabel):
    """A label that is cut with an ellipsis where it does not fit, and never widens its page.

    `least` is its smallest width, where its text is not shorter; `shorter` is shown before the text is cut.
    """

    least = 0
    shorter = ""
    explanation = ""

    def explain(self, words: str) -> None:
        """Say `words` on hover, below the whole text where that is cut."""
        self.explanation = words
        self.setAccessibleDescription(words)

    def minimumSizeHint(self) -> QSize:
        hint = super().minimumSizeHint()
        return QSize(min(self.least, hint.width()), hint.height())

    def fitting(self, width: int) -> str:
        """Return what is shown in a width: the text, else the shorter one, else either cut, line by line."""
        metrics = self.fontMetrics()
        fits = all(metrics.horizontalAdvance(line) <= width for line in self.text().split("\n"))
        lines = (self.text() if fits else self.shorter or self.text()).split("\n")
        return "\n".join(metrics.elidedText(line, Qt.TextElideMode.ElideRight, width) for line in lines)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the text, cut where it must be; the tooltip then shows the whole of it."""
        area = self.contentsRect()
        shown = self.fitting(area.width())
        painter = QPainter(self)
        self.style().drawItemText(
            painter, area, int(self.alignment()), self.palette(), self.isEnabled(), shown, self.foregroundRole()
        )
        painter.end()
        cut = as_words(self.text()) if shown != self.text() else ""
        self.setToolTip("\n".join(part for part in (cut, self.explanation) if part))


class WrappedLabel(QLabel):
    """A label of several lines, none of which ends between a value and its unit; `text` is as it was set."""

    def __init__(self) -> None:
        super().__init__()
        self._set = ""
        self.setWordWrap(True)

    def text(self) -> str:
        return self._set

    def setText(self, text: str) -> None:
        self._set = text
        super().setText(unbroken(text))


class Choice(QComboBox):
    """A choice whose text is cut with an ellipsis where it does not fit."""

    def initStyleOption(self, option: QStyleOptionComboBox) -> None:
        super().initStyleOption(option)
        part = QStyle.SubControl.SC_ComboBoxEditField
        width = self.style().subControlRect(QStyle.ComplexControl.CC_ComboBox, option, part, self).width()
        option.currentText = self.fontMetrics().elidedText(self.currentText(), Qt.TextElideMode.ElideRight, width)


def label(
    text: str = "", role: str = "", *, name: str = "", wrap: bool = False, elide: bool = False, least: int = 0
) -> QLabel:
    """Return a label in one of the roles title, subtitle, muted, small, set; `elide` as `ElidedLabel`."""
    widget = ElidedLabel() if elide else WrappedLabel() if wrap else QLabel()
    if isinstance(widget, ElidedLabel):
        widget.least = least
    widget.setTextFormat(Qt.TextFormat.PlainText)
    widget.setText(text)
    return _dressed(widget, role, name)


def button(text: str, on_click: Callable[[], Any], role: str = "", *, name: str = "", tip: str = "") -> QPushButton:
    """Return a button; role primary is the one next step of a page."""
    widget = QPushButton(text)
    widget.setAutoDefault(False)
    widget.clicked.connect(lambda *_: on_click())
    return _dressed(widget, role, name or text, tip)


def field(
    name: str, text: str = "", on_enter: Callable[[], object] | None = None, *, placeholder: str = "", width: int = 0
) -> QLineEdit:
    """Return a text field named for a screen reader."""
    widget = QLineEdit(text)
    widget.setAcceptDrops(False)  # the window opens a file that is dropped on a field
    widget.setPlaceholderText(placeholder)
    if width:
        widget.setFixedWidth(width)
    if on_enter:
        widget.returnPressed.connect(on_enter)
    widget.editingFinished.connect(partial(widget.setModified, False))  # a plateau may take the focus again
    return _dressed(widget, "", name)


def choice(
    name: str, entries: Iterable[tuple[str, Any]], on_choice: Callable[[Any], object] | None = None, *, tip: str = ""
) -> QComboBox:
    """Return a choice of (text, value) entries; `on_choice` is called with the value that the operator chooses."""
    widget = Choice()
    widget.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
    for text, value in entries:
        widget.addItem(text, value)
    if on_choice:
        widget.activated.connect(lambda i: on_choice(widget.itemData(i)))
    return _dressed(widget, "", name, tip)


def card(*items: Item) -> tuple[QFrame, QVBoxLayout]:
    """Return a framed surface and its layout, a column of `Item`s."""
    frame, layout = QFrame(), column(*items)
    as_card(frame, layout)
    return frame, layout


def as_card(frame: QFrame, layout: QLayout) -> None:
    frame.setObjectName("card")
    layout.setContentsMargins(style.CARD_PADDING, style.GAP, style.CARD_PADDING, style.GAP)
    frame.setLayout(layout)


def add_menu(button: QPushButton | QToolButton, menu: QMenu) -> None:
    """Open `menu` by `button`, which is no longer tinted after a choice or a click elsewhere: Qt tells it too late."""

    def end_hover() -> None:
        inside = button.rect().contains(button.mapFromGlobal(QCursor.pos()))
        button.setAttribute(Qt.WidgetAttribute.WA_UnderMouse, inside)
        button.update()

    button.setMenu(menu)
    menu.aboutToHide.connect(lambda: QTimer.singleShot(0, button, end_hover))


def menu_button(text: str, tip: str) -> QToolButton:
    made = QToolButton()
    made.setText(text)
    made.setToolTip(tip)
    made.setAccessibleName(text)
    made.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
    add_menu(made, QMenu(made))
    made.setFixedHeight(style.CONTROL_HEIGHT)  # as high as the buttons beside it
    return made


def grid() -> QGridLayout:
    """Return a grid for names and their fields."""
    made = QGridLayout()
    made.setHorizontalSpacing(style.GAP)
    made.setVerticalSpacing(style.STEP)
    return made


def form(rows: Iterable[tuple[str | QWidget, QWidget, str | QWidget]]) -> QGridLayout:
    """Return a grid with a row for each (name, field, unit); name and unit are texts, or labels that change."""
    filled = grid()
    filled.setColumnStretch(0, 1)
    for i, (text, control, unit) in enumerate(rows):
        name = label(text) if isinstance(text, str) else text
        unit = label(unit, "muted") if isinstance(unit, str) and unit else unit
        for k, widget in enumerate((name, control, unit)):
            if isinstance(widget, QWidget):  # a column without units takes no space
                filled.addWidget(widget, i, k)
    return filled


def clear(grid: QGridLayout) -> None:
    """Take every widget out of a grid, and delete it."""
    while (item := grid.takeAt(0)) is not None:
        if widget := item.widget():
            widget.hide()
            widget.deleteLater()


def row(*items: Item, spacing: int = style.GAP, margins: Margins | None = None) -> QHBoxLayout:
    return _filled(QHBoxLayout(), items, spacing, margins)


def column(*items: Item, spacing: int = style.STEP, margins: Margins | None = None) -> QVBoxLayout:
    return _filled(QVBoxLayout(), items, spacing, margins)


def holder(layout: QLayout) -> QWidget:
    """Return a widget that holds `layout`, for where only a widget goes."""
    widget = QWidget()
    widget.setObjectName("plain")
    layout.setContentsMargins(0, 0, 0, 0)
    widget.setLayout(layout)
    return widget


def tabs(name: str, *pages: tuple[QWidget, str]) -> QTabWidget:
    widget = QTabWidget()
    widget.setDocumentMode(True)
    widget.tabBar().setDrawBase(False)
    widget.setUsesScrollButtons(False)
    for named in (widget, widget.tabBar()):
        named.setAccessibleName(name)
    for page, text in pages:
        widget.addTab(page, text)
    return widget


def inside(layout: QLayout) -> QWidget:
    """Return a widget that holds `layout` on the background of its card."""
    widget = holder(layout)
    widget.setObjectName("inside")
    return widget


def page_layout(page: QWidget) -> QVBoxLayout:
    """Give `page` its margins and return its layout."""
    layout = column(spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4)
    surface(page, "page", layout)
    return layout


def surface(widget: QWidget, name: str, layout: QLayout) -> None:
    """Lay out `widget` as the surface that the style sheet knows by `name`."""
    widget.setObjectName(name)
    widget.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
    widget.setLayout(layout)


def set_text(widget: Any, text: str, *, shorter: str = "") -> None:
    """Set a text only where it differs: an unchanged label costs no layout; `shorter` as `ElidedLabel`."""
    if isinstance(widget, ElidedLabel):
        widget.shorter = shorter
    if widget.text() != text:
        widget.setText(text)


def set_state(widget: QWidget, value: str, key: str = "state") -> None:
    """Set a style property and have the sheet looked up again, only where it differs."""
    if widget.property(key) != value:
        widget.setProperty(key, value)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


def allow(control: QWidget, obstacle: str = "") -> None:
    """Let `control` be used, or grey it and say why: on hover, and to a screen reader."""
    if control.property("tip") is None:
        control.setProperty("tip", control.toolTip())
    if control.isEnabled() is bool(obstacle) or control.accessibleDescription() != obstacle:
        control.setEnabled(not obstacle)
        control.setToolTip(as_words(obstacle) or str(control.property("tip")))
        control.setAccessibleDescription(obstacle)


def owner(widget: QWidget, method: str) -> Any:
    """Return the nearest parent with a method of that name (the window has those that save); None without one."""
    parent = widget.parentWidget()
    while parent is not None and not hasattr(parent, method):
        parent = parent.parentWidget()
    return parent


def grow(widget: QWidget) -> QWidget:
    widget.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
    return widget


def _dressed(widget: W, role: str, name: str, tip: str = "") -> W:
    """Return `widget` with its role in the style sheet, its name for a screen reader and its tooltip, where given."""
    if role:
        widget.setProperty("role", role)
    if name:
        widget.setAccessibleName(name)
    widget.setToolTip(tip)
    return widget


def _filled(box: Box, items: tuple[Item, ...], spacing: int, margins: Margins | None) -> Box:
    box.setSpacing(spacing)
    if margins is not None:
        box.setContentsMargins(*margins)
    for item in items:
        part, share = item if isinstance(item, tuple) else (item, 0)
        if part is None:
            box.addStretch(1)
        elif isinstance(part, int):
            box.addSpacing(part)
        elif isinstance(part, QLayout):
            box.addLayout(part, share)
        else:
            box.addWidget(part, share)
    return box


def as_words(text: str) -> str:
    """Return `text` escaped for a tooltip: Qt takes one with a tag for rich text, and loads the pictures it names.

    It may come from a file or a board.
    """
    return f"<p style='white-space: pre-wrap'>{escape(text)}</p>" if "<" in text else text
