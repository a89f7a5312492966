"""The field for the tolerance of the figures, on each page that shows some."""

from __future__ import annotations

from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.common.tolerance import TypedText

TIP = (
    "Greatest error that resamples and samples leave (95 %), any number: in % FSO, of all intervals and sampled bands; "
    "in mm, of the sampled bands. Automatic: by the precision in the Models menu. The report follows it too"
)


def tolerance_field(tolerance: TypedText, services: Services) -> widgets.TypedField:
    """Return the field."""
    return widgets.typed("Tolerance of the figures", tolerance, services.notices.attempt, tip=TIP)
