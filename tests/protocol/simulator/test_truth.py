"""The virtual units' own figures, against those of the paper."""

from __future__ import annotations

import numpy as np
import pytest

from protocol.base.errors import RequestError
from protocol.simulator.specimens import SPECIMEN_NAMES, find_specimen
from protocol.simulator.truth import Hold, loop_width, noise_free_run, ramp_ends, truth_figures, truth_of_holds

STAIRCASE = (*(50.0 - 10.0 * n for n in range(10)), *(-30.0 + 10.0 * n for n in range(9)))

# "What the paper's numbers imply": sensitivity, FSO, SNR, noise, hysteresis over 100 cycles; sensor 1 and 2.
PAPER = {
    "sensitivity_mv_per_mm": (39.3, 29.2),
    "fso_mv": (255.6, 189.9),
    "snr_db": (44.7, 45.2),
    "noise_mv": (1.49, 1.04),
    "system_hysteresis_percent_fso": (4.95, 4.46),
}
LAST_DIGIT = {
    "sensitivity_mv_per_mm": 0.05,
    "fso_mv": 0.05,
    "snr_db": 0.05,
    "noise_mv": 0.005,
    "system_hysteresis_percent_fso": 0.005,
}


@pytest.mark.parametrize("figure", PAPER)
@pytest.mark.parametrize("sensor", [1, 2])
def test_sa1_has_the_papers_figures(figure, sensor):
    """Every figure the paper prints comes out of the noise-free model, to the last digit printed."""
    truth = truth_figures("SA1").sensors[sensor - 1]
    assert getattr(truth, figure) == pytest.approx(PAPER[figure][sensor - 1], abs=LAST_DIGIT[figure])


def test_sa1_moves_as_the_paper_implies():
    """-40 kPa is -2.70 mm, +50 kPa is +3.80 mm; the system's sensitivity is 34.2 mV/mm."""
    truth = truth_figures("SA1")
    assert truth.range_mm == pytest.approx((-2.70, 3.80), abs=1e-3)
    assert truth.system_sensitivity_mv_per_mm == pytest.approx(34.2, abs=0.1)


@pytest.mark.parametrize("unit", SPECIMEN_NAMES)
def test_most_of_each_loop_is_actuator_hysteresis(unit):
    """The sensors' own loops are a small part of the system's."""
    truth = truth_figures(unit)
    for sensor in truth.sensors:
        assert 0.0 < sensor.sensor_hysteresis_percent_fso < 0.25 * sensor.system_hysteresis_percent_fso
        assert sensor.system_hysteresis_percent_fso < 5.1
    assert 3.0 < truth.actuator_hysteresis_percent < 4.0


@pytest.mark.parametrize("unit", ["SA1", "SA2", "SA3"])
def test_falling_unit_is_the_mirror(unit):
    """The same figures from a signal that falls with elongation."""
    rising, falling = truth_figures(unit), truth_figures(unit + "-falling")
    for up, down in zip(rising.sensors, falling.sensors, strict=True):
        assert down.coefficients == (up.coefficients[0], *(-b for b in up.coefficients[1:]))
        assert down.system_hysteresis_percent_fso == pytest.approx(up.system_hysteresis_percent_fso, rel=1e-9)
        assert down.sensitivity_mv_per_mm == up.sensitivity_mv_per_mm


@pytest.mark.parametrize("unit", SPECIMEN_NAMES)
def test_cubics_are_monotone_over_the_range(unit):
    """dy/dx keeps its sign over the range and slightly beyond, so that the cubic can be inverted."""
    model = find_specimen(unit)
    x = np.linspace(model.range_mm[0] - 0.3, model.range_mm[1] + 0.3, 500)
    for sensor in model.sensors:
        _, b1, b2, b3 = sensor.coefficients
        slope = b1 + 2 * b2 * x + 3 * b3 * x * x
        assert (slope > 0).all() or (slope < 0).all()


def test_a_fit_through_plateaus_finds_the_cubic():
    """A cubic through the noise-free plateaus of one staircase cycle has R2 above 0.999 and b0 within 0.1 mV."""
    dwell_s, ramp = 4.0, 10.0
    run = noise_free_run("SA1", (*STAIRCASE, *STAIRCASE[1:]), ramp_kpa_per_s=ramp, dwell_s=dwell_s)
    first, each = round((50 / ramp + dwell_s) * 100), round((10 / ramp + dwell_s) * 100)
    ends = first + each * np.arange(18, 37) - 1
    assert run.pressure_kpa[ends] == pytest.approx(STAIRCASE, abs=0.01)
    for number, sensor in enumerate(find_specimen("SA1").sensors):
        x, y = run.elongation_mm[ends], run.signal_mv[ends, number]
        fit = np.polynomial.Polynomial.fit(x, y, 3)
        assert 1.0 - np.var(y - fit(x)) / np.var(y) > 0.999
        assert fit.convert().coef[0] == pytest.approx(sensor.coefficients[0], abs=0.1)


def test_loop_width_of_an_ellipse():
    """A loop p = cos, y = p + h sin has the width 2 h."""
    angle = np.linspace(0, 2 * np.pi, 4001)
    assert loop_width(np.cos(angle), np.cos(angle) + 0.05 * np.sin(angle)) == pytest.approx(0.1, rel=1e-4)


