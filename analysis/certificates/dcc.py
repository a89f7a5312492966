"""A certificate as a Digital Calibration Certificate: XML after the schema 3.2.1 of the PTB, units after D-SI 2.1.

Rules: values are rounded to two digits of U, as in the document; the JSON has all digits. Texts hold any characters:
what XML 1.0 forbids becomes the replacement character. There is no signature: whoever authorises the certificate adds
one. A simulated run is named so in number, item, results, a statement and a comment.
Sources: Hackel et al., The Digital Calibration Certificate, PTB-Mitteilungen 127 (2017) 4; dcc.ptb.de; GP_DCC.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.calibration.fit import Calibration
from analysis.certificates.certificate import (
    ADJUSTMENT,
    METHOD,
    NO_CERTIFICATE,
    NOT_ADEQUATE,
    NOT_STATED,
    SIMULATED,
    UNCERTAINTY,
    UNKNOWN_COUNTRY,
    CalibratedItem,
    CalibratedSensor,
    Certificate,
    Level,
    figure_label,
)
from analysis.certificates.laboratory import Laboratory
from analysis.conformity import RULE, Conformity
from analysis.figures.figure import SENSOR_FIGURES
from analysis.numbers import decimals_for
from analysis.version import program_version
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from protocol.base.units import COVERAGE_FACTOR, find_unit, in_signal_unit

_SCHEMA_VERSION = "3.2.1"
DCC, _SI, XSI = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance"
MIME_TYPE = "application/xml"
_CURVE_POINTS = 41  # of a spline, which has no coefficients
MM, KPA, _ONE = r"\milli\metre", r"\kilo\pascal", r"\one"
_UNITS = {"% FSO": r"\percent", "dB": r"\decibel"}
_PREFIXES = {
    "G": r"\giga", "M": r"\mega", "k": r"\kilo", "c": r"\centi", "m": r"\milli", "u": r"\micro", "n": r"\nano",
    "p": r"\pico",
}  # fmt: skip
_BASES = {
    "V": r"\volt", "A": r"\ampere", "N": r"\newton", "ohm": r"\ohm", "F": r"\farad", "m": r"\metre", "Pa": r"\pascal",
    "bar": r"\bar", "Hz": r"\hertz", "g": r"\gram", "W": r"\watt", "K": r"\kelvin", "lx": r"\lux", "J": r"\joule",
    "T": r"\tesla", "%": r"\percent", "degC": r"\degreecelsius", "deg": r"\degree",
}  # fmt: skip
_CONFORMITY = {
    Conformity.PASS: "pass",
    Conformity.FAIL: "fail",
    Conformity.CONDITIONAL_PASS: "conditionalPass",
    Conformity.CONDITIONAL_FAIL: "conditionalFail",
}
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

for _prefix, _uri in (("dcc", DCC), ("si", _SI), ("xsi", XSI)):
    ET.register_namespace(_prefix, _uri)


def dcc_xml(certificate: Certificate) -> str:
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", {"schemaVersion": _SCHEMA_VERSION})
    root.set(f"{{{XSI}}}schemaLocation", f"{DCC} {DCC}/v{_SCHEMA_VERSION}/dcc.xsd")
    _administrative(_add(root, "administrativeData"), certificate)
    results = _add(root, "measurementResults")
    for number, item in enumerate(certificate.items, 1):
        _measurement(_add(results, "measurementResult", refId=f"item{number}"), certificate, item)
    if certificate.simulated:
        mark = f"{SIMULATED}: {NO_CERTIFICATE}. The data are those of a virtual board."
        root.insert(0, ET.Comment(mark))
        _add(_add(root, "comment"), "simulated", mark)
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def si_unit(symbol: str) -> str:
    """Return a unit as D-SI writes it, counts as a number. RequestError: D-SI has no such unit."""
    if find_unit(symbol) is None:
        return _ONE
    for prefix, name in (("", symbol), (symbol[:1], symbol[1:])):
        if name in _BASES and prefix in ("", *_PREFIXES):
            return _PREFIXES.get(prefix, "") + _BASES[name]
    raise RequestError(f"a certificate has no signals in {symbol}", "Import them with a scale to an SI unit.")


def _add(parent: ET.Element, name: str, text: str | None = None, *, space: str = DCC, **attributes: str) -> ET.Element:
    child = ET.SubElement(parent, f"{{{space}}}{name}", attributes)
    if text is not None:
        child.text = _FORBIDDEN.sub("\ufffd", text)
    return child


def _name(parent: ET.Element, text: str, name: str = "name") -> ET.Element:
    """Add a name or a description: an element with a content in English."""
    child = _add(parent, name)
    _add(child, "content", text, lang="en")
    return child


def _word(parent: ET.Element, name: str, text: str) -> None:
    """Add a text that the schema wants neither empty nor with white around it."""
    _add(parent, name, " ".join(_FORBIDDEN.sub("\ufffd", text).split()) or NOT_STATED)


def _administrative(parent: ET.Element, certificate: Certificate) -> None:
    software = _add(_add(parent, "dccSoftware"), "software")
    _name(software, "boat-daq")
    _word(software, "release", program_version())
    laboratory = certificate.laboratory
    core = _add(parent, "coreData")
    _add(core, "countryCodeISO3166_1", laboratory.country_code or UNKNOWN_COUNTRY)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _word(core, "uniqueIdentifier", certificate.number)
    _add(core, "beginPerformanceDate", min(item.begun for item in certificate.items))
    _add(core, "endPerformanceDate", max(item.ended for item in certificate.items))
    _add(core, "performanceLocation", "laboratory")
    _add(core, "issueDate", certificate.issued)
    items = _add(parent, "items")
    for number, item in enumerate(certificate.items, 1):
        _item(_add(items, "item", id=f"item{number}"), item, simulated=certificate.simulated)
    _laboratory(_add(parent, "calibrationLaboratory"), laboratory)
    person = _add(_add(parent, "respPersons"), "respPerson")
    _name(_add(person, "person"), laboratory.signatory or NOT_STATED)
    _add(person, "mainSigner", "true")
    customer = _add(parent, "customer")
    _name(customer, certificate.customer)
    _name(_add(customer, "location"), NOT_STATED, "further")
    _statements(_add(parent, "statements"), certificate)


def _item(parent: ET.Element, item: CalibratedItem, *, simulated: bool) -> None:
    _name(parent, f"{SIMULATED} {item.name}" if simulated else item.name)
    if item.metadata.note:
        _name(parent, item.metadata.note, "description")
    known = (
        ("manufacturer", "Serial no.", item.metadata.serial_number),
        ("calibrationLaboratory", "Unit", item.unit),
        ("calibrationLaboratory", "Recording", item.recording_id),
        ("calibrationLaboratory", "Board", item.board),
        *(("other", name, text) for name, text in item.metadata.fields.items()),
    )
    identifications = _add(parent, "identifications")
    for issuer, name, text in known:
        if text:
            one = _add(identifications, "identification")
            _add(one, "issuer", issuer)
            _word(one, "value", text)
            _name(one, name)


def _laboratory(parent: ET.Element, laboratory: Laboratory) -> None:
    if laboratory.accreditation:
        _word(parent, "calibrationLaboratoryCode", laboratory.accreditation)
    contact = _add(parent, "contact")
    _name(contact, laboratory.name)
    for name, text in (("eMail", laboratory.email), ("phone", laboratory.phone)):
        if text:
            _word(contact, name, text)
    place = _add(contact, "location")
    parts = (
        ("city", laboratory.city),
        ("countryCode", laboratory.country_code),
        ("postCode", laboratory.post_code),
        ("street", laboratory.street),
    )
    for name, text in parts:
        if text:
            _word(place, name, text)
    if not any(text for _, text in parts):
        _name(place, NOT_STATED, "further")


def _statements(parent: ET.Element, certificate: Certificate) -> None:
    if certificate.simulated:
        _statement(parent, f"{SIMULATED}: {NO_CERTIFICATE}. No unit was calibrated.", name=SIMULATED)
    for mark in certificate.marks:
        if mark == NOT_ADEQUATE:
            _statement(parent, "A calibration function misses its readings by more than they allow.", name=mark)
    if certificate.scope:
        _statement(parent, certificate.scope, norm="ISO/IEC 17025:2017", reference="7.8.2.1")
    _statement(parent, ADJUSTMENT, norm="ISO/IEC 17025:2017", reference="7.8.4.1")
    for item in certificate.items:
        traced = item.traceability
        _statement(parent, f"{item.name}: an elongation is {traced.text}.", traceable=traced.traceable)
        if item.previous:
            _statement(parent, f"{item.name}: the calibration before is of {item.previous[:10]}.", name="As found")
    for remark in certificate.remarks:
        _statement(parent, remark, name="Remark")
    if any(sensor.statements for item in certificate.items for sensor in item.sensors):
        _statement(parent, f"Decision rule: {RULE}.", norm="ILAC-G8:09/2019", reference="4.2.3")


def _statement(
    parent: ET.Element, text: str, *, name: str = "", norm: str = "", reference: str = "", traceable: bool | None = None
) -> None:
    """Add a statement; see the schema's `statementMetaDataType` for its parts and their order."""
    one = _add(parent, "statement")
    if name:
        _name(one, name)
    if traceable is not None:
        _add(one, "traceable", str(traceable).lower())
    for key, value in (("norm", norm), ("reference", reference)):
        if value:
            _add(one, key, value)
    _name(one, text, "declaration")


