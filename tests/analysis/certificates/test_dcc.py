"""The XML of a certificate: valid, and with the numbers of the JSON when another reader reads it."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import numpy as np

from analysis import Analysis
from analysis.certificates.certificate import Certificate, Request, certificate_of
from analysis.certificates.dcc import dcc_xml
from analysis.certificates.laboratory import Laboratory
from tests.analysis.certificates.conftest import REQUEST, with_meta

OF_LEVELS = {
    "Pressure": "pressure_kpa",
    "Elongation": "elongation_mm",
    "Signal": "signal_mv",
    "Indicated elongation": "indicated_mm",
    "Deviation": "deviation_mm",
    "U of Deviation": "expanded_uncertainty_mm",
}
DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"


def quantities(xml: str) -> dict[str, dict[str, list[float]]]:
    """Return the numbers of a certificate by the names of their result and quantity."""
    found: dict[str, dict[str, list[float]]] = {}
    for result in ET.fromstring(xml).iter(f"{DCC}result"):
        whole = name_of(result)
        parents = {child: parent for parent in result.iter() for child in parent}
        for quantity in result.iter(f"{DCC}quantity"):
            label, parent = name_of(quantity), parents[quantity]
            name = f"{whole}: {name_of(parent)}" if parent.tag == f"{DCC}list" else whole
            for element in quantity:
                values = element.find(f"{SI}valueXMLList") if "realList" in element.tag else element.find(f"{SI}value")
                if values is not None:
                    found.setdefault(name, {})[label] = [float(word) for word in values.text.split()]
                expanded = element.find(f".//{SI}uncertaintyXMLList")
                if expanded is not None:
                    found[name][f"U of {label}"] = [float(word) for word in expanded.text.split()]
    return found


def name_of(element: ET.Element) -> str:
    return "".join(element.find(f"{DCC}name").itertext()).strip()


def check_numbers(certificate: Certificate, xml: str) -> int:
    """Compare every number of the XML with the JSON, to 5 % of its uncertainty; return how many there are."""
    read, count = quantities(xml), 0
    for item, stated in zip(certificate.items, certificate.as_json()["items"], strict=True):
        for sensor in stated["sensors"]:
            own = f"{item.name}, {sensor['name']}: "
            found = {name.removeprefix(own): table for name, table in read.items() if name.startswith(own)}
            fit = sensor["calibration"]
            for branch in ("end", "unloading", "loading"):
                levels = [level for level in sensor["levels"] if level["branch"] == branch]
                expected = {label: [level[key] for level in levels] for label, key in OF_LEVELS.items()}
                off = {"Pressure": [0.005], "Signal": [0.005]}
                u_mm = expected["U of Deviation"]
                table = found.get(f"levels: {branch}", {})
                assert set(table) == (set(expected) if levels else set())
                for label, values in table.items():
                    most = off.get(label) or [0.0501 * u for u in u_mm]
                    assert (np.abs(np.subtract(values, expected[label])) <= most).all(), label
                    assert all(len(f"{value}") <= 9 for value in values), label
                count += sum(map(len, expected.values()))
            function = found["calibration function"]
            np.testing.assert_allclose(function.pop("Range"), fit["range"], atol=5e-4)
            u = np.asarray(fit["std_errors_with_reading"])
            rounded = np.subtract(function.pop("Coefficients b0, b1, ..."), fit["coefficients"])
            assert (np.abs(rounded) <= 6e-4 * u).all()
            np.testing.assert_allclose(function.pop("Standard uncertainties of the coefficients"), u, rtol=0.05)
            np.testing.assert_allclose(list(function.values()), fit["covariance_with_reading"], rtol=1e-5)
            figures = [value for value in sensor["figures"].values() if math.isfinite(value)]
            np.testing.assert_allclose([values[0] for values in found["figures"].values()], figures, atol=0.0501)
            count += sum(map(len, function.values()))
    return count


def test_every_number_of_the_dcc_is_that_of_the_json(calibration: Analysis) -> None:
    """And dates, number, conformity and the note are those that are stated; there is no signature."""
    certificate = certificate_of([with_meta(calibration, item="SA1 <b>")], REQUEST)
    xml = dcc_xml(certificate)
    assert check_numbers(certificate, xml) > 100
    root = ET.fromstring(xml)
    core = root.find(f".//{DCC}coreData")
    dates = [core.find(f"{DCC}{name}").text for name in ("beginPerformanceDate", "endPerformanceDate", "issueDate")]
    assert dates == ["2026-01-31", "2026-02-01", "2026-02-02"]
    assert core.find(f"{DCC}uniqueIdentifier").text == certificate.number
    assert "x" * 10_000 in xml
    assert [element.text for element in root.iter(f"{DCC}conformity")] == ["pass", "fail"]
    assert "SIMULATED" not in xml
    assert root.find("{http://www.w3.org/2000/09/xmldsig#}Signature") is None


def test_names_units_and_statements_are_those_stated(calibration: Analysis) -> None:
    """The contact, the signatory, standards by clause, units by power of x, the side of each limit, the coverage."""
    laboratory = replace(REQUEST.laboratory, email="cal@lab.example", phone="+49 1", signatory="Ada")
    certificate = certificate_of([with_meta(calibration, note="")], replace(REQUEST, laboratory=laboratory))
    xml = dcc_xml(certificate)
    assert xml.splitlines()[1].startswith("<dcc:digitalCalibrationCertificate ")
    root = ET.fromstring(xml)
    contact = root.find(f".//{DCC}calibrationLaboratory/{DCC}contact")
    assert [contact.find(f"{DCC}{name}").text for name in ("eMail", "phone")] == ["cal@lab.example", "+49 1"]
    assert name_of(root.find(f".//{DCC}respPerson/{DCC}person")) == "Ada"
    statements = root.findall(f".//{DCC}statement")
    clauses = [(one.findtext(f"{DCC}norm"), one.findtext(f"{DCC}reference")) for one in statements]
    iso, rule = "ISO/IEC 17025:2017", ("ILAC-G8:09/2019", "4.2.3")
    assert clauses == [(iso, "7.8.2.1"), (iso, "7.8.4.1"), (None, None), rule]
    units = {name_of(one): one.findtext(f".//{SI}unitXMLList") for one in root.iter(f"{DCC}quantity")}
    mv, per = r"\milli\volt", r"\milli\metre\tothe{-%d}"
    assert root.findtext(f".//{DCC}latex") == "y = b_0 x^0+b_1 x^1+b_2 x^2+b_3 x^3"
    assert units["Coefficients b0, b1, ..."].split() == [mv, *(mv + per % k for k in (1, 2, 3))]
    assert units["Covariance of b2"].split() == [rf"{mv}\tothe{{2}}{per % k}" for k in (2, 3, 4, 5)]
    sides = [one.get("refType") for one in root.iter(f"{DCC}quantity") if "cceptanceLimit" in one.get("refType", "")]
    assert sides == ["basic_acceptanceLimitUpper", "basic_acceptanceLimitLower"]  # of hysteresis, of the SNR
    probability = [float(word) for one in root.iter(f"{SI}coverageProbabilityXMLList") for word in one.text.split()]
    by_branch: dict[str, list[float]] = {}
    for level in certificate.items[0].sensors[0].levels:
        by_branch.setdefault(level.branch, []).append(round(level.coverage, 4))
    assert probability == [value for values in by_branch.values() for value in values]


def test_without_limits_there_is_no_decision_rule(calibration: Analysis) -> None:
    xml = dcc_xml(certificate_of([with_meta(calibration, note="")], replace(REQUEST, limits={})))
    assert "Decision rule" not in xml and "ILAC" not in xml


def test_dates_and_conditions_are_those_of_all_items(calibration: Analysis) -> None:
    """From the earliest begin to the latest end; temperature and humidity of each item with their units."""
    two = [
        with_meta(
            calibration, unit=unit, item="", uuid=unit, note="", started_utc=f"2026-01-{day}T10:00:00+00:00",
            ended_utc=f"2026-01-{day + 1}T10:00:00+00:00", ambient_humidity_percent=humidity,
        )
        for unit, day, humidity in (("SA1", 20, 43.5), ("SA2", 10, 51.0))
    ]  # fmt: skip
    root = ET.fromstring(dcc_xml(certificate_of(two, REQUEST)))
    assert root.find(f".//{DCC}beginPerformanceDate").text == "2026-01-10"
    assert root.find(f".//{DCC}endPerformanceDate").text == "2026-01-21"
    stated = [
        (one.get("refType"), float(one.find(f".//{SI}value").text), one.find(f".//{SI}unit").text)
        for one in root.iter(f"{DCC}influenceCondition")
    ]
    temperature = ("basic_temperature", 21.5, r"\degreecelsius")
    assert stated == [
        temperature, ("basic_humidityRelative", 43.5, r"\percent"),
        temperature, ("basic_humidityRelative", 51.0, r"\percent"),
    ]  # fmt: skip


def test_dcc_of_a_comparison_of_three_units(calibration: Analysis) -> None:
    """Three items, each with its results that refer to it."""
    units = ("SA1", "SA2", "SA3")
    runs = [with_meta(calibration, unit=unit, item="", uuid=unit, note="") for unit in units]
    certificate = certificate_of(runs, REQUEST)
    xml = dcc_xml(certificate)
    assert check_numbers(certificate, xml) > 300
    root = ET.fromstring(xml)
    ids = [element.get("id") for element in root.iter(f"{DCC}item")]
    assert [element.get("refId") for element in root.iter(f"{DCC}measurementResult")] == ids == [
        "item1", "item2", "item3"
    ]  # fmt: skip


def test_simulated_run_is_named_so_in_number_item_results_and_statement(calibration: Analysis) -> None:
    xml = dcc_xml(certificate_of([with_meta(calibration, simulated=True, note="")], REQUEST))
    root = ET.fromstring(xml)
    assert xml.index("<!--SIMULATED") < xml.index("<dcc:administrativeData")
    assert root.find(f".//{DCC}uniqueIdentifier").text.startswith("SIMULATED-")
    for path in (f".//{DCC}item/{DCC}name", f".//{DCC}statement/{DCC}name", f".//{DCC}result/{DCC}name"):
        assert all("SIMULATED" in "".join(found.itertext()) for found in root.findall(path))
        assert root.findall(path)


def test_dcc_validates(calibration: Analysis, schema: Any) -> None:
    """Schema 3.2.1: markup, right-to-left letters, forbidden characters, a long note; three units; a simulated one."""
    three = [with_meta(calibration, uuid=str(k), item="", note="") for k in range(3)]
    empty = Request(Laboratory(" "), customer=" ", issued="2026-02-02", items=(" ",))
    for analyses, request in (
        ([calibration], REQUEST),
        (three, REQUEST),
        ([with_meta(calibration, simulated=True)], Request()),
        ([with_meta(calibration, ended_utc=None, uuid=" ", fields={" ": " "})], empty),
    ):
        xml = dcc_xml(certificate_of(analyses, request))
        assert [error.reason for error in schema.iter_errors(xml)] == []
