"""Figures of one cycle: the end-to-end sensitivity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.figures.repeatability import cycle_sensitivities
from tests.analysis.boat_builder import PAPER, Plant, Staircase, triangle

QUICK = Options(mcmc=False, x_resolution_mm=0.0)
SPANS = [abs(curve(3.8) - curve(-2.7)) for curve in map(np.polynomial.Polynomial, PAPER)]  # 255.6, 189.9 mV


def test_sensitivity_of_a_cycle_is_over_elongation_where_it_was_read(tmp_path: Path) -> None:
    """The paper's 39.3 and 29.2 mV/mm in every cycle."""
    stairs = Staircase(Plant(loop_mm=0.25), cycles=3)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=QUICK)
    for sensor, span in enumerate(SPANS):
        values, unit = cycle_sensitivities(analysis.loops, sensor)
        assert unit == "mV/mm"
        assert values == pytest.approx(np.full(3, span / 6.5), rel=2e-3)


def test_sensitivity_of_a_cycle_is_over_pressure_where_one_cycle_was_not_read(tmp_path: Path) -> None:
    """One unread cycle makes all of them mV/kPa, so that cycles stay comparable: span over 90 kPa."""
    stairs = Staircase(cycles=3)
    table = stairs.elongations()
    table.loc[np.arange(len(table)) >= 37, "elongation_mm"] = np.nan  # the third cycle
    rows = table.assign(
        cycle=[k for _, _, k in stairs.levels()],
        branch=["loading" if up else "unloading" for _, up, _ in stairs.levels()],
    ).dropna()
    rows.to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=QUICK)
    for sensor, span in enumerate(SPANS):
        values, unit = cycle_sensitivities(analysis.loops, sensor)
        assert unit == "mV/kPa"
        assert values == pytest.approx(np.full(3, span / 90.0), rel=2e-3)


def test_sensitivity_of_a_cycle_of_a_continuous_run() -> None:
    """Bins represent the levels: the chord between the outermost bins' centres, 88 kPa of 90 apart."""
    analysis = analyse(Plant().run(*triangle(4, 20)), options=QUICK)
    curves = map(np.polynomial.Polynomial, PAPER)
    for sensor, curve in enumerate(curves):
        values, unit = cycle_sensitivities(analysis.loops, sensor)
        inner = 6.5 / 90.0  # one kPa in mm; half a bin is 1 kPa
        assert unit == "mV/kPa"
        assert values == pytest.approx(np.full(4, (curve(3.8 - inner) - curve(-2.7 + inner)) / 88.0), rel=5e-3)


def test_no_cycle_has_no_sensitivity() -> None:
    """A pressure that never turns: nothing to give, and no exception."""
    rest = np.zeros(1000)
    values, unit = cycle_sensitivities(analyse(Plant().run(rest, rest > 0, rest), options=QUICK).loops, 0)
    assert (values.size, unit) == (0, "mV/kPa")