def _measurement(parent: ET.Element, certificate: Certificate, item: CalibratedItem) -> None:
    mark = f"{SIMULATED} " if certificate.simulated else ""
    _name(parent, f"{mark}{item.name}: calibration of signal against elongation")
    methods = _add(parent, "usedMethods")
    method = _add(methods, "usedMethod")
    _name(method, certificate.laboratory.procedure or "Staircase calibration")
    _name(method, METHOD, "description")
    uncertainty = _add(methods, "usedMethod", refType="basic_uncertainty")
    _name(uncertainty, "Expanded uncertainty")
    _name(uncertainty, UNCERTAINTY, "description")
    _add(uncertainty, "norm", "JCGM 100:2008")
    if item.type_b:
        equipment = _add(parent, "measuringEquipments")
        for one in item.type_b:
            used = _add(equipment, "measuringEquipment", refType="basic_normalUsed")
            _name(used, one.label)
            _name(used, one.statement, "description")
            if one.certificate:
                identification = _add(_add(used, "identifications"), "identification")
                _add(identification, "issuer", "other")
                _word(identification, "value", one.certificate)
    _conditions(parent, item)
    results = _add(parent, "results")
    for sensor in item.sensors:
        _sensor(results, sensor, f"{mark}{item.name}, {sensor.name}", item.signal_unit)


