"""Small makers of the controls that every page uses, so that a page reads as what it shows.

Rules: a control has an accessible name (its text, where it has one); a role names its look in the style sheet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QPushButton,
    QSizePolicy,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from boat_daq.gui import style
from boat_daq.gui.widgets.tooltips import as_words

Item = QWidget | QLayout | int | None | tuple[QWidget | QLayout, int]
"""A part of a row or column: a widget or layout, with its share of the length or without; a space; None a stretch."""


class ElidedLabel(QLabel):
    """A label that is cut with an ellipsis where it does not fit, and never widens its page.

    `least` is the width that it asks for, where its text is not shorter.
    """

    least = 0
    explanation = ""

    def explain(self, words: str) -> None:
        """Say `words` on hover, below the whole text where that is cut."""
        self.explanation = words
        self.setAccessibleDescription(words)

    def minimumSizeHint(self) -> QSize:
        """Ask for the least width."""
        hint = super().minimumSizeHint()
        return QSize(min(self.least, hint.width()), hint.height())

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the text, cut where it must be; the whole of it is then said on hover."""
        area = self.contentsRect()
        shown = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, area.width())
        painter = QPainter(self)
        self.style().drawItemText(
            painter, area, int(self.alignment()), self.palette(), self.isEnabled(), shown, self.foregroundRole()
        )
        painter.end()
        cut = as_words(self.text()) if shown != self.text() else ""
        self.setToolTip("\n".join(part for part in (cut, self.explanation) if part))


def label(
    text: str = "", role: str = "", *, name: str = "", wrap: bool = False, elide: bool = False, least: int = 0
) -> QLabel:
    """Return a label in one of the roles title, subtitle, muted, small, set; `elide` as `ElidedLabel`."""
    widget = ElidedLabel(text) if elide else QLabel(text)
    if isinstance(widget, ElidedLabel):
        widget.least = least
    widget.setTextFormat(Qt.TextFormat.PlainText)
    widget.setWordWrap(wrap)
    if role:
        widget.setProperty("role", role)
    if name:
        widget.setAccessibleName(name)
    return widget


def button(text: str, on_click: Callable[[], Any], role: str = "", *, name: str = "", tip: str = "") -> QPushButton:
    """Return a button; role primary is the one next step of a page."""
    widget = QPushButton(text)
    widget.setAutoDefault(False)
    if role:
        widget.setProperty("role", role)
    widget.setAccessibleName(name or text)
    if tip:
        widget.setToolTip(tip)
    widget.clicked.connect(lambda *_: on_click())
    return widget


def field(name: str, text: str = "", *, placeholder: str = "", width: int = 0) -> QLineEdit:
    """Return a text field named for a screen reader."""
    widget = QLineEdit(text)
    widget.setAccessibleName(name)
    widget.setPlaceholderText(placeholder)
    if width:
        widget.setFixedWidth(width)
    return widget


def choice(name: str, entries: list[tuple[str, Any]]) -> QComboBox:
    """Return a choice of (text, value) entries."""
    widget = QComboBox()
    widget.setAccessibleName(name)
    widget.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
    for text, value in entries:
        widget.addItem(text, value)
    return widget


def card(*items: Item) -> tuple[QFrame, QVBoxLayout]:
    """Return a framed surface and its layout, a column of `Item`s."""
    frame = QFrame()
    frame.setObjectName("card")
    layout = column(*items)
    layout.setContentsMargins(style.CARD_PADDING, style.GAP, style.CARD_PADDING, style.GAP)
    frame.setLayout(layout)
    return frame, layout


def form(rows: Iterable[tuple[str, QWidget, str]]) -> QGridLayout:
    """Return a grid with a row for each (name, field, unit)."""
    grid = QGridLayout()
    grid.setVerticalSpacing(style.STEP)
    grid.setColumnStretch(0, 1)
    for i, (text, control, unit) in enumerate(rows):
        for k, widget in enumerate((label(text), control, label(unit, "muted"))):
            grid.addWidget(widget, i, k)
    return grid


def row(*items: Item, spacing: int = style.GAP) -> QHBoxLayout:
    """Return a horizontal layout of `Item`s."""
    layout = QHBoxLayout()
    _fill(layout, items, spacing)
    return layout


def column(*items: Item, spacing: int = style.STEP) -> QVBoxLayout:
    """Return a vertical layout of `Item`s."""
    layout = QVBoxLayout()
    _fill(layout, items, spacing)
    return layout


def holder(layout: QLayout) -> QWidget:
    """Return a widget that holds `layout`, for where only a widget goes."""
    widget = QWidget()
    widget.setObjectName("plain")
    layout.setContentsMargins(0, 0, 0, 0)
    widget.setLayout(layout)
    return widget


def tabs(name: str, *pages: tuple[QWidget, str]) -> QTabWidget:
    """Return tabs.

    Parameters
    ----------
    name : for a screen reader.
    pages : each with the text of its tab.
    """
    widget = QTabWidget()
    widget.setDocumentMode(True)
    widget.tabBar().setDrawBase(False)
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
    page.setObjectName("page")
    page.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
    layout = QVBoxLayout(page)
    layout.setContentsMargins(style.PAGE_MARGIN, style.PAGE_MARGIN, style.PAGE_MARGIN, style.PAGE_MARGIN)
    layout.setSpacing(style.GAP)
    return layout


def set_text(widget: Any, text: str) -> None:
    """Set a text only where it differs: an unchanged label costs no layout."""
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


def grow(widget: QWidget) -> QWidget:
    """Let `widget` take the available space."""
    widget.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
    return widget


def _fill(layout: QBoxLayout, items: tuple[Item, ...], spacing: int) -> None:
    layout.setSpacing(spacing)
    for item in items:
        part, share = item if isinstance(item, tuple) else (item, 0)
        if part is None:
            layout.addStretch(1)
        elif isinstance(part, int):
            layout.addSpacing(part)
        elif isinstance(part, QLayout):
            layout.addLayout(part, share)
        else:
            layout.addWidget(part, share)
