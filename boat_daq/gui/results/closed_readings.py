"""The readings of an older recording, in a panel beside the window. Not modal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, QTimerEvent
from PySide6.QtWidgets import QDialog, QVBoxLayout, QWidget

from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.gui import style
from boat_daq.gui.live.readings_panel import ReadingsTable
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common.services import Services, Tab
from boat_daq.viewmodels.live.readings import ReadingsModel
from protocol.base.units import STORED_UNITS, ShownUnits

_REFRESH_MS = 250
_IDLE = SessionSnapshot(SessionState.IDLE, LinkState.CLOSED)


class ClosedReadings(QDialog):
    """Edits the readings of a closed recording; what was entered before stays in the file."""

    def __init__(
        self,
        parent: QWidget,
        path: Path,
        calibrate: Callable[[Path], None],
        services: Services,
        units: ShownUnits = STORED_UNITS,
    ) -> None:
        super().__init__(parent)
        self.path, self.analyse, self.services = path, calibrate, services
        self.setWindowTitle(f"Readings of {path.name}")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(style.FORM_WIDTH, style.list_height(self))
        readings = ReadingsModel.of_closed(path, services.undo)
        readings.units = units
        self.table = ReadingsTable(readings, services)
        self.table.empty.setText("This recording has no plateaus: its plan has no steps.")
        self.calibrate = controls.button("Calibrate", self._calibrate, tip="Analyse it with these readings")
        layout = QVBoxLayout(self)
        layout.addWidget(
            controls.label("Corrections are added to the recording; earlier readings stay in it.", "muted", wrap=True)
        )
        layout.addWidget(self.table, 1)
        layout.addLayout(controls.row(None, controls.button("Close", self.close), self.calibrate))
        self.timerEvent()
        self.startTimer(_REFRESH_MS)  # undo is a key of the window, not of this panel

    def timerEvent(self, event: QTimerEvent | None = None) -> None:
        """Show the readings as they are now, whatever page the window shows."""
        self.table.refresh(_IDLE)

    def _calibrate(self) -> None:
        if self.services.notices.attempt(lambda: self.analyse(self.path)):
            self.services.show(Tab.CALIBRATION)
            self.close()