def _conditions(parent: ET.Element, item: CalibratedItem) -> None:
    stated = (
        ("Ambient temperature", "basic_temperature", item.metadata.ambient_temperature_c, r"\degreecelsius"),
        ("Relative humidity", "basic_humidityRelative", item.metadata.ambient_humidity_percent, r"\percent"),
    )
    if all(value is None for _, _, value, _ in stated):
        return
    conditions = _add(parent, "influenceConditions")
    for name, ref_type, value, unit in stated:
        if value is not None:
            one = _add(conditions, "influenceCondition", refType=ref_type)
            _name(one, name)
            _real(_add(one, "data"), name, value, unit)


def _sensor(results: ET.Element, sensor: CalibratedSensor, name: str, symbol: str) -> None:
    if sensor.calibration is None:
        void = _add(results, "result")
        _name(void, f"{name}: no result")
        _name(_add(void, "data"), f"No result: {sensor.void}.", "text")
        return
    unit = si_unit(symbol)
    levels = _add(results, "result", refType="gp_measuringResult1")
    _name(levels, f"{name}: levels")
    data = _add(levels, "data")
    for number, branch in enumerate(dict.fromkeys(level.branch for level in sensor.levels), 1):
        table = _add(data, "list", refType=f"gp_table{number}")
        _name(table, branch)
        _levels(table, [level for level in sensor.levels if level.branch == branch], unit, sensor.places())
    function = _add(results, "result")
    _name(function, f"{name}: calibration function")
    _function(_add(function, "data"), sensor.calibration, unit, sensor.places())
    if sensor.figures:
        figures = _add(results, "result")
        _name(figures, f"{name}: figures")
        data = _add(figures, "data")
        for key, value in sensor.figures.items():
            if math.isfinite(value):
                label, of_figure = in_signal_unit(figure_label(key), symbol), _figure_unit(key, unit)
                _real(data, label, round(value, sensor.places(key)), of_figure)
    if sensor.statements:
        _conformity(_add(results, "result"), sensor, name, unit)


