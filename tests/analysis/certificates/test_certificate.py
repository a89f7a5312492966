"""What a certificate states, what it refuses, and what marks it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis import Analysis, Options, analyse
from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.record import CalibrationRecord, SensorRecord
from analysis.certificates.certificate import Request, certificate_of, missing
from protocol.base.errors import BoatDaqError, DataError, RequestError
from tests.analysis.boat_builder import PAPER, Plant, Staircase
from tests.analysis.certificates.conftest import REQUEST, STATED, with_meta


def test_levels_are_the_means_of_both_branches_with_the_budgets_uncertainty(calibration: Analysis) -> None:
    """Nine inner levels twice, the ends once; U of the budget at that elongation; deviation within it."""
    levels = certificate_of([calibration], REQUEST).items[0].sensors[0].levels
    branches = [level.branch for level in levels]
    inner = branches.count("loading")
    assert (branches.count("unloading"), branches.count("end"), len(levels)) == (inner, 2, 2 * inner + 2)
    of_run = calibration.u_elongation[0]
    for level in levels:
        assert level.expanded_mm == pytest.approx(np.interp(level.elongation_mm, *of_run.T), rel=0.01)
        assert abs(level.deviation_mm) < 2.0 * level.expanded_mm
    assert sum(level.n for level in levels) == calibration.sensors[0].calibration.n


def test_number_is_of_all_that_is_stated(calibration: Analysis) -> None:
    """The same statement has the same number; one letter more has another."""
    numbers = [
        certificate_of([calibration], request).number
        for request in (REQUEST, REQUEST, replace(REQUEST, customer="B"), replace(REQUEST, number="K-7"))
    ]
    assert numbers[0] == numbers[1] != numbers[2]
    assert numbers[3] == "K-7"


def test_missing_statements_are_named_together(calibration: Analysis) -> None:
    bare = with_meta(calibration, unit="", item="", serial_number="", customer="")
    assert missing([bare], Request()) == ("laboratory", "customer", "item")
    with pytest.raises(RequestError, match="laboratory, customer, item") as refused:
        certificate_of([bare], Request())
    assert refused.value.command == "--laboratory FILE.toml --customer TEXT --item TEXT"
    assert missing([with_meta(bare, unit="SA1")], REQUEST) == ()
    nameless = with_meta(bare, simulated=True)
    with pytest.raises(DataError, match="no identity"):
        certificate_of([nameless], Request())


def test_run_without_calibration_is_refused(calibration: Analysis) -> None:
    sensors = tuple(replace(one, calibration=None, calibration_void="no readings") for one in calibration.sensors)
    with pytest.raises(DataError, match="no calibration to certify: not calibrated: no readings"):
        certificate_of([replace(calibration, sensors=sensors)], REQUEST)


def test_refusal_of_one_cycle_says_its_remedy_once(tmp_path: Path) -> None:
    stairs = Staircase(Plant(cubics=PAPER[:1], noise_mv=(1.49,), loop_mm=0.25), cycles=1)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    once = analyse(stairs.recording(meta=STATED), tmp_path / "e.csv", options=Options(mcmc=False, fidelity="draft"))
    with pytest.raises(DataError, match=r"its U is not known: one cycle gives no uncertainty$") as refused:
        certificate_of([once], REQUEST)
    assert refused.value.remedy == "Run two cycles or more, and read both branches."


@pytest.mark.parametrize("request_", [replace(REQUEST, issued="soon"), replace(REQUEST, limits={"beauty": 1.0})])
def test_unusable_request_is_refused(calibration: Analysis, request_: Request) -> None:
    with pytest.raises(BoatDaqError):
        certificate_of([calibration], request_)


def test_simulated_and_inadequate_are_marked(calibration: Analysis) -> None:
    """A simulated run is no certificate, whatever number is asked for; an inadequate curve marks every page."""
    simulated = certificate_of([with_meta(calibration, simulated=True)], replace(REQUEST, number="K-7"))
    assert simulated.marks == ("NO CERTIFICATE",)
    assert simulated.number.startswith("SIMULATED-K-7-")
    assert "certificate" not in simulated.title.lower()
    sensor = calibration.sensors[0]
    adequacy = replace(sensor.calibration.adequacy, verdict=CurveVerdict.INADEQUATE)
    sensor = replace(sensor, calibration=replace(sensor.calibration, adequacy=adequacy))
    marked = certificate_of([replace(calibration, sensors=(sensor,))], REQUEST)
    assert marked.marks == ("CURVE NOT ADEQUATE",)
    refused = replace(
        sensor, calibration=replace(sensor.calibration, adequacy=replace(adequacy, remainder_percent=9.0))
    )
    with pytest.raises(DataError, match="misses the readings"):
        certificate_of([replace(calibration, sensors=(refused,))], REQUEST)


def test_calibration_before_is_compared_as_found(calibration: Analysis) -> None:
    fit = calibration.sensors[0].calibration.as_json()
    shifted = {**fit, "coefficients": [fit["coefficients"][0] + 5.0, *fit["coefficients"][1:]]}
    before = CalibrationRecord((SensorRecord("s1", shifted),), True, calibrated_utc="2025-01-01T00:00:00+00:00")
    item = certificate_of([calibration], replace(REQUEST, previous=(before,))).items[0]
    assert item.previous.startswith("2025-01-01")
    assert item.sensors[0].as_found.difference_mv == pytest.approx(-5.0)
    assert item.sensors[0].as_json()["as_found"]["agrees"] is False


def test_a_run_of_unknown_time_is_not_dated_by_its_certificate(calibration: Analysis) -> None:
    """An imported run without a time is refused, with what states it; a simulated one is no certificate anyway."""
    unknown = with_meta(calibration, started_utc=None, ended_utc=None)
    with pytest.raises(DataError, match="not known when") as caught:
        certificate_of([unknown], REQUEST)
    assert "--started" in caught.value.command
    assert certificate_of([with_meta(unknown, simulated=True)], REQUEST).items[0].begun
