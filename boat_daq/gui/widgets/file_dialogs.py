"""File dialogs that do not block the window: none is modal, so that VENT can always be pressed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QFileDialog, QWidget

from boat_daq.gui import style
from boat_daq.viewmodels.common.notices import Notices, Severity
from boat_daq.viewmodels.common.services import Services

_NAMED = {"h": "C header (.h)", "m": "MATLAB or Octave (.m)", "h5": "HDF5", "mat": "MATLAB"}
"""Names of the files whose ending is no name."""
Then = Callable[[Path], object]


class FileDialog(QFileDialog):
    """A file dialog without Qt's message boxes, which are modal and would block VENT; none of its actions opens one."""

    def __init__(self, parent: QWidget, title: str, folder: str, kinds: str) -> None:
        super().__init__(parent, title, folder, kinds)
        option = QFileDialog.Option
        usual = option.DontUseNativeDialog | option.DontConfirmOverwrite | option.ReadOnly
        self.setOptions(usual | option.HideNameFilterDetails)
        self.resize(style.PAGE_WIDTH, style.WINDOW_MINIMUM[1])  # every column of its list is seen
        self._confirmed: Path | None = None

    def accept(self) -> None:
        """Accept the file; refuse a missing one, confirm the replacement of an existing one in the title."""
        path = Path((self.selectedFiles() or ["."])[0])
        saves = self.acceptMode() is QFileDialog.AcceptMode.AcceptSave
        if saves and path.is_file() and path != self._confirmed:
            self._confirmed = path
            self.setWindowTitle(f"{path.name} exists: press Replace, or type another name")
            self.setLabelText(QFileDialog.DialogLabel.Accept, "Replace")
        elif not saves and not path.exists():
            self.setWindowTitle(f"There is no {path.name} in {path.parent}")
        else:
            super().accept()


def open_folder(folder: Path, services: Services) -> None:
    """Show a folder in the system's file manager; where there is none, show its path."""
    folder.mkdir(parents=True, exist_ok=True)
    open_path(folder, services.notices)


def open_path(path: Path, notices: Notices) -> None:
    """Open a file in its program, or a folder in the file manager; where there is none, show the path."""
    if not QDesktopServices.openUrl(QUrl.fromLocalFile(str(path))):
        kind = "file manager" if path.is_dir() else "program"
        notices.add(
            Severity.WARNING, f"no {kind} is installed to open {path}", "Open it from another computer or program."
        )


def ask_save(
    parent: QWidget, services: Services, stem: str, suffix: str, then: Then, *, done: str | None = None
) -> QFileDialog:
    """Show a dialog to save a file, then call `then(path)`; its error becomes a notice.

    Parameters
    ----------
    suffix : the endings allowed, without dots, separated by spaces; the first is the default.
    done : notice after `then` has returned; "Saved" and the name when None, no notice when empty.
    """
    named = " or ".join(_NAMED.get(one, one.upper()) for one in suffix.split())
    dialog = _dialog(parent, services, f"Save {named}", suffix, then, done)
    first = suffix.split()[0]
    dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
    dialog.setDefaultSuffix(first)
    dialog.selectFile(f"{re.sub(r'[^A-Za-z0-9_-]+', '-', stem).strip('-')}.{first}")
    return dialog


def ask_open(parent: QWidget, services: Services, title: str, suffixes: str, then: Then) -> QFileDialog:
    """Show a dialog for files with these suffixes, then call `then(path)`; its error becomes a notice."""
    dialog = _dialog(parent, services, title, suffixes, then, "")
    dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
    return dialog


def _dialog(
    parent: QWidget, services: Services, title: str, suffixes: str, then: Then, done: str | None
) -> QFileDialog:
    def finish(name: str) -> None:
        path = Path(name)
        if path.parent.is_dir():
            services.preferences.set("folder", str(path.parent))
        if services.notices.attempt(lambda: then(path), done=done or "") and done is None:
            services.notices.inform_saved(path)

    kinds = ", ".join(dict.fromkeys(_NAMED.get(suffix, suffix.upper()) for suffix in suffixes.split()))
    patterns = " ".join(f"*.{suffix}" for suffix in suffixes.split())
    usual = services.recordings if services.recordings.is_dir() else Path.home()
    last = Path(str(services.preferences.get("folder", usual)))
    folder = last if last.is_dir() else usual  # Qt takes the working directory for one that was removed
    dialog = FileDialog(parent.window(), title, str(folder), f"{kinds} ({patterns})")
    dialog.setWindowModality(Qt.WindowModality.NonModal)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    dialog.fileSelected.connect(finish)
    dialog.show()
    return dialog