def _figure_unit(key: str, signal: str) -> str:
    """Return the unit of a figure of a signal in a unit of D-SI."""
    stated = SENSOR_FIGURES[key].unit
    return _UNITS.get(stated) or stated.replace("mV", signal).replace("/mm", rf"\per{MM}")


def _levels(table: ET.Element, levels: Sequence[Level], unit: str, decimals: int) -> None:
    """Add the levels of one branch; where the curve gives no elongation for a signal, there is none for any."""
    u = [one.expanded_mm for one in levels]
    _list(table, "Pressure", _places([one.pressure_kpa for one in levels], 2), KPA)
    elongation = _as_uncertain([one.elongation_mm for one in levels], u)
    _list(table, "Elongation", elongation, MM, ref_type="basic_referenceValue")
    _list(table, "Signal", _places([one.signal_mv for one in levels], decimals), unit)
    indicated = _as_uncertain([one.indicated_mm for one in levels], u)
    if np.isfinite(indicated).all():
        _list(table, "Indicated elongation", indicated, MM, ref_type="basic_measuredValue")
        deviation = _as_uncertain([one.deviation_mm for one in levels], u)
        expanded = _as_uncertain(u, u), _places([one.coverage for one in levels], 4)
        _list(table, "Deviation", deviation, MM, expanded, ref_type="basic_measurementError")


def _function(data: ET.Element, calibration: Calibration, unit: str, decimals: int) -> None:
    low, high = calibration.x_range
    _list(data, "Range", _places([low, high], 3), MM)
    if calibration.spline is not None:
        _name(data, "A monotone cubic spline; points of it.", "text")
        x = np.linspace(low, high, _CURVE_POINTS)
        _list(data, "Elongation", _places(x, 4), MM)
        _list(data, "Signal", _places(calibration.predict(x), decimals), unit)
        return
    terms = "+".join(f"b_{k} x^{k}" for k in range(calibration.degree + 1))
    _add(_add(data, "formula"), "latex", f"y = {terms}")
    units = [_per_mm(unit, 1, k) for k in range(calibration.degree + 1)]
    u = calibration.std_errors_with_reading
    places = [decimals_for(float(one)) for one in u]
    # two digits more than a result has (GUM 7.2.6): elongations are computed from them
    terms_rounded = [round(float(b), place + 2) for b, place in zip(calibration.coefficients, places, strict=True)]
    _list(data, "Coefficients b0, b1, ...", terms_rounded, units)
    _list(data, "Standard uncertainties of the coefficients", list(map(_two_digits, u)), units)
    for k, row in enumerate(calibration.covariance_with_reading):
        values = [float(f"{one:.5e}") for one in row]
        _list(data, f"Covariance of b{k}", values, [_per_mm(unit, 2, k + j) for j in range(row.size)])


