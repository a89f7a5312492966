"""A calibration as one function for MATLAB and GNU Octave, with the arrays and the steps of `Inverse`."""

from __future__ import annotations

from analysis.calibration.inverse import BEYOND_SIGMA, DISAGREEMENT_SIGMA
from analysis.calibration_export.c_header import comment_text, template_of
from analysis.calibration_export.calibration_file import CalibrationFile

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
