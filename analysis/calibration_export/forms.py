"""The forms in which a calibration leaves the program, and its file in one of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from analysis.calibration.inverse import BEYOND_SIGMA, DISAGREEMENT_SIGMA
from analysis.calibration_export.c_header import USUAL_ERROR_MM, c_header, comment_text, table_csv, template_of
from analysis.calibration_export.calibration_file import CalibrationFile
from protocol.base.errors import writing
from protocol.base.units import in_a_name, in_signal_unit
from protocol.base.whole_file import write_whole

FUNCTION = "boat_elongation"


def matlab_function(calibration: CalibrationFile) -> str:
    """Return the function's text, for a file `boat_elongation.m`. DataError: the calibration gives no elongation."""
    fusion = calibration.reader()
    template = template_of(f"{FUNCTION}.m.j2")
    return str(
        template.render(
            comment=[comment_text(line) for line in (calibration.title, *calibration.remarks)],
            sensors=[
                {
                    "number": number, "range_mm": inverse.x_range, "half_division_mm": inverse.half_division_mm,
                    "slopes": inverse.end_slopes, "starts": inverse.starts, "powers": inverse.powers.tolist(),
                    "nodes_mv": inverse.nodes, "noise_mm": inverse.noise_mm, "shared_mm": inverse.shared_mm,
                }
                for number, inverse in enumerate(fusion.inverses)
            ],
            correlation=fusion.correlation.tolist(),
            left_out=[number + 1 for number, used in enumerate(fusion.used) if not used],
            u_known=not fusion.u_void,
            reference=fusion.inverses[0].reference,
            beyond=BEYOND_SIGMA,
            disagreement=DISAGREEMENT_SIGMA,
        )
    )  # fmt: skip


FORMS: Mapping[str, str] = {"json": ".json", "c": ".h", "matlab": ".m", "csv": ".csv"}  # form -> suffix of its file


def calibration_text(calibration: CalibrationFile, form: str, table_error_mm: float | None = None) -> str:
    """Return a calibration in one of `FORMS`. DataError: code without an elongation. RequestError: the bound."""
    if form == "json":
        return calibration.text()
    if form == "matlab":
        text = matlab_function(calibration)
    elif form == "csv":
        text = table_csv(calibration, USUAL_ERROR_MM if table_error_mm is None else table_error_mm)
    else:
        text = c_header(calibration, table_error_mm)
    unit = calibration.signal_unit
    name = in_a_name(unit)
    name = name if name not in ("", "mm") else "signal"  # mm is the elongation's
    return in_signal_unit(re.sub(r"_mv(?![a-z])", f"_{name}", text), unit) if unit != "mV" else text


def write_calibration(calibration: CalibrationFile, path: Path, form: str, table_error_mm: float | None = None) -> None:
    """Write a calibration as `calibration_text`, whole or not at all. FileError: the file cannot be written."""
    text = calibration_text(calibration, form, table_error_mm)
    with writing(path):
        write_whole(path, text)
