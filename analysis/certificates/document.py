"""A certificate as a document, whose PDF/A-3 holds the XML.

Rules: nothing is computed but a rounding; every page carries number, page x of y and its marks; the place of the
signature is empty. What nobody stated is named as not stated.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from analysis import figure_style as style
from analysis.calibration.fit import Calibration
from analysis.certificates.certificate import (
    ADJUSTMENT,
    METHOD,
    NO_CERTIFICATE,
    NOT_STATED,
    RELATES,
    SIMULATED,
    UNCERTAINTY,
    CalibratedItem,
    CalibratedSensor,
    Certificate,
    figure_label,
)
from analysis.certificates.dcc import MIME_TYPE, dcc_xml
from analysis.conformity import RULE
from analysis.figures.figure import SENSOR_FIGURES
from analysis.numbers import percent, rounded, with_uncertainty
from analysis.reports.document import Attachment, Report, ReportDrawing, ReportTable, Section, SectionPart, power
from analysis.reports.pdf import render_pages
from analysis.reports.shown_units import in_units
from protocol.base.units import COVERAGE_FACTOR, NOTHING, STORED_UNITS

_CURVE_POINTS = 101
PREVIEW_PPI = 150.0


def certificate_pages(certificate: Certificate) -> list[bytes]:
    """Return the pages of the document as PNG images."""
    return render_pages(certificate_document(certificate), PREVIEW_PPI)


def certificate_document(certificate: Certificate) -> Report:
    """Return the certificate as a document; its PDF holds the XML as a file."""
    items, several = certificate.items, len(certificate.items) > 1
    sections = [_statement(certificate)]
    for item in items:
        of = f" of {item.name}" if several else ""
        sections += [_conditions(item, of)] if several else []
        results = [Section(f"Results{of}: sensor {k}", _results(one)) for k, one in enumerate(item.sensors, 1)]
        results[-1] = replace(results[-1], parts=(*results[-1].parts, *_curves(item)))
        sections += [*results, Section(f"Standards and traceability{of}", _standards(item))]
    if several:
        sections.insert(1, Section("Comparison", _comparison(certificate)))
    if any(sensor.statements for item in items for sensor in item.sensors):
        sections.append(Section("Conformity", _conformity(certificate)))
    sections.append(Section("As found and as left", (ADJUSTMENT, *_as_found(certificate))))
    notes = (f"{item.name}, note: {item.metadata.note}" for item in items if item.metadata.note)
    remarks = (*certificate.remarks, *notes)
    sections += [Section("Remarks", remarks)] if remarks else []
    sections.append(Section("Signature", _signature(certificate)))
    xml = Attachment("dcc.xml", dcc_xml(certificate), MIME_TYPE, "Digital Calibration Certificate 3.2.1")
    return in_units(Report(
        certificate.title, f"No. {certificate.number}", certificate.simulated, _verdict(certificate),
        _facts(certificate), tuple(sections), _foot(certificate), certificate.issued,
        certificate.marks, certificate.laboratory.name, (xml,),
    ), STORED_UNITS.of_signals_in(items[0].signal_unit))  # fmt: skip


def _foot(certificate: Certificate) -> str:
    return f"No. {certificate.number}{'' if certificate.simulated else f'   {RELATES}'}"


def _verdict(certificate: Certificate) -> str:
    if certificate.simulated:
        return f"{SIMULATED}: {NO_CERTIFICATE}. The data are those of a virtual board; no unit was calibrated."
    return ", ".join(item.name for item in certificate.items) if len(certificate.items) > 1 else ""


def _facts(certificate: Certificate) -> tuple[tuple[str, str], ...]:
    laboratory = certificate.laboratory
    first = certificate.items[0]
    stated = [
        ("Laboratory", laboratory.name),
        ("Address", laboratory.address),
        ("Contact", ", ".join(filter(None, (laboratory.email, laboratory.phone)))),
        ("Accreditation", laboratory.accreditation),
        ("Customer", certificate.customer),
        ("Issued", certificate.issued),
    ]
    own = _identity(first) if len(certificate.items) == 1 else ()
    return (*(fact for fact in stated if fact[1]), *own)


def _identity(item: CalibratedItem) -> tuple[tuple[str, str], ...]:
    """Item, dates and conditions; what nobody stated is named."""
    stated = dict(item.metadata.lines())
    dates = item.begun if item.ended == item.begun else f"{item.begun} to {item.ended}"
    must = ("Serial no.", "Operator", "Ambient temperature", "Relative humidity")
    labels = {"Ambient temperature": "Temperature", "Relative humidity": "Humidity"}
    known = [(labels.get(label, label), stated.pop(label, NOT_STATED)) for label in must]
    free = [(label, text) for label, text in stated.items() if label not in ("Customer", "Item", "Note")]
    identity = [("Item", item.name), ("Unit", item.unit or NOT_STATED), ("Calibrated", dates)]
    return (*identity, *known, ("Recording", item.recording_id), *free)


def _conditions(item: CalibratedItem, of: str) -> Section:
    return Section(f"Item and conditions{of}", (ReportTable(("", "Stated"), _identity(item), numeric=False),))


def _statement(certificate: Certificate) -> Section:
    procedure = certificate.laboratory.procedure
    named = (f"Procedure: {procedure}.",) if procedure else ()
    scope = (certificate.scope,) if certificate.scope else ()
    return Section("Method and uncertainty", (*named, METHOD, UNCERTAINTY, *scope))


def _results(sensor: CalibratedSensor) -> tuple[SectionPart, ...]:
    if sensor.calibration is None:
        return (f"No result: {sensor.void}.",)
    rows = []
    for level in sensor.levels:
        lengths = (level.elongation_mm, level.indicated_mm, level.deviation_mm, level.expanded_mm)
        x, indicated, deviation, expanded = (rounded(length, level.expanded_mm) for length in lengths)
        kpa = round(level.pressure_kpa, 1)
        pressure, signal = f"{kpa:+z.1f}" if kpa else "0.0", f"{level.signal_mv:.{sensor.places()}f}"
        covered = f"{COVERAGE_FACTOR:g}", percent(level.coverage), str(level.n)
        rows.append((level.branch, pressure, x, signal, indicated, deviation, expanded, *covered))
    header = (
        "Branch", "p, kPa", "x, mm", "signal, mV", "x of curve, mm", "deviation, mm", "U, mm", "k", "coverage", "n",
    )  # fmt: skip
    caption = (
        "Means of n cycles. x: elongation as read; x of curve: that of the calibration function for the signal; "
        "deviation: the second less the first; U: of an elongation from one signal. End levels belong to both branches."
    )
    return (ReportTable(header, tuple(rows), caption), *_function(sensor.calibration))


def _curves(item: CalibratedItem) -> list[SectionPart]:
    """The curves of the sensors, two a row."""
    draws = [partial(_curve, k, one) for k, one in enumerate(item.sensors, 1) if one.calibration is not None]
    rows = [tuple(draws[at : at + 2]) for at in range(0, len(draws), 2)]
    return [ReportDrawing(row, "Calibration function and levels, with U as bars.", 2.4) for row in rows]


def _function(calibration: Calibration) -> tuple[SectionPart, ...]:
    low, high = calibration.x_range
    valid = f"Valid from {low:+z.2f} to {high:+z.2f} mm"
    adequacy = "" if calibration.adequacy is None else f" Curve {calibration.adequacy.verdict}."
    if calibration.spline is not None:
        return (
            f"Calibration function: a monotone cubic spline; its points are in the attached XML. {valid}.{adequacy}",
        )
    rows = tuple(
        (f"b{k}", with_uncertainty(float(b), float(u)), f"mV/mm{power(k)}" if k else "mV")
        for k, (b, u) in enumerate(zip(calibration.coefficients, calibration.std_errors_with_reading, strict=True))
    )
    caption = f"y = b0 + b1 x + ..., y the signal, x the elongation in mm. {valid}.{adequacy}"
    return (ReportTable(("", "value ± standard uncertainty", "unit"), rows, caption),)


def _curve(number: int, sensor: CalibratedSensor, ax: Axes) -> None:
    calibration, colour = sensor.calibration, style.sensor_colour(number - 1)
    assert calibration is not None
    grid = np.linspace(*calibration.x_range, _CURVE_POINTS)
    ax.plot(grid, calibration.predict(grid), color=colour, label="calibration function")
    for name, fill in (("loading", colour), ("unloading", style.PAPER_COLOUR), ("end", style.SOFT)):
        own = [level for level in sensor.levels if level.branch == name]
        x, y, u = ([getattr(one, key) for one in own] for key in ("elongation_mm", "signal_mv", "expanded_mm"))
        ax.errorbar(x, y, xerr=u, fmt="o", color=colour, mfc=fill, mew=0.7, ms=3.2, elinewidth=0.6, label=name)
    ax.set(xlabel="elongation, mm", ylabel="signal, mV", title=f"Sensor {number}")
    ax.legend()


def _standards(item: CalibratedItem) -> tuple[SectionPart, ...]:
    rows = tuple((one.label, one.statement) for one in item.type_b)
    tables = [ReportTable(("Standard or influence", "Statement"), rows, numeric=False)] if rows else []
    return (*tables, f"An elongation is {item.traceability.text}.")


def _conformity(certificate: Certificate) -> tuple[SectionPart, ...]:
    rows = []
    for item in certificate.items:
        for one in (statement for sensor in item.sensors for statement in sensor.statements):
            u = one.statement.guard_band / 2
            band = rounded(one.statement.guard_band, u) if math.isfinite(one.statement.guard_band) else NOT_STATED
            chance = percent(one.statement.probability, 1) if math.isfinite(one.statement.probability) else NOTHING
            limit = f"{one.tolerance.symbol} {one.tolerance.limit:g}"
            value = rounded(one.figure.value, u)
            label = SENSOR_FIGURES[one.tolerance.key].label_with_unit
            rows.append((item.name, one.sensor, label, value, limit, band, chance, one.conformity.label))
    header = ("Item", "sensor", "figure", "value", "limit", "guard band", "conformity", "statement")
    caption = f"Decision rule: {RULE}. Conformity: probability that the figure keeps its limit (JCGM 106:2012)."
    return (ReportTable(header, tuple(rows), caption),)


def _as_found(certificate: Certificate) -> tuple[str, ...]:
    texts = []
    for item in certificate.items:
        for sensor in item.sensors:
            found = sensor.as_found
            if found is not None:
                worst = found.worst
                agrees = {True: "agrees", False: "does not agree", None: "cannot be compared"}[found.agrees]
                most = f"{found.difference_mm[worst]:+z.3f} mm at {found.grid[worst]:+z.2f} mm"
                texts.append(
                    f"As found, {item.name}, {sensor.name}: the calibration of {item.previous[:10]} {agrees} with this "
                    f"one; the largest difference is {most} (En = {found.e_n[worst]:.2f})."
                )
    return tuple(texts) or ("As found: there is no calibration before this one to compare with.",)


def _comparison(certificate: Certificate) -> tuple[SectionPart, ...]:
    """The figures of all items and sensors side by side."""
    keys = dict.fromkeys(key for item in certificate.items for sensor in item.sensors for key in sensor.figures)
    rows = []
    for item in certificate.items:
        for sensor in item.sensors:
            values = [f"{sensor.figures[k]:.{sensor.places(k)}f}" if k in sensor.figures else "" for k in keys]
            most = max((level.expanded_mm for level in sensor.levels), default=math.nan)
            rows.append((item.name, sensor.name, *values, rounded(most, most)))
    header = ("Item", "sensor", *map(figure_label, keys), "largest U, mm")
    return (ReportTable(header, tuple(rows)),)


def _signature(certificate: Certificate) -> tuple[SectionPart, ...]:
    who = certificate.laboratory.signatory or "_" * 24
    lines = (("Authorised by", who, "_" * 14, "_" * 30),)
    whole = f"End of {'document' if certificate.simulated else 'certificate'} no. {certificate.number}."
    return (ReportTable(("", "Name", "Date", "Signature"), lines, numeric=False), whole)
