"""Cycles, plateaus and strokes: the right count whatever the pressure does."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis import Recording, find_cycles, find_plateaus
from analysis.data.csv_table import read_table
from analysis.segmentation.cycles import disagreements_with_marks
from analysis.segmentation.strokes import find_strokes
from tests.analysis.boat_builder import Plant, Staircase, marks_of, triangle


def continuous(pressure: np.ndarray, rate_hz: float = 100.0, noise_kpa: float = 0.05) -> Recording:
    """A run of a pressure trace with a signal that follows it."""
    plant = Plant(rate_hz=rate_hz, pressure_noise_kpa=noise_kpa)
    return plant.run(pressure, np.gradient(pressure) > 0, np.zeros(pressure.size))


TIME = np.arange(0.0, 300.0, 0.01)
WAVE = np.cos(2 * np.pi * TIME / 30)


@pytest.mark.fault(38, 39, how="traces whose count of cycles is known", times=10)
@pytest.mark.parametrize(
    ("name", "pressure", "noise_kpa", "complete", "partial"),
    [
        ("sine", 5 + 45 * WAVE, 0.05, 10, 0),
        ("noise of 5 % of the span", 5 + 45 * WAVE, 4.5, 10, 0),
        ("ties: clipped at both ends", np.clip(5 + 70 * WAVE, -40, 50), 0.0, 10, 0),
        ("growing amplitude", 5 + (30 + 15 * TIME / 300) * WAVE, 0.05, 10, 0),
        ("shrinking amplitude", 5 + (45 - 15 * TIME / 300) * WAVE, 0.05, 10, 0),
        ("drifting level", 5 + 45 * WAVE + TIME / 30, 0.05, 10, 0),
        ("square, ends half way", np.where(TIME % 30 < 15, 50.0, -40.0), 0.05, 9, 1),
        ("one pass", 50 - 90 * TIME / 300, 0.05, 0, 1),
        ("nothing moves", 0 * TIME + 3, 0.05, 0, 0),
        ("cut off in the last branch", (5 + 45 * WAVE)[:28_000], 0.05, 9, 1),
    ],
)
def test_the_count_is_right(name: str, pressure: np.ndarray, noise_kpa: float, complete: int, partial: int) -> None:
    """Faults 38 and 39: complete and partial cycles of traces whose count is known."""
    found = find_cycles(continuous(pressure, noise_kpa=noise_kpa)).as_json()
    assert (found["complete"], found["partial"]) == (complete, partial), name


@pytest.mark.fault(39, how="a dip of a quarter of the span", times=1)
def test_small_excursions_are_listed_as_left_out() -> None:
    """A dip of a quarter of the span inside a branch makes no cycle, and is listed once."""
    pressure = 5 + 45 * WAVE
    dip = (TIME > 5) & (TIME < 9)
    pressure = pressure + np.where(dip, -40 * np.sin(np.pi * (TIME - 5) / 4), 0.0)
    cycles = find_cycles(continuous(pressure))
    assert len(cycles.used) == 10
    assert len(cycles.excursions) == 1
    assert cycles.excursions[0].reason == "too small to be a cycle"


def test_a_spike_is_no_cycle() -> None:
    """Single samples at absurd pressures change neither the count nor the span."""
    pressure = 5 + 45 * WAVE
    pressure[[4000, 9000, 20000]] = [500.0, -300.0, 0.0]
    assert len(find_cycles(continuous(pressure)).used) == 10


@pytest.mark.parametrize("value", [0.0, -100.0, np.nan])
def test_drop_outs_make_no_cycle(value: float) -> None:
    """Twenty bursts of 30 samples at zero, at an absurd value, or not there at all: ten cycles, as without them."""
    pressure = 5 + 45 * WAVE
    for first in range(700, 29_000, 1400):
        pressure[first : first + 30] = value
    cycles = find_cycles(continuous(pressure, noise_kpa=0.2))
    assert len(cycles.used) == 10
    assert all(e.high_kpa - e.low_kpa < 0.25 * cycles.span_kpa for e in cycles.excursions)


def test_a_seldom_sampled_square_wave_is_no_series_of_drop_outs() -> None:
    """Holds of 30 samples between the extremes are cycles: nine complete ones and the last, cut off."""
    pressure = np.where(np.arange(600) % 60 < 30, 50.0, -40.0)
    assert find_cycles(continuous(pressure, rate_hz=10.0)).as_json() == {"complete": 9, "partial": 1, "with_gap": 0}


@pytest.mark.parametrize("rate_hz", [10.0, 62.0, 100.0, 1000.0])
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
    """The mean over a whole cycle stands still, the pressure does not: here cycles of about 6 s, ramps +- 50 ms."""
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


@pytest.mark.fault(25, how="a segment boundary inside a cycle", times=1)
def test_a_pause_leaves_its_cycle_out() -> None:
    """Fault 25: the cycle across a segment boundary is left out, the count goes on."""
    pressure, loading, cycle = triangle(5, 30)
    segment = (np.arange(pressure.size) > 4500).astype(int)
    cycles = find_cycles(Plant().run(pressure, loading, cycle, segment=segment))
    assert [c.number for c in cycles.used] == [1, 3, 4, 5]
    assert "pause" in cycles.complete[1].left_out


@pytest.mark.fault(5, 38, how="70,000 indices missing in a cycle", times=1)
def test_a_gap_marks_its_cycle_with_the_exact_count() -> None:
    """Fault 5: 70,000 indices missing are counted exactly, and mark one cycle."""
    pressure, loading, cycle = triangle(5, 30)
    index = np.arange(pressure.size)
    index[4500:] += 70_000
    recording = Plant().run(pressure, loading, cycle, index=index)
    cycles = find_cycles(recording)
    assert recording.lost == 70_000
    assert cycles.as_json()["with_gap"] == 1
    assert cycles.complete[1].lost == 70_000


def test_the_sequencers_marks_agree_or_are_reported() -> None:
    """Marks of the true steps agree; marks of another number of cycles are reported."""
    stairs = Staircase()
    right = stairs.recording(steps=marks_of(stairs))
    assert disagreements_with_marks(find_cycles(right), right) == ()
    wrong = stairs.recording(steps=marks_of(stairs)[:60])
    assert "sequencer marked 3" in disagreements_with_marks(find_cycles(wrong), wrong)[0]


def test_strokes_of_real_data_meet_the_reference(shared_data: Path) -> None:
    """All six files of the pneumatic set: 10 strokes each way, figures within 2 %, holes and 62 Hz included."""
    folder = shared_data / "zillen_pneumatic"
    for name, truth in json.loads((folder / "expected.json").read_text())["files"].items():
        columns = read_table(folder / name).columns
        found = find_strokes(columns[0] / 1000, columns[4], columns[6], min_speed=2.0)
        assert (found.up_rows.size, found.down_rows.size, found.cycles) == (10, 10, 9)
        for key, value in {
            "peak_mean": found.peak_mean, "trough_mean": found.trough_mean, "period_mean_s": found.period_mean_s,
            "loop_area_mean_Nmm": found.loop_area_mean, "half_width_mid_N": found.half_width_mean,
            "stroke_p1_p99": found.span,
        }.items():  # fmt: skip
            assert value == pytest.approx(truth[key], rel=0.02), (name, key)


def test_real_data_cycles_are_ten(shared_data: Path) -> None:
    """The drive of each file, taken as pressure: ten cycles from its own starting extreme, and every hole."""
    folder = shared_data / "zillen_pneumatic"
    for name, truth in json.loads((folder / "expected.json").read_text())["files"].items():
        columns = read_table(folder / name).columns
        recording = Recording.from_arrays(columns[0] / 1000, columns[4], columns[6])
        cycles = find_cycles(recording)
        assert len(cycles.used) == 10, name
        assert len(recording.gaps) == truth["gaps_gt_50ms"], name


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


@pytest.mark.parametrize("ends", [(50.0, 0.0), (0.0, 50.0), (0.0, -40.0), (-40.0, 0.0)])
def test_a_plan_that_ends_at_zero_is_not_taken_for_the_vented_state(ends: tuple[float, float]) -> None:
    """Four cycles between 0 and +50 or -40 kPa in steps of 10, vented before and after: four, with their holds."""
    step = 10.0 if ends[1] > ends[0] else -10.0
    way = np.arange(ends[0], ends[1] + step / 2, step)
    levels = [way[0], *np.tile(np.concatenate([way[1:], way[::-1][1:]]), 4)]
    parts, at = [np.zeros(300)], 0.0
    for level in levels:
        parts += [np.linspace(at, level, max(round(abs(level - at) * 5), 1), endpoint=False), np.full(200, level)]
        at = float(level)
    parts += [np.linspace(at, 0.0, 100), np.zeros(300)]
    pressure = np.concatenate(parts)
    recording = Plant().run(pressure, np.gradient(pressure) > 0, np.ones(pressure.size))
    cycles = find_cycles(recording)
    assert len(cycles.complete) == 4
    inside = [p for p in find_plateaus(recording, cycles) if p.branch]
    assert len(inside) == 1 + 8 * (way.size - 1)
