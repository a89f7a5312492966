"""Warnings about a result: a code for programs, which is part of the interface, and a text that may change freely."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class WarningCode(StrEnum):
    """What a warning is about."""

    SIMULATED = "simulated"
    GAPS = "gaps"
    IMPORT = "import"
    CRC_ERRORS = "crc_errors"
    PRESSURE_NOT_FINITE = "pressure_not_finite"
    SIGNAL_NOT_FINITE = "signal_not_finite"
    SATURATED = "saturated"
    PRESSURE_INVALID = "pressure_invalid"
    IMPLAUSIBLE = "implausible"
    PRESSURE_DROPPED_OUT = "pressure_dropped_out"
    CLIPPED = "clipped"
    FROZEN = "frozen"
    DROPPED_OUT = "dropped_out"
    DAMAGED = "damaged"
    NOISY_PRESSURE = "noisy_pressure"
    NOT_DRIVEN = "not_driven"
    NO_CYCLE = "no_cycle"
    BREAK = "break"
    DIFFERS_OVER_BREAK = "differs_over_break"
    UNTESTED_BREAK = "untested_break"
    PARTIAL_CYCLE = "partial_cycle"
    CYCLE_LEFT_OUT = "cycle_left_out"
    EXCURSION_LEFT_OUT = "excursion_left_out"
    TOLERANCE_TOO_WIDE = "tolerance_too_wide"
    VOID = "void"
    SHORT_HOLDS = "short_holds"
    MARKS_DISAGREE = "marks_disagree"
    CONSTANT_SIGNAL = "constant_signal"
    FLAT = "flat"
    INFLUENCE = "influence"
    NOT_SETTLED = "not_settled"
    DRIFT = "drift"
    NO_SPAN = "no_span"
    HYSTERESIS_IS_A_BOUND = "hysteresis_is_a_bound"
    HYSTERESIS_IN_PART = "hysteresis_in_part"
    NO_CALIBRATION = "no_calibration"
    NOT_MONOTONE = "not_monotone"
    OUT_OF_TOLERANCE = "out_of_tolerance"
    # of a camera
    CAMERA_DELAY = "camera_delay"
    CAMERA_CONTRADICTS = "camera_contradicts"
    CAMERA_REST = "camera_rest"
    CAMERA_NO_VALUE = "camera_no_value"
    # of a calibration
    CONSTANT_Y = "constant_y"
    NO_UNCERTAINTY = "no_uncertainty"
    MONOMIAL_ROUNDING = "monomial_rounding"
    NEAR_TURNING_POINT = "near_turning_point"
    HIGH_LEVERAGE = "high_leverage"
    OUTLIER = "outlier"
    READING_GRID = "reading_grid"
    READING_ERROR_OVERSTATED = "reading_error_overstated"
    READING_CONFIRMED = "reading_confirmed"
    READING_LEFT_OUT = "reading_left_out"
    POINT_LEFT_OUT = "point_left_out"
    # of the residuals of any fit
    STATED_UNCERTAINTY = "stated_uncertainty"
    NOTHING_EXPLAINED = "nothing_explained"
    DOUBTFUL_CURVE = "doubtful_curve"
    INADEQUATE_CURVE = "inadequate_curve"
    REFUSED_CURVE = "refused_curve"
    # of its posterior
    NO_POSTERIOR = "no_posterior"
    NOT_CONVERGED = "not_converged"
    UNCHECKED_CURVE = "unchecked_curve"
    # of a table and its columns
    RAGGED_ROW = "ragged_row"
    NOT_A_NUMBER = "not_a_number"
    CLOCK_COLUMN = "clock_column"
    TABLE_CHOSEN = "table_chosen"
    UNIT_GUESSED = "unit_guessed"
    UNIT_UNKNOWN = "unit_unknown"
    TIME_GUESSED = "time_guessed"
    # of the full model
    COARSE_MESH = "coarse_mesh"
    # of a state of the shadow
    UNSTABLE_STATE = "unstable_state"
    CONTRADICTORY_STATE = "contradictory_state"
    OUTSIDE_TABLE = "outside_table"


_OF_CALIBRATION = (
    "constant_y", "no_uncertainty", "monomial_rounding", "near_turning_point", "high_leverage", "outlier",
)  # fmt: skip
_FLAGS = {**dict.fromkeys(map(WarningCode, _OF_CALIBRATION), "calibration"), WarningCode.UNCHECKED_CURVE: "posterior"}


@dataclass(frozen=True, slots=True)
class Warning:
    """One warning; `subject` is a sensor (s1, ...), a figure, or "" for the whole; `text` has its cause first."""

    code: WarningCode
    subject: str
    text: str

    @property
    def sentence(self) -> str:
        return f"{self.subject}: {self.text}" if self.subject else self.text

    def as_flag(self) -> dict[str, str]:
        """Return an entry of `flags`, which has one code for all of a calibration."""
        return {"code": _FLAGS.get(self.code, str(self.code)), "text": self.sentence}
