"""The pages behind the live one, by their name in the navigation; each is made when it is first gone to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from boat_daq.gui.models.optics_page import OpticsPage
from boat_daq.gui.models.shadow_page import ShadowPage
from boat_daq.gui.models.tradeoff_page import TradeoffPage
from boat_daq.gui.results.calibration_page import CalibrationPage
from boat_daq.gui.results.repeat_page import RepeatPage
from boat_daq.gui.results.runs_page import RunsPage
from boat_daq.viewmodels.app_model import Desk

PAGE_MAKERS: dict[str, Callable[[Desk], Any]] = {
    "Calibrate": CalibrationPage,
    "Repeat": RepeatPage,
    "Runs": RunsPage,
    "Optics": OpticsPage,
    "Shadow": ShadowPage,
    "Trade-off": TradeoffPage,
}
