"""What a calibration certificate states (ISO/IEC 17025:2017, 7.8.2 and 7.8.4), gathered once for every form of it.

Strategy: a certificate has items; each is a unit with its recording, its metadata and its sensors; each sensor has its
curve and a level for every plateau position, loading and unloading apart. PDF, XML and JSON are written from this value
alone, so that their numbers are equal.

Rules: nothing is estimated anew: an uncertainty is that of the run's budget (`analysis.figures.uncertainty`). A sensor
whose curve gives no elongation has no results, and the reason; a run without any is refused. A curve that is known to
miss the readings marks every page. A simulated run is never certified: number, pages and XML carry SIMULATED, and what
was not stated of it is named as such.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.compare import Agreement, compare_fits
from analysis.calibration.fit import Calibration
from analysis.calibration.inverse import Inverse, raise_without_inverse
from analysis.calibration.record import CalibrationRecord
from analysis.calibration.type_b import NO_SPREAD, Traceability, TypeBContribution, not_assessed, traceability
from analysis.calibration_export.verdict import verdict_of
from analysis.certificates.laboratory import Laboratory
from analysis.conformity import RULE
from analysis.figures.acceptance import LimitStatement, judge
from analysis.figures.figure import SENSOR_FIGURES
from analysis.figures.pipeline import Analysis
from analysis.figures.uncertainty import BudgetOfSensor, signal_parts
from analysis.history.unit_history import one_signal_unit, refuse_mixture
from analysis.json_object import json_object
from analysis.numbers import finite
from analysis.version import program_version
from protocol.base.errors import BoatDaqError, DataError, RequestError
from protocol.base.units import COVERAGE_FACTOR
from protocol.recording import Metadata

SIMULATED = "SIMULATED"
NOT_STATED = "not stated"
NO_CERTIFICATE = "NO CERTIFICATE"
NOT_ADEQUATE = "CURVE NOT ADEQUATE"
UNKNOWN_COUNTRY = "ZZ"  # ISO 3166 leaves it to users
RELATES = "This certificate relates only to the item calibrated."
WHOLE = "It shall not be reproduced except in full without the approval of the laboratory."
UNCERTAINTY = (
    "The expanded uncertainty U is the standard uncertainty of an elongation that is read from one signal, multiplied "
    "by the coverage factor k = 2 (GUM, JCGM 100:2008); for a normal distribution it covers about 95 %."
)
METHOD = (
    "The actuator is driven through a staircase of pressures for several cycles. At each plateau the elongation is "
    "read from a reference scale and each sensor's signal is averaged after settling. The calibration function is "
    "fitted jointly to the means of all positions."
)

ADJUSTMENT = "No adjustment or repair was made: the results apply to the item as found and as left."
_SIGNAL_PLACES = 2  # of a signal in mV, whose full scale is some hundreds
_FIGURES = ("sensitivity_mv_per_mm", "fso_mv", "sensor_hysteresis_percent_fso", "repeatability_percent_fso", "snr_db")


@dataclass(frozen=True, slots=True)
class Level:
    """One position of the staircase: means over the cycles."""

    branch: str  # loading, unloading, or end: the end levels belong to both
    pressure_kpa: float
    elongation_mm: float
    signal_mv: float
    indicated_mm: float  # the elongation that the curve gives for the signal
    expanded_mm: float  # U of such an elongation, k = 2, covering `coverage`
    coverage: float
    n: int

    @property
    def deviation_mm(self) -> float:
        return self.indicated_mm - self.elongation_mm

    def as_json(self) -> dict[str, Any]:
        named = ("indicated_mm", "deviation_mm", "expanded_uncertainty_mm=expanded_mm")
        found = json_object(self, "branch", "pressure_kpa", "elongation_mm", "signal_mv", *named)
        return found | {"coverage_factor": COVERAGE_FACTOR, "coverage_probability": self.coverage, "n": self.n}


@dataclass(frozen=True, slots=True)
class CalibratedSensor:
    """One sensor of an item; without results where `void` gives the reason."""

    name: str
    void: str
    calibration: Calibration | None = None
    levels: tuple[Level, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)  # value by name, of `_FIGURES`
    statements: tuple[LimitStatement, ...] = ()  # conformity with the limits of the customer
    as_found: Agreement | None = None  # the curve in force before against this one; None without
    more_places: int = 0  # decimals of a signal in another unit than mV, less those of one in mV

    def places(self, key: str = "") -> int:
        """Return the decimals of a figure, or of a signal."""
        places = SENSOR_FIGURES[key].decimals if key else _SIGNAL_PLACES
        return max(0, places + self.more_places) if "_mv" in key or not key else places

    @property
    def only_branch(self) -> str:
        """The branch of all levels between the ends, where no other was measured; else ""."""
        found = {level.branch for level in self.levels} - {"end"}
        return found.pop() if len(found) == 1 else ""

    @property
    def inadequate(self) -> bool:
        """Whether the curve is known to miss the readings."""
        adequacy = self.calibration.adequacy if self.calibration is not None else None
        return adequacy is not None and adequacy.verdict is CurveVerdict.INADEQUATE

    def as_json(self) -> dict[str, Any]:
        found = self.as_found
        before = None
        if found is not None:
            before = {
                "difference_mm": float(found.difference_mm[found.worst]),
                "elongation_mm": float(found.grid[found.worst]),
                "e_n": float(found.e_n[found.worst]),
                "agrees": found.agrees,
            }
        adequacy = self.calibration.adequacy if self.calibration is not None else None
        return {
            **json_object(self, "name", "void", "calibration"),
            "verdict": None if adequacy is None else str(adequacy.verdict),
            **json_object(self, "levels", "figures", "conformity=statements"),
            "as_found": before,
        }


@dataclass(frozen=True, slots=True)
class CalibratedItem:
    """One unit that was calibrated: its identity, its conditions, its sensors."""

    name: str
    unit: str
    metadata: Metadata
    recording_id: str
    begun: str  # date, ISO 8601, as `ended`
    ended: str
    board: str
    sensors: tuple[CalibratedSensor, ...]
    type_b: tuple[TypeBContribution, ...]
    warnings: tuple[str, ...]
    previous: str = ""  # when the calibration in force before was made, ISO 8601; "" without one
    signal_unit: str = "mV"

    @property
    def traceability(self) -> Traceability:
        """Whether its elongations are metrologically traceable, and to what."""
        return traceability(self.type_b)

    @property
    def not_assessed(self) -> tuple[str, ...]:
        """The contributions that nobody stated."""
        return not_assessed(self.type_b)

    def as_json(self) -> dict[str, Any]:
        run = ("recording=recording_id", "calibrated_from=begun", "calibrated_to=ended", "board")
        traced = ("traceable=traceability.traceable", "traceability=traceability.text")
        return {
            **json_object(self, "item=name", "unit", "signal_unit", "metadata", *run, *traced),
            "standards": {one.name: one.statement for one in self.type_b},
            "not_assessed": list(self.not_assessed),
            "previous": self.previous or None,
            **json_object(self, "warnings", "sensors"),
        }


@dataclass(frozen=True, slots=True)
class Certificate:
    """A certificate of one item, or of several that are compared."""

    number: str  # unique: of the first recording and of all that is stated; it changes with any of it
    issued: str  # date, ISO 8601
    simulated: bool
    laboratory: Laboratory
    customer: str
    items: tuple[CalibratedItem, ...]

    @property
    def scope(self) -> str:
        """What it relates to, and how it is copied (ISO/IEC 17025, 7.8.2.1); empty for a simulated run."""
        return "" if self.simulated else f"{RELATES} {WHOLE}"

    @property
    def title(self) -> str:
        return "Calibration of a simulated unit" if self.simulated else "Calibration certificate"

    @property
    def marks(self) -> tuple[str, ...]:
        """What is written across every page, beside SIMULATED."""
        inadequate = any(sensor.inadequate for item in self.items for sensor in item.sensors)
        return (*([NO_CERTIFICATE] if self.simulated else []), *([NOT_ADEQUATE] if inadequate else []))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the results must know, a sentence each."""
        return tuple(f"{item.name}: {text}." for item in self.items for text in item.warnings)

    def as_json(self) -> dict[str, Any]:
        """Return the object of `certificate --json`; NaN are left for the writer to turn into null."""
        return {
            **json_object(self, "number", "title", "issued", "simulated"),
            "marks": [*([SIMULATED] if self.simulated else []), *self.marks],
            "program_version": program_version(),
            **json_object(self, "laboratory", "customer"),
            "decision_rule": RULE,
            **json_object(self, "items"),
        }


