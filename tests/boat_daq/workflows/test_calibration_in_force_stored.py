"""The calibration in force of a recording's unit, and the elongation of an export by it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from analysis import Options
from boat_daq.engine.settings import UnitLibrary
from boat_daq.workflows.calibration_in_force import calibration_in_force, exported_elongation
from tests.analysis.boat_builder import Plant, triangle
from tests.boat_daq.viewmodels.results.units import unit


def test_run_without_readings_is_converted_by_its_units_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last accepted one, named; for a run of the other kind of board, or of an unknown unit, there is none."""
    run = dataclasses.replace(Plant().run(*triangle(2, 5)), meta={"unit": "SA1", "simulated": True})
    known = unit(0.0, 2.0)
    monkeypatch.setattr(UnitLibrary, "names", lambda library: ["SA1"] if library.simulated else [])
    monkeypatch.setattr(UnitLibrary, "load", lambda library, name: known)
    found = calibration_in_force(run)
    assert found is not None
    assert (found.head["unit"], found.head["calibrated_utc"]) == ("SA1", known.history[-1].utc)
    converted, void = exported_elongation(run, Options(mcmc=False))
    assert void == ""
    assert converted is not None
    expected = found.reader().evaluate(run.signal_mv)
    np.testing.assert_array_equal(converted.elongation_mm, expected.elongation_mm)
    assert "not traceable" in converted.calibration["traceability"]
    real = dataclasses.replace(run, meta={"unit": "SA1", "simulated": False})
    assert exported_elongation(real, Options(mcmc=False)) == (None, "no elongation was read in this run")
