"""Influence quantities: a coefficient that was put into the signal comes out, with an honest uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.data.recording import Recording
from analysis.reports.run_section import influence_quantities
from analysis.warning import WarningCode
from tests.analysis.boat_builder import Plant, Staircase, triangle

CHANNELS = {"channels": [["temperature", "degC"], ["battery", "V"]]}
MV_PER_DEGC = (-1.3, 0.0)


def with_temperature(recording: Recording, temperature: np.ndarray) -> Recording:
    """Return a run whose first sensor follows the temperature; the battery is constant."""
    signal = recording.signal_mv + np.outer(temperature - temperature.mean(), MV_PER_DEGC)
    channel = np.stack([temperature, np.full(recording.n, 11.7)], axis=1)
    return replace(recording, signal_mv=signal, channel=channel, meta={**recording.meta, **CHANNELS})


def waves(recording: Recording) -> np.ndarray:
    """A temperature that rises and falls, out of step with the cycles."""
    return 23.0 + 2.0 * np.sin(2.0 * np.pi * 1.7 * recording.time_s / recording.duration_s)


@pytest.fixture(scope="module")
def staircase() -> Recording:
    return Staircase(Plant(rate_hz=50.0), dwell_s=1.6).recording()


def test_a_coefficient_is_found_with_its_uncertainty(staircase: Recording) -> None:
    """The true one is inside the interval, which is narrow; the sensor without one, and a constant, have none."""
    run = analyse(with_temperature(staircase, waves(staircase)), options=Options(mcmc=False))
    (found, battery), (none, _) = (sensor.influences for sensor in run.sensors)
    assert abs(found.coefficient_mv - MV_PER_DEGC[0]) < found.expanded_mv < 0.3
    assert found.significant and found.correlation < -0.7 and not found.like_drift
    assert abs(none.coefficient_mv) < none.expanded_mv
    assert not none.significant
    assert "constant" in battery.void
    codes = [(warning.code, warning.subject) for warning in run.warnings if warning.code is WarningCode.INFLUENCE]
    assert codes == [(WarningCode.INFLUENCE, "s1")]
    assert run.to_json()["sensors"][0]["influences"][0]["unit"] == "degC"
    (section,) = influence_quantities(run)
    assert "battery of sensor 1: it is constant" in str(section.parts[-1])


def test_a_temperature_that_only_rises_may_be_drift(staircase: Recording) -> None:
    """It explains the signal as well as time does, and the result says so."""
    rising = 20.0 + 5.0 * staircase.time_s / staircase.duration_s
    run = analyse(with_temperature(staircase, rising), options=Options(mcmc=False))
    assert run.sensors[0].influences[0].like_drift
    (warning,) = (w for w in run.warnings if w.code is WarningCode.INFLUENCE)
    assert "this may be drift" in warning.text


def test_a_continuous_run_gives_a_value_a_cycle() -> None:
    """Cycles without holds are enough, and no channel makes no section."""
    recording = Plant(rate_hz=50.0).run(*triangle(20, 5.0, rate_hz=50.0))
    found = analyse(with_temperature(recording, waves(recording)), options=Options(mcmc=False)).sensors[0].influences[0]
    assert abs(found.coefficient_mv - MV_PER_DEGC[0]) < found.expanded_mv < 0.3
    plain = analyse(recording, options=Options(mcmc=False))
    assert (plain.sensors[0].influences, influence_quantities(plain)) == ((), [])


def test_too_few_cycles_have_no_coefficient() -> None:
    """Two cycles cannot tell their own disturbance."""
    short = Staircase(Plant(rate_hz=50.0), cycles=2, dwell_s=1.6).recording()
    run = analyse(with_temperature(short, waves(short)), options=Options(mcmc=False))
    assert run.sensors[0].influences[0].void == "2 cycles; a coefficient needs 3"