@dataclass(frozen=True, slots=True)
class Request:
    """What a certificate states that no run shows."""

    laboratory: Laboratory | None = None
    customer: str = ""  # overrides that of the metadata
    items: tuple[str, ...] = ()  # names in the order of the runs; overrides those of the metadata
    limits: Mapping[str, float] = field(default_factory=dict)  # the customer's, see `figures.acceptance.LIMITS`
    issued: str = ""  # date, ISO 8601; today where it is empty
    number: str = ""
    previous: tuple[CalibrationRecord | None, ...] = ()  # calibration in force before each run; None without


def missing(analyses: Sequence[Analysis], request: Request) -> tuple[str, ...]:
    """Return what a certificate must state and nobody has stated: laboratory, customer, item."""
    stated = [analysis.recording.metadata for analysis in analyses]
    named = [
        name or analysis.recording.unit
        for analysis, name in zip(analyses, [*request.items, *[""] * len(analyses)], strict=False)
    ]
    found = {
        "laboratory": request.laboratory is not None,
        "customer": bool(request.customer) or all(one.customer for one in stated),
        "item": all(name or one.item or one.serial_number for name, one in zip(named, stated, strict=True)),
    }
    return tuple(name for name, known in found.items() if not known)


def certificate_of(analyses: Sequence[Analysis], request: Request) -> Certificate:
    """Return the certificate of one calibration, or of several that are compared.

    RequestError: nothing to certify; simulated and real runs; a date that is none; what it must state is missing.
    DataError: a run has no calibration that gives an elongation; an item has no identity.
    """
    if not analyses:
        raise RequestError("there is no run to certify", "Give the recording of a calibration.")
    refuse_mixture(analysis.recording.simulated for analysis in analyses)
    one_signal_unit(analysis.recording.signal_unit for analysis in analyses)
    simulated = analyses[0].recording.simulated
    needed = missing(analyses, request)
    if needed and not simulated:
        command = " ".join(f"--{name} {'FILE.toml' if name == 'laboratory' else 'TEXT'}" for name in needed)
        raise RequestError(f"the certificate lacks: {', '.join(needed)}", "State what is missing.", command=command)
    issued = request.issued or datetime.datetime.now().astimezone().date().isoformat()
    try:
        datetime.date.fromisoformat(issued)
    except ValueError:
        raise RequestError(f"{issued!r:.40} is not a date", "Give it as 2026-01-31.") from None
    names, before = [*request.items, *[""] * len(analyses)], [*request.previous, *[None] * len(analyses)]
    items = tuple(_item(analysis, names[k], before[k], request.limits, issued) for k, analysis in enumerate(analyses))
    laboratory = request.laboratory or Laboratory(f"{NOT_STATED} (simulated run)")
    customers = dict.fromkeys(filter(None, (item.metadata.customer for item in items)))
    customer = request.customer or ", ".join(customers) or f"{NOT_STATED} (simulated run)"
    made = Certificate(request.number, issued, simulated, laboratory, customer, items)
    return made if request.number and not simulated else replace(made, number=_number(made))


