"""At 150 % on 1280 x 800 and 200 % on 1920 x 1080: what a narrow window leaves out, it tells elsewhere."""

from __future__ import annotations

import dataclasses

import pytest
from PySide6.QtWidgets import QApplication, QScrollArea

from boat_daq.engine.snapshot import HealthSnapshot
from boat_daq.viewmodels.results.runs import HEADINGS, read_run
from protocol.link.events import LinkStatistics
from tests.boat_daq.gui.results.test_runs_page import SAMPLE, choose
from tests.protocol.link.streams import HELLO

NARROW = 853


def listed(window, names):
    """The Runs page over made-up runs: their worst case, without a folder that is read."""
    run = read_run(SAMPLE)
    broken = dataclasses.replace(run.summary, status="interrupted", stop_reason=None, steps=3)
    damaged = dataclasses.replace(run, summary=None, problem="/a/long/way/to/x.boat cannot be read: it is malformed")
    made = [dataclasses.replace(run, path=run.path.with_name(name)) for name in names]
    window.model.runs.runs = [dataclasses.replace(made[0], summary=broken), damaged, *made[1:]]
    window.model.runs.scan = lambda: None
    window.model.runs.revision += 1
    window.go("Runs")
    QApplication.processEvents()
    return window.pages["Runs"]


@pytest.mark.parametrize("width", [NARROW, 960, 1280])
def test_the_list_of_runs_fits_and_tells_what_it_leaves_out(live, width):
    """A damaged file's reason pushed the names out of sight at any width; two more buttons the whole page at 853."""
    live.resize(width, 533)
    page = listed(live, [f"20261121-22153{n}_SA1.boat" for n in range(3)])
    choose(page, 0)
    QApplication.processEvents()
    table = page.list
    assert live.scrolls["Runs"].horizontalScrollBar().maximum() == 0
    assert table.horizontalScrollBar().maximum() == 0
    assert table.columnWidth(HEADINGS.index("File")) >= table.fontMetrics().horizontalAdvance(
        "20261121-221530_SA1.boat"
    )
    assert table.isColumnHidden(HEADINGS.index("Readings")) is (width < 1000)
    assert all(page.buttons[key].isVisible() for key in ("resume", "recover"))
    assert "37 readings" in page.told.text()
    choose(page, 1)
    assert "malformed" in page.told.text()


@pytest.mark.parametrize("width", [NARROW, 960, 1280])
def test_the_head_is_never_cut(live, width):
    """At 853 px the figures of the link and the unit's calibration were cut; what is wrong is never left out."""
    live.resize(width, 533)
    live.model.session.change(
        hello=HELLO, health=HealthSnapshot(LinkStatistics(lost=12), 100.0, 100.0, 0.0, 3.0, None, None, None, ())
    )
    live.model.unit.text = lambda _: "SA1  ·  calibrated 2026-11-22"
    live.refresh()
    QApplication.processEvents()
    head = live.header
    for widget in (head.link, head.unit, head.vent, *(f for f in head.figures if not f.isHidden())):
        assert widget.width() >= widget.sizeHint().width(), widget.text()
        assert head.rect().contains(widget.geometry())
    assert "12 lost" in [f.text() for f in head.figures if f.isVisible()]
    assert "3 ms behind" in head.link.toolTip()
    assert "2026-11-22" in head.unit.toolTip()
    assert head.unit.text() == live.model.unit.text(None)[: None if width == 1280 else -11]


@pytest.mark.parametrize("width", [NARROW, 960, 1280])
def test_no_page_of_the_models_scrolls_sideways(live, width):
    """A page that asked for the width of its sides beside each other was never narrow enough to stand them over."""
    live.resize(width, 533)
    for name in ("Optics", "Shadow", "Trade-off"):
        live.model.optics.choose = lambda *_: None
        live.go(name)
        QApplication.processEvents()
        QApplication.processEvents()
        assert live.scrolls[name].horizontalScrollBar().maximum() == 0, name
        assert live.pages[name].width() >= live.pages[name].layout().minimumSize().width(), name


@pytest.mark.parametrize("width", [NARROW, 1280])
def test_the_shortcut_sheet_does_not_scroll_sideways(live, width):
    """At 853 px a third of the keys was out of sight to the right."""
    live.resize(width, 533)
    live.show_keys()
    QApplication.processEvents()
    area = live.keys.findChild(QScrollArea)
    assert area.horizontalScrollBar().maximum() == 0
    assert live.keys.height() >= min(533, area.widget().sizeHint().height())
    assert area.viewport().width() > 500
    assert (live.keys.geometry().center() - live.geometry().center()).manhattanLength() < 8
    assert all(block.isVisible() for block in live.keys._blocks.values())
    live.keys.close()


def test_the_field_for_a_pasted_line_keeps_its_height(live):
    """The style sheet's least height went before its own, and a panel with a remark squeezed it to one line."""
    live.connect_panel.open_fresh()
    live.connect_panel.none.setVisible(True)
    QApplication.processEvents()
    assert live.connect_panel.profile.height() >= 3 * live.connect_panel.profile.fontMetrics().lineSpacing()
    live.connect_panel.close()
