"""The loop of a sensor over elongation: found from readings where it is there, and taken out."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.elongation_control.measurement import SensorWatch
from analysis.elongation_control.sensor_loop import find_loops
from protocol.simulator.specimens import find_specimen
from tests.analysis.twin_unit import STEP_MV, identified, swings


def readings(every: int = 100) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return elongations of SA1 in order, and the residuals of each sensor."""
    _, x, signals = swings("SA1")
    x, signals = x[::every], signals[::every]
    fusion = identified("SA1")[1]
    return x, [signals[:, i] - inverse.calibration.predict(x) for i, inverse in enumerate(fusion.inverses)]


def test_loops_of_the_specimen_are_found_from_readings_to_two_hundredths():
    x, residuals = readings()
    generator = np.random.default_rng(0)
    noisy = [r + generator.normal(0, slope * 0.008, r.size) for r, slope in zip(residuals, (46, 33), strict=True)]
    found = find_loops(x, noisy)
    truth = [sensor.loop_mv for sensor in find_specimen("SA1").sensors]
    assert np.abs(found.half_mv) == pytest.approx(np.abs(truth), rel=0.25)
    assert len({bool(half > 0) for half in found.half_mv}) == 1


def test_readings_that_show_no_loop_give_none():
    x, residuals = readings()
    generator = np.random.default_rng(1)
    assert find_loops(x, [generator.normal(0, 2.0, r.size) for r in residuals]) is None
    assert find_loops(x[:5], [r[:5] for r in residuals]) is None


def test_without_its_loop_a_signal_gives_one_elongation_on_both_branches():
    _, x, signals = swings("SA1")
    x, signals = x[::10], signals[::10]
    fusion, away = identified("SA1")[1], {}
    for name, loops in (("with", find_loops(*readings())), ("without", None)):
        watch = SensorWatch(fusion, STEP_MV, loops)
        found = np.array([watch.measure(row[None, :], 0.1).mm for row in signals])
        away[name] = float(np.nanstd((found - x)[300:]))
    assert away["with"] < 0.45 * away["without"]