def _number(certificate: Certificate) -> str:
    """Return a number made from the first recording and a digest of all that is stated."""
    text = json.dumps(finite(certificate.as_json()), sort_keys=True)
    digest = hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()[:8].upper()
    parts = [SIMULATED] if certificate.simulated else []
    own = certificate.number or certificate.items[0].recording_id[:8].upper()
    return "-".join([*parts, own, digest])


def _item(
    analysis: Analysis, name: str, previous: CalibrationRecord | None, limits: Mapping[str, float], issued: str
) -> CalibratedItem:
    recording, stated = analysis.recording, analysis.recording.metadata
    name = name or stated.item or recording.unit
    if not (name or stated.serial_number):
        cause = f"{recording.source or 'the run'} names no unit, so the item has no identity"
        raise DataError(cause, "State the item.", command="--item TEXT")
    previous = previous if previous is not None and previous.signal_unit == recording.signal_unit else None
    before = previous.sensors if previous is not None else ()
    sensors = [
        _sensor(analysis, index, before[index].fit if index < len(before) else {}, limits)
        for index in range(len(analysis.sensors))
    ]
    if check := verdict_of(analysis, limits).check_text:
        remedy = "Correct it, leave it out, or confirm it with a reason."
        raise DataError(f"{recording.source or 'the run'} has {check}", remedy)
    if all(sensor.void for sensor in sensors):
        parts = [signal_parts(analysis, i) for i, one in enumerate(analysis.sensors) if one.calibration is not None]
        one_cycle = any(part.one_cycle for part in parts)
        why = f"its U is not known: {NO_SPREAD}" if one_cycle else sensors[0].void
        cause = f"{recording.source or 'the run'} has no calibration to certify: {why}"
        if any(part.void for part in parts):
            raise DataError(cause, "Run two cycles or more, and read both branches.")
        raise DataError(cause, "Calibrate the unit, or choose another curve.")
    begun, ended = (str(recording.meta.get(key) or "")[:10] for key in ("started_utc", "ended_utc"))
    if recording.meta.get("imported_from") is not None:
        ended = begun  # the end of an imported file is its import
    if not begun and not recording.simulated:
        cause = f"it is not known when {recording.source or 'the run'} was recorded"
        raise DataError(cause, "State it when importing.", command="boat-daq import FILE.csv --started TIME")
    begun, own = begun or issued, str(recording.meta.get("uuid") or Path(recording.source).stem)
    return CalibratedItem(
        name=name or NOT_STATED,
        unit=recording.unit,
        metadata=stated,
        recording_id=own,
        begun=begun,
        ended=max(ended, begun),
        board=str(recording.meta.get("board_id") or ""),
        sensors=tuple(sensors),
        type_b=analysis.options.type_b,
        warnings=(
            *(warning.sentence for warning in analysis.warnings),
            *(f"{one.name}: only the {way} branch was measured" for one in sensors if (way := one.only_branch)),
            *(
                f"{one.name}: {text}"
                for i, one in enumerate(analysis.sensors)
                if (text := signal_parts(analysis, i).stand_in)
            ),
        ),
        previous=previous.calibrated_utc if previous is not None else "",
        signal_unit=recording.signal_unit,
    )


