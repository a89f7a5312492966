"""Every plot of every page leaves the window: as a picture, vectors and numbers, by its menu and by the keyboard."""

from __future__ import annotations

import csv
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PySide6.QtGui import QGuiApplication, QImage
from PySide6.QtWidgets import QApplication, QLabel, QToolButton

from boat_daq.engine.plan import StepMark
from boat_daq.gui import style
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.viewmodels.live.shadow_live import REST_OUTLINE, ShadowPicture
from tests.boat_daq.gui.models.test_optics_page import swept, traced
from tests.boat_daq.gui.models.test_shadow_page import mark
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.results.run_results import run_result
from tests.boat_daq.gui.windows import choose, run_command, run_shortcut
from tests.boat_daq.viewmodels.models.reports import report

KINDS = ("png", "svg", "csv")
UNIT = re.compile(r"\([^()]+\)$|_(s|kpa|mv|mm)$|, best = 1$")
NUMBERS = re.compile(  # what is counted, ranked or a message has no unit
    r"(Cycle|Calibration|cycle|cavities|rank|increases n_sign|on the front|state|flags|segment|index|method|default"
    r"|for|unit|setting|s\d_lit|s\d_dark|error|error / tolerance)$"
)
SVG = "{http://www.w3.org/2000/svg}"
SHOWN = {
    "Measure": 2,
    "Calibration": 3,
    "Repeatability": 2,
    "Recordings": 1,
    "Optics": 4,
    "Shadow": 3,
    "Speed and accuracy": 1,
}


def fill(window, page: str) -> None:
    """Give a page what it draws."""
    model = window.model
    if page == "Calibration":
        model.calibration.show(run_result())
    elif page == "Repeatability":
        model.repeatability.show(run_result())
    elif page == "Recordings":
        model.runs.scan = lambda: None
        model.runs.units_read = [(True, ("SA1", "2026-01-01", "39 / 29", "run.boat"))]
        model.runs.revision += 1
    elif page == "Optics":
        model.optics.result, model.optics.sweep = traced(), swept()
        model.optics.revision += 1
    elif page == "Shadow":
        pressure = np.linspace(-45.0, 55.0, 21)
        model.shadow.nominal_curve = lambda: (pressure, 0.07 * pressure, 0.06 * pressure, 0.08 * pressure)
        model.monitor.marks = [mark(cycle) for cycle in (1, 2, 3)]
        model.monitor.revision += 1
    elif page == "Speed and accuracy":
        model.tradeoff.take(report(), own=True)


@pytest.fixture
def loaded(make, monkeypatch, tmp_path, request):
    """A window on one page that is full, whose questions for a name are answered at once."""
    session = RecordedSession(connected(), filled_ring(120.0))
    session.marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in (1, 2)
    )
    window = make(session)

    def answer(parent, model, stem, suffix, then, *, done=None):
        model.notices.attempt(lambda: then(tmp_path / f"saved.{suffix.split()[0]}"))

    monkeypatch.setattr("boat_daq.gui.main_window.ask_save", answer)
    monkeypatch.setattr("boat_daq.gui.plotting.shadow_pane.ask_save", answer)
    window.resize(1280, 800)
    drawn = ShadowPicture(
        REST_OUTLINE, REST_OUTLINE[None], np.zeros(1, np.int64), np.zeros((0, 2, 2)), REST_OUTLINE, 0.5, 0.4
    )
    window.model.shadow.picture = lambda: drawn
    fill(window, request.param)
    window.go(request.param)
    window.refresh()
    window.draw()
    window.pages[request.param].refresh(window.model.snapshot)
    QApplication.processEvents()
    return window


def plots_of(window):
    """The plots that are seen."""
    found = [*window.findChildren(PlotCard), *window.findChildren(ShadowPane)]
    return [card for card in found if card.isVisible()]


def looked_at(window, page):
    """The page's plots; cycles of the live page, loops and the comparison replace other plots."""
    yield from plots_of(window)
    if page == "Measure":
        window.live.toggle_overlay()
    elif page == "Repeatability":
        figure = window.pages[page].figure
        figure.setCurrentIndex(figure.count() - 1)
        figure.activated.emit(figure.count() - 1)
    elif page == "Recordings":
        window.model.runs.comparison = (run_result(), run_result(5.0))
    else:
        return
    window.refresh()
    QApplication.processEvents()
    yield from (card for card in plots_of(window) if isinstance(card, PlotCard))


