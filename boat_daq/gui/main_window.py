"""The main window: header, pages with their tabs, status strip, and the two timers that pull.

Rules: nothing is pushed into Qt. A frame timer draws the visible page's moving parts as often as a change could be
seen, and a calm timer shows figures and states a few times a second. Nothing is modal.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from time import monotonic, thread_time
from typing import Any

from PySide6.QtCore import QByteArray, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QGuiApplication, QResizeEvent
from PySide6.QtWidgets import (
    QApplication,
    QDialog,
    QLineEdit,
    QMainWindow,
    QStackedWidget,
    QTabBar,
    QTableView,
    QWidget,
)

from boat_daq.engine.installation import shipped
from boat_daq.gui import style
from boat_daq.gui.command_palette import Palette, ShortcutSheet, Tutorial
from boat_daq.gui.connect_panel import ConnectPanel
from boat_daq.gui.header import Header, Navigation, Strip, Vents
from boat_daq.gui.live.live_page import LivePage
from boat_daq.gui.live.outlets_panel import OutletsPanel
from boat_daq.gui.live.units_panel import UnitsPanel
from boat_daq.gui.models.optics_page import OpticsPage
from boat_daq.gui.models.shadow_page import ShadowPage
from boat_daq.gui.models.tradeoff_page import TradeoffPage
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.registry import Registry, WindowKeys
from boat_daq.gui.results.calibration_page import CalibrationPage
from boat_daq.gui.results.import_panel import ImportPanel
from boat_daq.gui.results.repeat_page import RepeatPage
from boat_daq.gui.results.runs_page import RunsPage
from boat_daq.gui.settings_page import SafeModeBar, SettingsPage
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls, data_table
from boat_daq.gui.widgets.file_dialogs import ask_save
from boat_daq.gui.widgets.layouts import PageScroll
from boat_daq.gui.widgets.panel_guard import PanelGuard
from boat_daq.viewmodels.app_model import AppModel
from boat_daq.viewmodels.common.files import TABLE_SUFFIXES, FileKind, kind_of
from boat_daq.viewmodels.common.notices import Notice, Severity
from boat_daq.viewmodels.common.services import PLACES, TABS, Page, Panel, Place, Tab, page_of
from boat_daq.viewmodels.live.recording_status import RecordingStatus

_CALM_MS = 250
FRAMES_MEAN = 0.1  # weight of the newest frame in their mean cost
_LEAVE_S = 10.0  # two requests to close within it stop a run
_FRAME = 48  # of the system around a window, at most
MODEL_PAGES = (Tab.OPTICS, Tab.SHADOW, Tab.ACCURACY)
THEMES = {"system": None, "light": style.LIGHT, "dark": style.DARK}


class MainWindow(QMainWindow):
    """The window on an `AppModel`; `app.make_window` adds its commands."""

    page_made = Signal()

    def __init__(self, model: AppModel) -> None:
        super().__init__()
        self.model = model
        self.pages: dict[Place, Any] = {}  # those that have been shown
        self.follow_theme()  # before there is a widget: each is styled once, where it is shown
        self._leave_until = 0.0
        self._asked: Notice | None = None  # whether to close
        self._focus_next: QWidget | None = None
        self._used_s, self._frame_ms = thread_time(), 0.0  # processor time of this thread; of a frame, smoothed
        self.guard = PanelGuard(model.notices)
        model.services.show, model.services.choose, model.services.open = self.show_place, self.choose, self.open_file
        self.setAcceptDrops(True)
        self.setMinimumSize(*style.WINDOW_MINIMUM)
        vents = Vents(self.vent, model.windows.vent_all, lambda: model.windows.others)
        recording = RecordingStatus(model.run)
        self.header = Header(model.connection, model.unit, recording, model.outlets, vents, model.services)
        self.strip = Strip(model.notices, model.jobs)
        self.navigation = Navigation(tuple(Page), self.go, self.show_keys)
        self.stack = QStackedWidget()
        self.scrolls = {place: PageScroll() for place in PLACES}
        self.chosen = {page: tabs[0] for page, tabs in TABS.items()}  # the tab of each page with tabs
        self.tabs = QTabBar()
        self.tabs.setDrawBase(False)
        self.tabs.setExpanding(False)
        self.tabs.setUsesScrollButtons(False)
        self.tabs.setAccessibleName("Tabs of the page")
        self.tabs.tabBarClicked.connect(lambda at: self.go(TABS[self.page][at]) if at >= 0 else None)
        for scroll in self.scrolls.values():
            self.stack.addWidget(scroll)
        self.live: LivePage = self.open_page(Page.MEASURE)
        self._lay_out()
        self.connect_panel = ConnectPanel(self, model.connection, model.services)
        self.commands = Registry(self, model.notices)
        self.palette_ = Palette(self, self.commands)
        self.keys: ShortcutSheet | None = None
        self.units_panel: UnitsPanel | None = None  # made where it is first shown
        self.outlets_panel: OutletsPanel | None = None
        self.window_keys = WindowKeys(
            self, self.vent, model.windows.vent_all, self.header, self.header.vent, lambda: self.page is Page.MEASURE
        )
        application().focusWindowChanged.connect(self.window_keys.watch)
        application().focusChanged.connect(self.window_keys.follow_focus)
        QGuiApplication.styleHints().colorSchemeChanged.connect(self.follow_theme)
        self._restore()
        model.runs.offer_recovery()
        self._start_timers()

    @cached_property
    def import_panel(self) -> ImportPanel:
        return ImportPanel(self, self.model.csv_import, self.model.services)

    def open_page(self, name: Place) -> Any:
        """Return a tab, or a page without tabs; make it where it is shown for the first time."""
        if name not in self.pages:
            page = self._make_page(name)
            self.pages[name] = page
            self.scrolls[name].setWidget(page)
            self._paint(page)
            if self.strip.window() is self:
                self._tab_to_strip_last()
            self.page_made.emit()
        return self.pages[name]

    def _tab_to_strip_last(self) -> None:
        """Let Tab reach the strip after the pages: Qt's own order is that in which they were made."""
        of_strip = [w for w in self.strip.findChildren(QWidget) if w.focusPolicy() != Qt.FocusPolicy.NoFocus]
        last: QWidget | None = self.previousInFocusChain()
        while last is not None and (last.focusPolicy() == Qt.FocusPolicy.NoFocus or self.strip.isAncestorOf(last)):
            last = last.previousInFocusChain()
        if last is None:
            return
        for widget in of_strip:
            self.setTabOrder(last, widget)
            last = widget

    def _make_page(self, name: Place) -> QWidget:
        m, services = self.model, self.model.services
        makers: dict[Place, Callable[[], QWidget]] = {
            Page.MEASURE: lambda: LivePage(m.run, m.overlay, m.layouts, m.shadow, m.camera, services),
            Tab.CALIBRATION: lambda: CalibrationPage(m.calibration, services),
            Tab.REPEATABILITY: lambda: RepeatPage(m.repeatability, m.choose_repeatability, services),
            Page.RECORDINGS: lambda: RunsPage(m.runs, m.calibration.analyse, m.run.resumption.resume, services),
            Tab.OPTICS: lambda: OpticsPage(m.optics, services),
            Tab.SHADOW: lambda: ShadowPage(m.shadow, m.monitor, services),
            Tab.ACCURACY: lambda: TradeoffPage(m.tradeoff, m.precision, services),
            Tab.VALUES: lambda: SettingsPage(m.settings, m.unit, services),
        }
        return makers[name]()

    def _lay_out(self) -> None:
        content = controls.column(self._tab_row(), (self.stack, 1), spacing=0)
        middle = controls.row(self.navigation, (content, 1), spacing=0)
        self.safe_mode = SafeModeBar(self.model.settings, partial(self.go, Tab.VALUES))
        body = controls.holder(controls.column(self.header, self.safe_mode, (middle, 1), self.strip, spacing=0))
        body.setObjectName("body")
        self.setCentralWidget(body)

    def _tab_row(self) -> QWidget:
        line = controls.row((self.tabs, 1))
        self.tab_row = controls.holder(line)
        line.setContentsMargins(style.PAGE_MARGIN, style.STEP, style.PAGE_MARGIN, 0)
        self.tab_row.hide()
        return self.tab_row

    def _start_timers(self) -> None:
        self.frame_timer, self.calm_timer = QTimer(self, timerType=Qt.TimerType.PreciseTimer), QTimer(self)
        for timer, work in ((self.frame_timer, self.draw), (self.calm_timer, self.refresh)):
            timer.timeout.connect(work)
            timer.start(_CALM_MS)
        self.refresh()

    def draw(self) -> None:
        """Draw the moving parts of the visible page, and set the time of the next frame."""
        live = self.page is Page.MEASURE
        if live and not self.isMinimized():
            self.live.draw()
        used_s, before_s = thread_time(), self._used_s
        self._used_s = used_s
        self._frame_ms += FRAMES_MEAN * (1000 * (used_s - before_s) - self._frame_ms)  # what Qt paints is in it
        width, connected = self.live.plots.view.width(), self.model.connected() and live
        wanted = self.model.live.frame_interval_ms(width, self._frame_ms, connected=connected)
        if self.frame_timer.interval() != wanted:
            self.frame_timer.setInterval(wanted)

    def refresh(self) -> None:
        snapshot = self.model.tick()
        self.window_keys.watch_all()
        readable = self.page is Page.MEASURE and not any(dialog.isVisible() for dialog in self.findChildren(QDialog))
        pressure = "" if readable else self.model.run.pressure_text(snapshot)
        self.guard.show(self.header, "The header", lambda: self.header.refresh(snapshot, pressure))
        page = self.pages[self.place]
        self.guard.show(page, str(self.place), lambda: page.refresh(snapshot))
        focus = QApplication.focusWidget()
        if focus is None or (focus.window() is self and not self.stack.isAncestorOf(focus)):
            self._give_focus()  # of a page that was loading
        due = snapshot.waiting_for_reading is not None and self.page is not Page.MEASURE
        self.navigation.mark(Page.MEASURE, "a reading is due" if due else "")
        self.guard.show(self.strip, "The messages", self.strip.refresh)
        self.safe_mode.refresh()
        self.guard.show(self.connect_panel, "The connection", lambda: self.connect_panel.refresh(snapshot))
        if "import_panel" in vars(self):
            self.guard.show(self.import_panel, "The import", self.import_panel.refresh)
        if self.outlets_panel is not None and self.outlets_panel.isVisible():
            self.guard.show(self.outlets_panel, "Streams and remote control", self.outlets_panel.refresh)
        title = self.model.title()
        if title != self.windowTitle():
            self.setWindowTitle(title)

    @property
    def place(self) -> Place:
        """Return the tab that is shown, or the page without tabs."""
        return PLACES[self.stack.currentIndex()]

    @property
    def page(self) -> Page:
        return page_of(self.place)

    def choose(self, tab: Tab) -> None:
        """Select a tab of its page; it is shown where the page is."""
        self.chosen[page_of(tab)] = tab
        if self.page is page_of(tab):
            self.go(tab)

    def go(self, name: Place) -> None:
        name = next((self.chosen[page] for page in TABS if page == name), name)
        self._focus_next = None
        page, focus = self.open_page(name), QApplication.focusWidget()
        if focus is not None and self.stack.isAncestorOf(focus) and name != self.place:
            focus.clearFocus()  # else Qt gives it to the first control of the new page
        self.stack.setCurrentWidget(self.scrolls[name])
        self.navigation.show_page(self.page)
        self._show_tabs()
        self.model.preferences.set("page", str(name))
        page.refresh(self.model.snapshot)
        if self.page is Page.MEASURE:
            self.live.focus_reading()

    def _show_tabs(self) -> None:
        place, tabs = self.place, TABS.get(self.page, ())
        self.tab_row.setVisible(bool(tabs))
        if [self.tabs.tabText(i) for i in range(self.tabs.count())] != list(tabs):
            while self.tabs.count():
                self.tabs.removeTab(0)
            for tab in tabs:
                self.tabs.addTab(tab)
        for at, tab in enumerate(tabs):
            if tab == place:
                self.chosen[self.page] = tab
                self.tabs.setCurrentIndex(at)

    def go_by_key(self, name: Place) -> None:
        """Show a page and give the keyboard to its first control, where it names one."""
        self.go(name)
        self._focus_next = getattr(self.pages[self.place], "first", None)
        self._give_focus()

    def _give_focus(self) -> None:
        """Give the keyboard to the control that a key has chosen, once its page shows it."""
        first = self._focus_next
        if first is not None and first.isVisible():
            self._focus_next = None
            first.setFocus(Qt.FocusReason.ShortcutFocusReason)

    def show_place(self, place: Place | Panel) -> None:
        """Show the page, tab or panel that a view model requests."""
        if not isinstance(place, Panel):
            self.go(place)
            return
        panels = {
            Panel.CONNECT: self.connect_panel.open_fresh, Panel.REPORT: self.ask_report,
            Panel.SEGMENTS: self.live.edit_segments, Panel.OUTLETS: self.show_outlets,
            Panel.PLAN: self.live.show_plan, Panel.PHOTOGRAPH: self.live.open_photograph,
        }  # fmt: skip
        panels[place]()

    def show_outlets(self) -> None:
        if self.outlets_panel is None:
            self.outlets_panel = OutletsPanel(self, self.model.outlets, self.model.services)
        self.outlets_panel.refresh()
        self.outlets_panel.show()
        self.outlets_panel.raise_()

    def vent(self) -> None:
        self.model.session.vent()
        self.model.notices.dismiss(self._asked)  # no run is in progress then

    def escape(self) -> None:
        """Close what is open, else give the focus back to the page or undo what is typed in its field, else vent.

        Qt closes a menu, a list or a dialog that has the keyboard by itself.
        """
        focus = QApplication.focusWidget()
        dialogs = [dialog for dialog in self.findChildren(QDialog) if dialog.isVisible()]
        if dialogs:
            dialogs[-1].reject()
        elif self.strip.is_open():
            self.strip.close_details()
        elif self.page is Page.MEASURE and self.live.marker.isVisible():
            self.live.close_marker()
        elif self.page is Page.MEASURE and self.live.overlaid:
            self.live.toggle_overlay()
        elif focus is not None and not self.stack.isAncestorOf(focus):
            focus.clearFocus()  # of the menu bar, too, which keeps the keyboard after its menu was closed
            self.live.focus_reading()
        elif isinstance(focus, QLineEdit) and focus.isUndoAvailable():
            while focus.isUndoAvailable():
                focus.undo()
        else:
            self.vent()

    def open_file(self, path: Path) -> None:
        """Open a file by its kind: calibrate with a recording, import a table, load a plan or a profile."""
        kind = kind_of(path)
        if kind is FileKind.RECORDING:
            self.model.calibration.analyse(path)
            self.go(Tab.CALIBRATION)
        elif kind is FileKind.TABLE:
            self.import_panel.open_file(path)
        elif kind is FileKind.PLAN:
            self.live.plan.load(path)
            self.live.show_plan()
        else:
            self.connect_panel.open_fresh()
            self.connect_panel.profile.setPlainText(str(path))

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        """Take files; why one cannot be opened is reported when it is dropped."""
        if event.mimeData().hasUrls():
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        event.acceptProposedAction()
        paths = [Path(url.toLocalFile() or url.toString()) for url in event.mimeData().urls()]
        second = paths[1:] if len(paths) == 2 and all(p.suffix.lower() in TABLE_SUFFIXES for p in paths) else []
        for path in paths[:1] if second else paths:
            self.model.notices.attempt(partial(self.open_file, path))
        for path in second:  # two tables are of one run
            self.model.notices.attempt(partial(self.model.csv_import.join, path))

    def toggle_full_screen(self) -> None:
        self.setWindowState(self.windowState() ^ Qt.WindowState.WindowFullScreen)

    def show_keys(self) -> None:
        if self.keys is None:
            self.keys = ShortcutSheet(self, self.commands)
        self.keys.show()
        self.keys.raise_()

    def show_tutorial(self) -> None:
        Tutorial(self, shipped("docs/tutorial/first-calibration.md", "share/doc/boat-daq")[0]).show()

    def ask_report(self) -> None:
        path = self.model.analysed_path(self.place)
        if path is not None:
            make = partial(self.model.runs.report, [path], curve=self.model.analysed_curve(self.place))
            ask_save(self, self.model.services, f"{path.stem} report", "pdf html", make, done="")

    def copy_plot(self, card: PlotCard | ShadowPane) -> None:
        self.model.notices.attempt(card.copy, done=f"Copied: {card.title}")

    def save_plot(self, card: PlotCard | ShadowPane, suffix: str) -> None:
        if self.model.notices.attempt(card.require_data):
            ask_save(self, self.model.services, card.title, suffix, card.save)

    def save_table(self, table: QTableView) -> None:
        save = partial(data_table.save_table, table)
        ask_save(self, self.model.services, table.accessibleName(), "csv", save)

    def follow_theme(self, *_: object) -> None:
        self.set_theme(THEMES.get(self.model.preferences.get("theme", "system")) or style.system_theme())

    def choose_theme(self, name: str) -> None:
        """Store and apply a theme: system, light or dark."""
        self.model.preferences.set("theme", name)
        self.follow_theme()

    def set_theme(self, theme: Theme) -> None:
        self.theme = theme
        app = application()
        sheet = style.style_sheet(theme)
        if self.styleSheet() != sheet:  # setting it again would restyle every widget
            app.setPalette(style.palette(theme))
            self.setStyleSheet(sheet)  # not the application's: pyqtgraph has a thousand hidden widgets
        self._paint(self)

    def _paint(self, root: QWidget) -> None:
        """Apply the theme to what the style sheet does not reach in `root`: plots and pictures.

        Values of a run are shown in the units that the operator chose; the models keep those of their papers.
        """
        units = self.model.unit_choice.units
        shown = self.theme if units == self.theme.units else replace(self.theme, units=units)
        models = [page for name, page in self.pages.items() if name in MODEL_PAGES]
        for widget in (root, *root.findChildren(QWidget)):
            paint = getattr(widget, "paint_theme", None)
            if paint is not None:
                of_model = any(page is widget or page.isAncestorOf(widget) for page in models)
                paint(self.theme if of_model else shown)

    def sizeHint(self) -> QSize:
        return QSize(*style.WINDOW_SIZE)

    def fit_screen(self) -> None:
        """Maximise a window that does not fit the screen, before it is shown.

        A size stored at 100 % would put VENT beyond the edge of the same screen at 150 %.
        """
        available = self.screen().availableSize()
        stored = bool(self.model.preferences.get("geometry", ""))
        wanted = self.size() if stored else QSize(style.WINDOW_SIZE[0] + _FRAME, style.WINDOW_SIZE[1] + _FRAME)
        if available.width() < wanted.width() or available.height() < wanted.height():
            self.setWindowState(Qt.WindowState.WindowMaximized)

    def _restore(self) -> None:
        geometry = self.model.preferences.get("geometry", "")
        if not (geometry and self.restoreGeometry(QByteArray(base64.b64decode(geometry)))):
            self.resize(self.sizeHint())
        self.live.restore()
        kept = self.model.preferences.get("page", "")
        self.go(next((place for place in PLACES if place == kept), Page.MEASURE))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Narrow the navigation in a narrow window, and lower the strip in a low one."""
        narrow = self.width() < style.NARROW_BELOW
        self.navigation.setFixedWidth(style.NAVIGATION_WIDTH_NARROW if narrow else style.NAVIGATION_WIDTH)
        self.strip.fold(low=self.height() < style.LOW_BELOW)
        super().resizeEvent(event)

    def leave(self) -> None:
        """Close the window, unless a run is in progress and this is the first request."""
        if self._may_leave():
            self.close()

    def _may_leave(self) -> bool:
        """Return whether to close: in a run, or while a file is written, only at the second request."""
        again, run = monotonic() < self._leave_until, self.model.snapshot.under_way
        writing = [job.label for job in self.model.jobs.running() if job.target is not None]
        if again or not (run or writing):
            return True
        self._leave_until = monotonic() + _LEAVE_S
        cause = "a run is in progress" if run else f"{writing[0]}: no file is written yet"
        close = f"Press Close again within {_LEAVE_S:.0f} s to"
        remedy = f"{close} stop it, vent and save." if run else f"{close} leave without it."
        notices = self.model.notices
        self._asked = asked = notices.add(Severity.WARNING, cause, remedy)
        QTimer.singleShot(int(1000 * _LEAVE_S), self, lambda: notices.dismiss(asked))
        return False

    def closeEvent(self, event: QCloseEvent) -> None:
        if event.spontaneous() and not self._may_leave():
            event.ignore()
            return
        if (focus := QApplication.focusWidget()) is not None:
            focus.clearFocus()  # takes what is typed, while there is a window for it
        self.model.preferences.set("geometry", base64.b64encode(bytes(self.saveGeometry().data())).decode())
        self.live.remember()
        self.frame_timer.stop()
        self.calm_timer.stop()
        self.model.close()
        super().closeEvent(event)


def application() -> QApplication:
    app = QApplication.instance()
    assert isinstance(app, QApplication)
    return app
