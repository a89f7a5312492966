"""File dialogs: never modal."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QApplication,
    QFileDialog,
    QLineEdit,
)

from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save


def test_no_dialog_box_blocks_vent(live, qtbot, tmp_path):
    """Missing and existing files were reported by modal boxes: VENT could not be clicked behind them."""
    there, opened, saved = tmp_path / "there.csv", [], []
    there.write_text("kept")
    dialog = ask_open(live, live.model.services, "Open", "csv", opened.append)
    for path, title in ((tmp_path / "missing.csv", "no missing.csv"), (there, "")):
        dialog.findChild(QLineEdit).setText(str(path))
        dialog.accept()
        assert QApplication.activeModalWidget() is None
        assert title in dialog.windowTitle()
    assert opened == [there]
    dialog = ask_save(live, live.model.services, "plot", "csv", saved.append)
    assert dialog.testOption(QFileDialog.Option.ReadOnly)  # else Delete in its menu asks in a modal box
    dialog.findChild(QLineEdit).setText(str(there))
    dialog.accept()
    assert QApplication.activeModalWidget() is None
    assert (saved, "exists" in dialog.windowTitle()) == ([], True)
    dialog.accept()
    assert saved == [there]


def test_file_dialog_does_not_block_the_window(live, tmp_path, monkeypatch):
    """The dialog is beside the window, not over it; the folder is remembered; the saved file is reported."""
    live.refresh()
    live.draw()
    live.save_plot(live.live.plots, "csv")
    dialog = next(d for d in live.findChildren(QFileDialog))
    assert not dialog.isModal()
    dialog.fileSelected.emit(str(tmp_path / "shown.csv"))
    live.refresh()
    assert (tmp_path / "shown.csv").stat().st_size > 1000
    assert live.model.preferences.get("folder") == str(tmp_path)
    assert live.strip.text.text() == "Saved shown.csv."
    opened = []
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: opened.append(url.toLocalFile()) or True)
    for button in (live.strip.open_file, live.strip.folder):
        assert button.isVisible()
        button.click()
    assert [Path(name).name for name in opened] == ["shown.csv", tmp_path.name]
    live.model.notices.inform("another message")
    live.refresh()
    assert not live.strip.open_file.isVisible()


def test_a_folder_that_is_gone_is_not_offered_again(live, tmp_path):
    """A failed save to a missing folder was remembered; the next file went into the working directory, unsaid."""
    services, missing = live.model.services, tmp_path / "removed"
    services.preferences.set("folder", str(tmp_path))
    ask_save(live, services, "a", "csv", lambda path: None).fileSelected.emit(str(missing / "a.csv"))
    assert services.preferences.get("folder") == str(tmp_path)
    services.preferences.set("folder", str(missing))
    usual = services.recordings if services.recordings.is_dir() else Path.home()
    assert Path(ask_save(live, services, "a", "csv", lambda path: None).directory().path()) == usual