def _places(values: Sequence[float] | FloatArray, places: int) -> list[float]:
    return [round(float(value), places) + 0.0 for value in values]  # no -0.0


def _as_uncertain(values: Sequence[float], expanded: Sequence[float]) -> list[float]:
    return [round(value, decimals_for(u)) + 0.0 for value, u in zip(values, expanded, strict=True)]


def _two_digits(u: float) -> float:
    return float(f"{u:.1e}")


def _per_mm(unit: str, power: int, of_x: int) -> str:
    signal = unit if power == 1 or unit == _ONE else rf"{unit}\tothe{{{power}}}"
    if of_x == 0:
        return signal
    return rf"{'' if unit == _ONE else signal}{MM}\tothe{{-{of_x}}}"


def _conformity(result: ET.Element, sensor: CalibratedSensor, name: str, signal: str) -> None:
    _name(result, f"{name}: conformity with the limits of the customer")
    data = _add(result, "data")
    for one in sensor.statements:
        if not math.isfinite(one.figure.value):
            _name(data, f"{one.name}: undetermined", "text")
            continue
        label, unit = figure_label(one.tolerance.key), _figure_unit(one.tolerance.key, signal)
        quantity = _real(data, label, round(one.figure.value, decimals_for(one.figure.uncertainty)), unit)
        meta = _add(_add(quantity, "measurementMetaData"), "metaData", refType="basic_conformity")
        _name(meta, f"{RULE}; limit {one.tolerance.symbol} {one.tolerance.limit:g} {one.figure.unit}", "declaration")
        _add(meta, "conformity", _CONFORMITY[one.conformity])
        side = "Lower" if one.tolerance.is_lower else "Upper"
        limit = _real(_add(meta, "data"), f"{side} limit", one.tolerance.limit, unit)
        limit.set("refType", f"basic_acceptanceLimit{side}")


def _real(parent: ET.Element, name: str, value: float, unit: str) -> ET.Element:
    quantity = _add(parent, "quantity")
    _name(quantity, name)
    real = _add(quantity, "real", space=_SI)
    _add(real, "value", _text(value), space=_SI)
    _add(real, "unit", unit, space=_SI)
    return quantity


def _list(
    parent: ET.Element,
    name: str,
    values: Sequence[float] | FloatArray,
    units: str | Sequence[str],
    expanded: tuple[Sequence[float], Sequence[float]] | None = None,
    *,
    ref_type: str = "",
) -> None:
    """Add a quantity of several values.

    `values`: [n]. `units`: one for all, or [n]. `expanded`: U, its coverage probability, [n]; k = 2. `ref_type`:
    what the quantity is in a calibration.
    """
    quantity = _add(parent, "quantity", **({"refType": ref_type} if ref_type else {}))
    _name(quantity, name)
    numbers = _add(quantity, "realListXMLList", space=_SI)
    _add(numbers, "valueXMLList", _texts(values), space=_SI)
    _add(numbers, "unitXMLList", units if isinstance(units, str) else " ".join(units), space=_SI)
    if expanded is not None:
        stated = _add(numbers, "expandedUncXMLList", space=_SI)
        _add(stated, "uncertaintyXMLList", _texts(expanded[0]), space=_SI)
        _add(stated, "coverageFactorXMLList", _texts([COVERAGE_FACTOR]), space=_SI)
        _add(stated, "coverageProbabilityXMLList", _texts(expanded[1]), space=_SI)


def _texts(values: Sequence[float] | FloatArray) -> str:
    return " ".join(_text(value) for value in values)


def _text(value: Any) -> str:
    """Return a number with the digits that make it the same again."""
    return repr(float(value))
