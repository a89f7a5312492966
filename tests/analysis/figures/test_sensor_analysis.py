"""The hysteresis of a sensor: none of a curved one without a loop, bounded by the grid of the readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from analysis.figures.figure import Reason
from analysis.warning import WarningCode
from tests.analysis.boat_builder import PAPER, Plant, Staircase
from tests.conftest import mostly_at_night

LOOP = 0.25
QUICK = Options(mcmc=False, x_resolution_mm=0.0)


def true_hysteresis(cubic: tuple[float, ...]) -> tuple[float, float]:
    """Largest distance of the system's branches at the staircase's levels, % FSO, and the FSO."""
    plant = Plant(loop_mm=LOOP)
    curve = np.polynomial.Polynomial(cubic)
    fso = abs(curve(3.8) - curve(-2.7))
    p = np.arange(-40.0, 51.0, 10.0)
    apart = np.abs(curve(plant.elongation(p, np.asarray(True))) - curve(plant.elongation(p, np.asarray(False))))
    return 100 * apart.max() / fso, fso


@pytest.mark.parametrize("every", [1, 3])
def test_a_curved_sensor_without_a_loop_has_no_hysteresis(tmp_path: Path, every: int) -> None:
    """The actuator's loop sets the branches' points apart, so chords between them are off a cubic by up to 1 % FSO."""
    levels = np.arange(50, -41, -10)[::every]
    path = [*levels, *levels[::-1][1:]]
    loading = np.repeat(np.arange(len(path)) >= levels.size, 300)
    plant = Plant(noise_mv=(1e-6, 1e-6), loop_mm=LOOP, pressure_noise_kpa=0.0)
    pressure = np.repeat(np.asarray(path, float), 300)
    table = tmp_path / "elongation.csv"
    x = plant.elongation(np.asarray(path, float), np.arange(len(path)) >= levels.size)
    table.write_text("pressure_kpa,elongation_mm\n" + "\n".join(f"{p},{e:.9f}" for p, e in zip(path, x, strict=True)))
    analysis = analyse(plant.run(pressure, loading, np.ones(pressure.size)), table, options=QUICK)
    for sensor in analysis.sensors:
        assert sensor.figures["sensor_hysteresis_percent_fso"].value < 1e-3
        assert max(sensor.sensor_hysteresis_per_cycle) < 1e-3
        assert sensor.figures["system_hysteresis_percent_fso"].value > 3.0


def test_readings_on_a_millimetre_grid_widen_whatever_they_enter(tmp_path: Path) -> None:
    """Read on a grid the actuator's loop of 0.25 mm appears as 1 mm in each cycle, not in the joint fit.

    The intervals hold the truth.
    """
    stairs = Staircase(Plant(loop_mm=LOOP, noise_mv=(0.2, 0.2)), cycles=3)
    table = stairs.elongations()
    table["elongation_mm"] = table["elongation_mm"].round()
    table.to_csv(tmp_path / "grid.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "grid.csv", options=Options(mcmc=False, x_resolution_mm=1.0))
    actuator = analysis.actuator_hysteresis
    assert max(analysis.actuator_hysteresis_per_cycle) > 10
    assert actuator.value < 10
    assert actuator.low <= 100 * LOOP / 6.5 <= actuator.high
    for sensor, cubic in zip(analysis.sensors, PAPER, strict=True):
        hysteresis, fso = true_hysteresis(cubic)
        for name, truth in (("snr_db", 20 * np.log10(fso / 0.2)), ("system_hysteresis_percent_fso", hysteresis)):
            figure = sensor.figures[name]
            assert figure.low <= truth <= figure.high
        assert sensor.figures["noise_mv"].high < 0.21
        assert sensor.figures["sensor_hysteresis_percent_fso"].low == 0.0


@pytest.mark.parametrize(
    ("loop_mm", "own_mv", "grid_mm"), mostly_at_night((0.3, 14.0, 1.0), (0.45, 0.0, 0.5), (0.45, 4.0, 0.5))
)
def test_a_grid_both_makes_and_hides_a_sensors_loop(
    tmp_path: Path, loop_mm: float, own_mv: float, grid_mm: float
) -> None:
    """Sensors whose own loop is known, read on a grid: the interval reaches up as well as down to the truth."""
    stairs = Staircase(Plant(loop_mm=loop_mm), cycles=5, dwell_s=1.2, ramp_kpa_per_s=40.0)
    pressure, loading, _, _ = stairs.trace()
    share = np.clip((pressure + 40.0) / 90.0, 0.0, 1.0)
    run = stairs.recording()
    own = np.where(loading, -1.0, 1.0) * 2.0 * share * (1.0 - share) * own_mv
    table = stairs.elongations()
    table["elongation_mm"] = (table["elongation_mm"] / grid_mm).round() * grid_mm
    table.to_csv(tmp_path / "grid.csv", index=False)
    recording = Recording.from_arrays(run.time_s, run.pressure_kpa, run.signal_mv + own[:, None])
    options = Options(mcmc=False, x_resolution_mm=grid_mm)
    for sensor, cubic in zip(analyse(recording, tmp_path / "grid.csv", options=options).sensors, PAPER, strict=True):
        figure = sensor.figures["sensor_hysteresis_percent_fso"]
        assert figure.low <= 100.0 * own_mv / true_hysteresis(cubic)[1] <= figure.high


QUINTIC = (1640.0, 18.0, 0.0, 0.0, 0.0, 0.12)


def test_a_cubic_of_a_quintic_sensor_is_called_inadequate(tmp_path: Path) -> None:
    """Without a loop: the misfit is no hysteresis, it is warned of, and it is in U; auto fits the quintic.

    U holds the error of the cubic at 90 % of its points or more.
    """
    stairs = Staircase(Plant(cubics=(QUINTIC,), noise_mv=(1.5,), loop_mm=LOOP), cycles=4)
    table = stairs.elongations()
    table["elongation_mm"] = (table["elongation_mm"] / 0.02).round() * 0.02
    table.to_csv(tmp_path / "grid.csv", index=False)
    cubic, best = (
        analyse(stairs.recording(), tmp_path / "grid.csv", options=Options(degree, 0.02, mcmc=False))
        for degree in (3, "auto")
    )
    sensor = cubic.sensors[0]
    assert sensor.calibration is not None
    found = cubic.to_json()["sensors"][0]
    assert found["adequacy"]["verdict"] == "inadequate"
    assert found["adequacy"]["degree_preferred"] == 5
    assert {w.code for w in cubic.warnings} >= {WarningCode.INADEQUATE_CURVE}
    assert sensor.figures["sensor_hysteresis_percent_fso"].low == 0.0
    assert sensor.figures["sensor_hysteresis_percent_fso"].value < 0.2
    assert sensor.figures["lack_of_fit_percent_fso"].reason is Reason.INADEQUATE
    u = np.asarray(found["u_elongation_mm"])
    error = np.abs(sensor.calibration.predict(u[:, 0]) - np.polynomial.Polynomial(QUINTIC)(u[:, 0]))
    assert np.mean(error <= u[:, 1] * np.abs(sensor.calibration.slope(u[:, 0]))) >= 0.9
    assert best.sensors[0].calibration is not None
    assert best.sensors[0].calibration.degree == 5
    assert best.to_json()["sensors"][0]["adequacy"]["verdict"] == "adequate"


def test_loop_of_the_actuator_is_found_between_the_plateaus(tmp_path: Path) -> None:
    """With exact readings the widest place, 0.25 mm at +5 kPa, lies between two levels: the interval holds it."""
    stairs = Staircase(Plant(loop_mm=LOOP), cycles=3)
    stairs.elongations().to_csv(tmp_path / "exact.csv", index=False)
    found = analyse(stairs.recording(), tmp_path / "exact.csv", options=QUICK)
    assert max(found.actuator_hysteresis_per_cycle) < 100 * LOOP / 6.5 - 0.03
    assert found.actuator_hysteresis.value == pytest.approx(100 * LOOP / 6.5, abs=2e-3)
    assert found.actuator_hysteresis.low <= 100 * LOOP / 6.5 <= found.actuator_hysteresis.high


def test_range_is_that_of_the_means_at_the_end_levels(tmp_path: Path) -> None:
    """Readings that scatter by 0.3 mm about the ends widen no range: it is the mean of each end's readings."""
    stairs = Staircase(Plant(), cycles=4)
    table = stairs.elongations()
    table["elongation_mm"] += 0.3 * np.random.default_rng(0).standard_normal(len(table))
    table.to_csv(tmp_path / "read.csv", index=False)
    sensor = analyse(stairs.recording(), tmp_path / "read.csv", options=QUICK).sensors[0]
    assert sensor.calibration is not None
    means = table.groupby("pressure_kpa")["elongation_mm"].mean()
    assert sensor.calibration.x_range == pytest.approx((means[-40.0], means[50.0]))
