"""Calibrations to certify, each analysed once, and the schema."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from analysis import Analysis, Options, analyse
from analysis.calibration.type_b import contributions
from analysis.certificates.certificate import Request
from analysis.certificates.laboratory import Laboratory
from tests.analysis.boat_builder import PAPER, Plant, Staircase

if TYPE_CHECKING:
    from xmlschema import XMLSchema

MARKUP = '<b>&"\u05e9\u05dc\u05d5\u05dd\u202e\x00\ud800]]> #panic()'
STATED = {
    "simulated": False, "unit": "SA1", "uuid": "0123456789", "started_utc": "2026-01-31T23:00:00+00:00",
    "ended_utc": "2026-02-01T01:00:00+00:00", "operator": MARKUP, "item": MARKUP, "serial_number": "7",
    "note": f"{MARKUP} {'x' * 10_000}", "ambient_temperature_c": 21.5, "fields": {"rig": MARKUP},
}  # fmt: skip
REQUEST = Request(
    Laboratory("Lab & Söhne", country_code="DE", city="Köln"), customer="A <b>", issued="2026-02-02",
    limits={"hysteresis": 6.0, "snr": 90.0},
)  # fmt: skip


@pytest.fixture(scope="session")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    """A calibration of two cycles that is not simulated, with texts that no form of a certificate may break on."""
    stairs = Staircase(Plant(cubics=PAPER[:1], noise_mv=(1.49,), loop_mm=0.25), cycles=2)
    path = tmp_path_factory.mktemp("certified") / "e.csv"
    stairs.elongations().to_csv(path, index=False)
    type_b = contributions({"scale": {"u_mm": 0.01, "certificate": "DKD-K-4711"}, "parallax": {"u_mm": 0.05}})
    options = Options(mcmc=False, fidelity="draft", type_b=type_b)
    return analyse(stairs.recording(meta=STATED), path, options=options)


@pytest.fixture(scope="session")
def schema() -> XMLSchema:
    """The schema of the Digital Calibration Certificate."""
    import xmlschema  # here: it takes half a second, which every process that collects the tests would spend

    return xmlschema.XMLSchema(str(Path(__file__).parent / "schema" / "dcc_3.2.1.xsd"))


def with_meta(analysis: Analysis, **changed: Any) -> Analysis:
    """Return the analysis of a recording that states something else."""
    recording = analysis.recording
    return replace(analysis, recording=replace(recording, meta={**recording.meta, **changed}))