def button_of(card) -> QToolButton:
    return next(b for b in card.findChildren(QToolButton) if b.accessibleName().startswith("Copy or save"))


def check_picture(image: QImage, what: str) -> None:
    assert image.width() >= 150 and image.height() >= 100, what
    small = image.scaled(200, 200).convertToFormat(QImage.Format.Format_RGB32)
    assert len({small.pixel(x, y) for x in range(0, 200, 2) for y in range(0, 200, 2)}) > 3, f"{what} is blank"


def check_vectors(path, what: str) -> None:
    root = ET.parse(path).getroot()
    assert root.tag == f"{SVG}svg"
    drawn = {element.tag for element in root.iter()}
    assert drawn & {f"{SVG}path", f"{SVG}polyline", f"{SVG}polygon", f"{SVG}rect"}, what


def check_numbers(path, card) -> None:
    with path.open(encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert len(head) == len(set(head)) and rows, card.title
    assert [name for name in head if not (UNIT.search(name) or NUMBERS.search(name))] == [], card.title
    columns = [[row[k] for row in rows] for k in range(len(head))]
    for plot in getattr(card, "plots", ()):
        if "columns" not in vars(type(card)):
            for layer in (layer for layer in plot.layers if layer.x.size and layer.item.isVisible()):
                for values in (layer.x, layer.y):
                    written = ["" if value != value else repr(float(value)) for value in values]
                    assert any(column[: len(written)] == written for column in columns), f"{card.title}: {layer.name}"


WHOLE = {"Measure", "Optics"}  # by day: pictures and keys are the work of `PlotCard`, the numbers are each page's
AT_NIGHT = [
    pytest.param(page, True, marks=pytest.mark.nightly, id=f"{page}, whole") for page in SHOWN if page not in WHOLE
]


@pytest.mark.parametrize(
    ("loaded", "whole"),
    [
        *(pytest.param(page, page in WHOLE, id=page) for page in SHOWN),
        *(
            pytest.param(page, True, marks=pytest.mark.nightly, id=f"{page}, whole")
            for page in SHOWN
            if page not in WHOLE
        ),
    ],
    indirect=["loaded"],
)
def test_every_plot_is_copied_and_saved_by_menu_and_keys(loaded, tmp_path, whole):
    """Copy, PNG, SVG and CSV of each plot; the file holds the picture, or the drawn numbers with units."""
    page, clipboard, seen = loaded.place, QGuiApplication.clipboard(), []
    for card in looked_at(loaded, page):
        seen.append(card.title)
        if not card.columns():
            assert card.empty_text.isVisible() or card.readout.text(), f"{card.title} is empty and shows no text"
            continue
        button = button_of(card)
        copy, *saves = [action for action in button.menu().actions() if action.text()][:4]
        triggers = {"copy": (copy.trigger, lambda: run_command(loaded, "Copy the plot"))}
        for suffix, action in zip(KINDS, saves, strict=True):
            triggers[suffix] = (action.trigger,)
        triggers["png"] = (*triggers["png"], lambda: run_shortcut(loaded, "Ctrl+S"))
        loaded.activateWindow()
        choose(loaded, button)
        assert card.isAncestorOf(QApplication.focusWidget() or button)
        for kind, ways in triggers.items() if whole else [("csv", triggers["csv"])]:
            for way in ways:
                path = tmp_path / f"saved.{kind}"
                path.unlink(missing_ok=True)
                clipboard.clear()
                way()
                if kind == "copy":
                    check_picture(clipboard.image(), card.title)
                    assert loaded.model.notices.current().cause == f"Copied: {card.title}"
                elif kind == "png":
                    check_picture(QImage(str(path)), card.title)
                elif kind == "svg":
                    check_vectors(path, card.title)
                else:
                    check_numbers(path, card)
    assert len(seen) >= SHOWN[page], seen


def test_empty_plot_is_not_saved_and_reports_its_remedy(empty, tmp_path):
    """A copy was an empty picture, and a CSV an empty file."""
    empty.go("Shadow")
    empty.refresh()
    card = empty.pages["Shadow"].cycles
    assert card.empty_text.isVisible()
    choose(empty, button_of(card))
    for command in ("Copy the plot", "Save the plot …"):
        run_command(empty, command)
        assert "nothing is drawn yet" in empty.model.notices.current().cause
        assert "once it is complete" in empty.model.notices.current().remedy
        empty.model.notices.dismiss(empty.model.notices.current())


def test_plot_keys_without_a_plot_report_it(empty):
    """Before the first sample the live page has none; the keys did nothing."""
    run_shortcut(empty, "Ctrl+S")
    assert empty.model.notices.current().cause == "no plot is shown"


def test_title_and_readout_of_a_card_are_never_cut(qtbot):
    """Side by side where both fit, else one below the other."""
    card = PlotCard("Range against roughness")
    card.add("Range", "rays", x_title="Roughness")
    qtbot.addWidget(card)
    card.readout.setText("\u25cf Pareto-optimal (label: number of rises)   \u25c6 paper's")
    beside = []
    card.bar.insertWidget(card.bar.count() - 1, last := QLabel("last"))
    for width in (900, 420, 900):
        card.resize(width, 300)
        card.show()
        QApplication.processEvents()
        QApplication.processEvents()
        beside.append(card.heading.geometry().bottom() > card.readout.geometry().top())
        for label in (card.heading, card.readout):
            assert label.width() >= label.sizeHint().width()
    assert beside == [True, False, True]
    assert card.readout.geometry().right() < last.geometry().left()  # as before
    card.readout.setText("")
    card.resize(200, 300)
    QApplication.processEvents()
    QApplication.processEvents()
    assert not card.readout.isVisible()  # it took a line


@pytest.mark.parametrize(("width", "height"), [(220, 110), (300, 110), (700, 400)])
def test_labels_and_titles_never_collide(qtbot, width: int, height: int) -> None:
    """Truth: the places at which labels are painted. Ticks are at 1-2-5, at least two of them on each axis."""
    card = PlotCard("Loop")
    qtbot.addWidget(card)
    plot = card.add("Elongation of the actuator", "mm", x_title="Pressure", x_unit="kPa")
    points = plot.points("Points", lambda theme: theme.target)
    card.paint_theme(style.LIGHT)
    card.resize(width, height)
    card.show()
    QApplication.processEvents()
    points.set(np.linspace(-1200.0, 3140.0, 8), np.linspace(-10.0, 10.0, 8))
    plot.fit()
    QApplication.processEvents()
    ends = -np.inf
    step, values, places = plot.bottom._ticks()
    assert step in (500.0, 1000.0, 2000.0, 5000.0)
    for place, text in zip(places, plot.bottom.tickStrings(values, 1.0, step), strict=True):
        wide = plot.bottom._label(text).size().width()
        assert place - wide / 2 > ends
        ends = place + wide / 2
    assert len(values) >= 1
    title = plot.left.label.mapRectToScene(plot.left.label.boundingRect())
    assert title.right() <= plot.left.sceneBoundingRect().right() - 24
    assert plot.left.sceneBoundingRect().adjusted(-1, -1, 1, 1).contains(title)


def test_cursor_of_a_plot_shows_the_value_of_its_curve(qtbot) -> None:
    """Truth: y = 2 x + 1 at the cursor, interpolated between its points; it is moved, then taken away."""
    card = PlotCard("Line")
    qtbot.addWidget(card)
    plot = card.add("Elongation", "mm", x_title="Pressure", x_unit="kPa")
    plot.curve("Line", lambda theme: theme.target).set(np.array([0.0, 10.0]), np.array([1.0, 21.0]))
    card.paint_theme(style.LIGHT)
    plot.place_cursor(2.5)
    assert plot.cursor.label.textItem.toPlainText() == "6.000 mm at 2.500 kPa"
    plot.cursor.setValue(20.0)
    assert plot.cursor.label.textItem.toPlainText() == "20.000 kPa"
    plot.remove_cursor()
    assert plot.cursor is None
