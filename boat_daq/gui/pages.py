"""The pages behind the live one, by their name in the navigation."""

from __future__ import annotations

from typing import Any

from boat_daq.gui.calibration_page import CalibrationPage
from boat_daq.gui.optics_page import OpticsPage
from boat_daq.gui.repeat_page import RepeatPage
from boat_daq.gui.runs_page import RunsPage
from boat_daq.gui.shadow_page import ShadowPage
from boat_daq.gui.tradeoff_page import TradeoffPage
from boat_daq.viewmodels.desk import Desk


def make_pages(desk: Desk) -> dict[str, Any]:
    """Return the pages in the order of the navigation."""
    return {
        "Calibrate": CalibrationPage(desk),
        "Repeat": RepeatPage(desk),
        "Runs": RunsPage(desk),
        "Optics": OpticsPage(desk),
        "Shadow": ShadowPage(desk),
        "Trade-off": TradeoffPage(desk),
    }
