"""The pages behind the live one, by their name in the navigation."""

from __future__ import annotations

from typing import Any

from boat_daq.gui.calibration_page import CalibrationPage
from boat_daq.gui.empty_page import EmptyPage
from boat_daq.viewmodels.desk import Desk


def make_pages(desk: Desk) -> dict[str, Any]:
    """Return the pages in the order of the navigation."""
    return {
        "Calibrate": CalibrationPage(desk),
        "Repeat": EmptyPage("Calibrate", "", "", lambda: None),
        "Runs": EmptyPage("Calibrate", "", "", lambda: None),
        "Optics": EmptyPage("Calibrate", "", "", lambda: None),
        "Shadow": EmptyPage("Calibrate", "", "", lambda: None),
        "Trade-off": EmptyPage("Calibrate", "", "", lambda: None),
    }