def _sensor(analysis: Analysis, index: int, before: Mapping[str, Any], limits: Mapping[str, float]) -> CalibratedSensor:
    sensor = analysis.sensors[index]
    calibration = sensor.calibration
    if calibration is None:
        return CalibratedSensor(sensor.name, f"not calibrated: {sensor.calibration_void}")
    try:
        raise_without_inverse(calibration)
    except BoatDaqError as error:
        return CalibratedSensor(sensor.name, error.cause)
    if unknown := signal_parts(analysis, index).void:
        return CalibratedSensor(sensor.name, f"its U is not known: {unknown}")
    (low, high), least = calibration.x_range, float(np.nanmin(analysis.u_elongation[index][:, 1], initial=math.inf))
    if not least < high - low:
        return CalibratedSensor(sensor.name, f"its U of {least:.2g} mm is wider than its range")
    found = None
    if before:
        try:
            found = compare_fits(calibration.as_json(), before)
        except (BoatDaqError, KeyError):
            found = None  # another range or a spline: nothing to compare
    values = {key: sensor.figures[key].value for key in _FIGURES if key in sensor.figures}
    fso, more = sensor.figures["fso_mv"].value, 0
    if analysis.recording.signal_unit != "mV" and fso > 0:
        more = 2 - math.floor(math.log10(fso))
    statements = tuple(judge([sensor], limits))
    return CalibratedSensor(
        sensor.name, "", calibration, _levels(analysis, index), values, statements, found, more_places=more
    )


def _levels(analysis: Analysis, index: int) -> tuple[Level, ...]:
    """Return the positions of a sensor's points: unloading from the highest pressure, then loading from the lowest."""
    sensor = analysis.sensors[index]
    calibration = sensor.calibration
    assert calibration is not None
    points = sensor.point_plateau.astype(np.int64)
    labels, of_point = np.unique(analysis.position_of(points), return_inverse=True)
    branch = analysis.branch_of(points)
    pressure = np.asarray([analysis.plateaus[i].pressure_kpa for i in points])
    inverse, budget = Inverse.of(calibration), BudgetOfSensor.of(analysis, index)
    found = []
    for k in range(labels.size):
        own = of_point == k
        x, y = float(calibration.x[own].mean()), float(calibration.y[own].mean())
        stated = budget.at(float(np.clip(x, *calibration.x_range)))
        name = {1.0: "loading", -1.0: "unloading"}.get(float(branch[own][0]), "end")
        indicated = float(inverse.evaluate(y).elongation_mm)
        p = float(pressure[own].mean())
        found.append(Level(name, p, x, y, indicated, stated.expanded, stated.coverage, int(own.sum())))
    falling = [level for level in found if level.branch != "loading"]
    rising = [level for level in found if level.branch == "loading"]
    return (*sorted(falling, key=lambda one: -one.pressure_kpa), *sorted(rising, key=lambda one: one.pressure_kpa))


def figure_label(key: str) -> str:
    """Return the label of a figure with its unit."""
    return SENSOR_FIGURES[key].label_with_unit
