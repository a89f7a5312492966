"""Files dropped on the window, and the panel in which the columns of a CSV are chosen."""

from __future__ import annotations

import shutil

import pytest
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import QApplication

from boat_daq.engine.plan import built_in_plans
from boat_daq.viewmodels.results import csv_import
from tests.boat_daq.gui.windows import SAMPLE
from tests.boat_daq.viewmodels.helpers import DirectJob


@pytest.fixture
def drop(empty, monkeypatch):
    """Return a function that drops files on the reading field of the window; jobs are done at once."""
    monkeypatch.setattr(csv_import, "Job", DirectJob)

    def dropped(*paths):
        data = QMimeData()
        data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
        data.setText("not to be typed into a field")
        buttons = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
        enter = QDragEnterEvent(QPoint(9, 9), Qt.DropAction.CopyAction, data, *buttons)
        over = empty.live.reading.field  # neither a field nor a plot keeps it from the window
        for widget in (empty.live.plots.view.viewport(), over):
            QApplication.sendEvent(widget, enter)
            assert enter.isAccepted()
        QApplication.sendEvent(over, QDropEvent(QPointF(9, 9), Qt.DropAction.CopyAction, data, *buttons))
        empty.refresh()
        return empty

    assert not empty.live.reading.field.acceptDrops()  # a field would take the text of a file
    return dropped


def test_dropped_csv_is_imported_by_its_columns(drop, tmp_path):
    """The panel shows rows and proposes columns; what is chosen is imported, listed, chosen and offered."""
    file = tmp_path / "lab.csv"
    file.write_text("Time (s);Druck (mbar);left\n" + "\n".join(f"{i};{i}0;1.6{i}" for i in range(9)))
    window = drop(file)
    panel, model = window.import_panel, window.model.csv_import
    assert panel.isVisible()
    assert not panel.isModal()
    headings = [panel.preview.horizontalHeaderItem(i).text().split("\n")[1] for i in range(3)]
    assert headings == ["Time", "Pressure", "–"]
    assert panel.preview.item(1, 2).text() == "1.61"
    assert (panel.button.isEnabled(), panel.obstacle.text()) == (False, model.obstacle())
    column, unit = panel.columns["s1_mv"], panel.units["s1_mv"]
    column.setCurrentIndex(column.findData(3))
    column.activated.emit(column.currentIndex())
    unit.setCurrentIndex(unit.findData("v"))
    unit.activated.emit(unit.currentIndex())
    assert panel.preview.horizontalHeaderItem(2).text().endswith("Sensor 1")
    assert panel.button.isEnabled()
    panel.button.click()
    window.refresh()
    assert (window.model.runs.folder / "lab.boat").is_file()
    assert not panel.isVisible()
    assert window.page == "Recordings"
    notice = window.model.notices.current()
    assert (notice.cause, notice.action_text) == ("Imported as lab.boat", "Calibrate")


def test_dropped_file_is_opened_by_its_kind(drop, tmp_path, monkeypatch):
    """A recording is shown on the Calibrate page, a plan is chosen, a profile goes into the connect panel."""
    plan, profile, analysed = tmp_path / "mine.toml", tmp_path / "board.toml", []
    recording = shutil.copy(SAMPLE, tmp_path / "elsewhere.boat")
    plan.write_text(built_in_plans()["calibration"].to_toml().replace("cycles = 5", "cycles = 3"))
    profile.write_text('name = "x"\nkind = "lines"\n[device]\nn_sensors = 2\n')
    window = drop()
    monkeypatch.setattr(window.model.calibration, "analyse", analysed.append)
    drop(recording)
    assert (analysed, window.place) == ([recording], "Calibration")
    drop(plan, profile)
    assert window.model.sequence.plan.cycles == 3
    assert window.live.pane.currentWidget() is window.live.plan
    assert window.connect_panel.isVisible()
    assert window.connect_panel.profile.toPlainText() == str(profile)


def test_other_files_are_refused_with_the_reason(drop, tmp_path):
    """What the window does not open is named, with what it does open."""
    (tmp_path / "notes.toml").write_text("x = 1\n")
    (tmp_path / "photo.heic").write_bytes(b"x")
    for name, words in (("photo.heic", "cannot be opened"), ("notes.toml", "neither a plan"), ("", "is a folder")):
        notice = drop(tmp_path / name).model.notices.history[-1]
        assert words in notice.cause
        assert notice.remedy
