"""Plateaus of staircases: all holds under noise, none in continuous runs, void where damaged."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import Recording, find_cycles, find_plateaus, plateau_table
from tests.analysis.boat_builder import Plant, Staircase, triangle
from tests.conftest import mostly_at_night


def continuous(pressure: np.ndarray, rate_hz: float = 100.0, noise_kpa: float = 0.05) -> Recording:
    """A run of a pressure trace with a signal that follows it."""
    plant = Plant(rate_hz=rate_hz, pressure_noise_kpa=noise_kpa)
    return plant.run(pressure, np.gradient(pressure) > 0, np.zeros(pressure.size))


TIME = np.arange(0.0, 300.0, 0.01)
WAVE = np.cos(2 * np.pi * TIME / 30)


def test_the_table_of_plateaus_has_a_row_a_hold() -> None:
    """Sensors are numbered from 1 in its columns."""
    recording = Staircase(cycles=1).recording()
    table = plateau_table(find_plateaus(recording, find_cycles(recording)))
    assert len(table) == 21
    assert {"pressure_kpa", "s1_mv", "s2_se_mv", "void"} <= set(table.columns)


@pytest.mark.parametrize("rate_hz", mostly_at_night(10.0, 62.0, 100.0, 1000.0, by_day=3))
@pytest.mark.parametrize("ramp", [5.0, 20.0])
def test_every_hold_of_a_staircase_is_found(rate_hz: float, ramp: float) -> None:
    """At any rate and ramp all 91 holds are plateaus of the cycles, at their pressure, inside their true rows."""
    stairs = Staircase(Plant(rate_hz=rate_hz), ramp_kpa_per_s=ramp)
    recording = stairs.recording()
    plateaus = [p for p in find_plateaus(recording, find_cycles(recording)) if p.branch]
    rows = stairs.trace()[3]
    assert len(plateaus) == 91
    assert not any(p.void for p in plateaus)
    for plateau, (first, last), (level, loading, cycle) in zip(plateaus, rows, stairs.levels(), strict=True):
        assert plateau.pressure_kpa == pytest.approx(level, abs=0.2)
        assert first <= plateau.settled_first <= plateau.last <= last + 0.2 * rate_hz
        assert plateau.cycle == cycle
        assert plateau.branch == ("loading" if loading else "start" if plateau is plateaus[0] else "unloading")


@pytest.mark.fault(39, how="holds of unequal length under noise", times=1)
def test_holds_of_unequal_length_under_noise() -> None:
    """Pressure noise of 5 % of the span and holds of 2 s: still 91."""
    recording = Staircase(Plant(pressure_noise_kpa=4.5)).recording()
    assert sum(bool(p.branch) for p in find_plateaus(recording, find_cycles(recording))) == 91


def test_a_continuous_run_has_no_plateaus() -> None:
    """Slow and fast triangles are continuous."""
    for period in (2.0, 72.0):
        recording = Plant().run(*triangle(10, period))
        assert find_plateaus(recording, find_cycles(recording)) == ()


def test_the_turns_of_a_growing_wave_are_no_plateaus() -> None:
    """Slow turns at ever other pressures are no staircase: the figures are those of a continuous run."""
    recording = continuous(5 + (9 + 36 * TIME / 300) * WAVE)
    assert find_plateaus(recording, find_cycles(recording)) == ()


@pytest.mark.parametrize("period_s", [5.6, 6.0, 6.1, 6.5])
def test_a_window_as_long_as_a_cycle_makes_no_staircase(period_s: float) -> None:
    """The mean over a whole cycle is constant, the pressure is not: here cycles of about 6 s, ramps +- 50 ms."""
    rng = np.random.default_rng(1)
    times, levels = [0.0, 5.0, 6.2], [0.0, 0.0, 50.0]
    for level in (-40.0, 50.0) * 30:
        hold, ramp = 0.3 + rng.uniform(-0.05, 0.05), period_s / 2 - 0.3 + rng.uniform(-0.05, 0.05)
        times += [times[-1] + hold, times[-1] + hold + ramp]
        levels += [levels[-1], level]
    time = np.arange(0.0, times[-1], 0.01)
    recording = continuous(np.interp(time, times, levels), noise_kpa=0.04)
    cycles = find_cycles(recording)
    assert len(cycles.used) == 30
    assert find_plateaus(recording, cycles) == ()


def test_a_staircase_under_noise_is_not_lost_to_a_window_too_short() -> None:
    """One cycle at 200 Hz with 1 kPa of noise and slow ramps: pieces of the ramps do not outvote the 19 holds."""
    plant = Plant(rate_hz=200.0, pressure_noise_kpa=1.0, seed=3)
    recording = Staircase(plant=plant, cycles=1, dwell_s=6.0, ramp_kpa_per_s=5.0).recording()
    holds = [p for p in find_plateaus(recording, find_cycles(recording)) if p.branch]
    levels = [50, 40, 30, 20, 10, 0, -10, -20, -30, -40, -30, -20, -10, 0, 10, 20, 30, 40, 50]
    np.testing.assert_allclose([p.pressure_kpa for p in holds], levels, atol=0.3)


@pytest.mark.fault(22, how="a third of a hold's samples saturated", times=1)
def test_a_damaged_plateau_is_void_with_its_share() -> None:
    """A third of a hold's samples saturated: void, with the share; its neighbours are not."""
    stairs = Staircase()
    pressure, loading, cycle, rows = stairs.trace()
    flags = np.zeros(pressure.size, dtype=int)
    first, last = rows[10]
    flags[first + 60 : first + 130] = 1
    recording = stairs.plant.run(pressure, loading, cycle, flags=flags)
    plateaus = [p for p in find_plateaus(recording, find_cycles(recording)) if p.branch]
    assert [p.number for p in plateaus if p.void] == [plateaus[10].number]
    assert "lost or left out" in plateaus[10].void
    assert last > first


@pytest.mark.parametrize("noise_kpa", [3.0, 4.5])
@pytest.mark.parametrize("shape", ["triangle", "sine"])
def test_a_noisy_wave_is_no_staircase(shape: str, noise_kpa: float) -> None:
    """Short pieces of a ramp under noise look like holds; where a ramp would not show over it they are none."""
    phase = np.arange(16_001) / 2000.0
    wave = np.abs(1.0 - 2.0 * (phase % 1.0)) if shape == "triangle" else 0.5 + 0.5 * np.cos(2 * np.pi * phase)
    pressure = -40.0 + 90.0 * wave
    loading = (phase % 1.0) >= 0.5
    recording = Plant(pressure_noise_kpa=noise_kpa).run(pressure, loading, np.floor(phase) + 1)
    cycles = find_cycles(recording)
    assert len(cycles.complete) == 8
    assert find_plateaus(recording, cycles) == ()