def test_unknown_unit_is_refused_with_the_names():
    """The remedy names every unit."""
    with pytest.raises(RequestError, match="SA9") as refusal:
        truth_figures("SA9")
    assert all(name in refusal.value.remedy for name in SPECIMEN_NAMES)


def holds_of(hold_s: float, cycles: int = 3) -> list[Hold]:
    """Return the holds of a staircase, each read from 1 s after its ramp; the first cycle is not analysed."""
    places = [None, *[place if n else None for n in range(cycles) for place in range(1, len(STAIRCASE))]]
    ends = [place % (len(STAIRCASE) - 1) if place is not None else None for place in places]
    targets = [STAIRCASE[0], *STAIRCASE[1:] * cycles]
    return [Hold(kpa, hold_s, min(1.0, hold_s / 2), hold_s, place) for kpa, place in zip(targets, ends, strict=True)]


def test_truth_of_a_run_is_that_of_its_own_holds():
    """Held as planned it is that of the plan; held twice as long the actuator creeps further, so the span is larger."""
    planned, held = (
        truth_figures("SA1", cycle_kpa=STAIRCASE, dwell_s=3.0),
        truth_of_holds("SA1", holds_of(3.0), ramp_kpa_per_s=10.0),
    )
    longer = truth_of_holds("SA1", holds_of(6.5), ramp_kpa_per_s=10.0)
    for a, b, c in zip(planned.sensors, held.sensors, longer.sensors, strict=True):
        assert b.fso_mv == pytest.approx(a.fso_mv, rel=2e-3)
        assert b.system_hysteresis_percent_fso == pytest.approx(a.system_hysteresis_percent_fso, rel=0.02)
        assert c.fso_mv > b.fso_mv
    assert held.actuator_hysteresis_percent == pytest.approx(planned.actuator_hysteresis_percent, rel=0.02)


def test_ripple_of_the_pressure_is_in_the_noise_of_a_hold():
    """White noise on the rate of the regulated pressure: its variance is q / (4 zeta omega^3) (Langevin equation)."""
    run = noise_free_run("SA1", [0.0], ramp_kpa_per_s=10.0, dwell_s=600.0, ripple=True)
    expected = 0.15 / (0.01 * 4 * 0.6 * 9.0**3) ** 0.5
    assert run.pressure_kpa[500:].std() == pytest.approx(expected, rel=0.15)
    own = [sensor.noise_mv for sensor in find_specimen("SA1").sensors]
    found = [sensor.noise_mv for sensor in truth_of_holds("SA1", holds_of(3.0), ramp_kpa_per_s=10.0).sensors]
    assert all(1.0005 < noise / alone < 1.02 for noise, alone in zip(found, own, strict=True))


@pytest.mark.parametrize("ramp_kpa", [(0.0, 50.0), (20.0, 10.0), (-30.0, -20.0)])
def test_ramps_are_placed_by_their_pressure(ramp_kpa: tuple[float, float]):
    """A setpoint that began 3 s after the first row is found within a tick and a half, whatever lag and overshoot."""
    start, end = ramp_kpa
    run = noise_free_run("SA1", ramp_kpa, ramp_kpa_per_s=10.0, dwell_s=3.0)
    held = run.time_s >= abs(start) / 10.0
    began, ended = ramp_ends(run.time_s[held], run.pressure_kpa[held], ramp_kpa, 10.0)
    assert ended == pytest.approx(run.arrivals_s[1], abs=0.015)
    assert ended - began == pytest.approx(abs(end - start) / 10.0)


def test_a_staircases_truth_is_that_of_its_holds():
    """The loop through the holds is narrower than the one through every tick of the ramps, and inside it."""
    held = truth_figures("SA1", cycle_kpa=STAIRCASE, dwell_s=4.0)
    run = noise_free_run("SA1", (*STAIRCASE, *STAIRCASE[1:], *STAIRCASE[1:]), ramp_kpa_per_s=10.0, dwell_s=4.0)
    cycle = run.time_s > run.arrivals_s[-len(STAIRCASE)]
    for number, sensor in enumerate(held.sensors):
        every_tick = 100 * loop_width(run.pressure_kpa[cycle], run.signal_mv[cycle, number]) / sensor.fso_mv
        assert 0.96 * every_tick < sensor.system_hysteresis_percent_fso < every_tick
    pressure, elongation, signal = run.holds(1.0, 4.0)
    assert pressure == pytest.approx(run.pressure_kpa[np.searchsorted(run.time_s, run.arrivals_s + 3.9)], abs=0.02)
    assert elongation.shape == (len(run.arrivals_s),)
    assert signal.shape == (len(run.arrivals_s), 2)


@pytest.mark.parametrize("sensors", [1, 2, 3, 4])
def test_unit_has_as_many_sensors_as_its_ending(sensors):
    """SA2x3 is SA2 with a third sensor; its name in HELLO is not cut. Five, or falling ones, are refused."""
    unit = find_specimen(f"SA2x{sensors}")
    own = find_specimen("SA2").sensors
    assert (len(unit.sensors), unit.sensors[:2]) == (sensors, own[:sensors])
    assert len(set(unit.sensors)) == sensors
    assert len(unit.board_id) <= 16
    for wrong in ("SA2x5", "SA2x", f"SA2x{sensors}-falling"):
        with pytest.raises(RequestError, match=wrong):
            find_specimen(wrong)
