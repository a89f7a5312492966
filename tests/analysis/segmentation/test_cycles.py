"""Cycles, plateaus and strokes: the right count whatever the pressure does."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis import Recording, find_cycles, find_plateaus
from analysis.data.csv_table import read_table
from analysis.data.recording import STEP_COLUMNS
from analysis.segmentation.cycles import disagreements_with_marks
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


@pytest.mark.fault(25, how="a segment boundary inside a cycle", times=1)
def test_a_pause_leaves_its_cycle_out() -> None:
    """Fault 25: the cycle across a segment boundary is left out, the count continues."""
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


def test_real_data_cycles_are_ten(shared_data: Path) -> None:
    """The drive of each file, taken as pressure: ten cycles from its own starting extreme, and every hole."""
    folder = shared_data / "zillen_pneumatic"
    for name, truth in json.loads((folder / "expected.json").read_text())["files"].items():
        columns = read_table(folder / name).columns
        recording = Recording.from_arrays(columns[0] / 1000, columns[4], columns[6])
        cycles = find_cycles(recording)
        assert len(cycles.used) == 10, name
        assert len(recording.gaps) == truth["gaps_gt_50ms"], name


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


def stairs_from(start_kpa: float, ends: tuple[float, float], cycles: int) -> Recording:
    """A staircase in steps of 10 kPa whose first sample is `start_kpa`, inside the ramp to its first end."""
    step = 10.0 if ends[1] > ends[0] else -10.0
    way = np.arange(ends[0], ends[1] + step / 2, step)
    parts, at = [], start_kpa
    for level in (ends[0], *np.tile(np.concatenate([way[1:], way[::-1][1:]]), cycles)):
        count = max(round(abs(level - at) * 5), 1)
        parts += [np.linspace(at, level, count, endpoint=False), np.full(200, level)]
        at = float(level)
    pressure = np.concatenate([*parts, np.linspace(at, 0.0, 200)])
    return Plant().run(pressure, np.gradient(pressure) > 0, np.ones(pressure.size))


@pytest.mark.parametrize("cycles", [1, 2, pytest.param(5, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("ends", [(50.0, -40.0), (-40.0, 50.0)])
@pytest.mark.parametrize("start_kpa", [-35.0, -20.0, -5.0, 0.0, 5.0, 12.0, 25.0, 45.0])
def test_recording_that_begins_inside_a_ramp_keeps_its_first_cycle(
    start_kpa: float, ends: tuple[float, float], cycles: int
) -> None:
    """Whatever the pressure of the first sample: every cycle from the plan's first end, every hold in its branch."""
    recording = stairs_from(start_kpa, ends, cycles)
    found = find_cycles(recording)
    assert len(found.used) == cycles
    assert all(cycle.falls_first == (ends[0] > ends[1]) for cycle in found.used)
    assert found.partial == ()
    assert sum(bool(p.branch) for p in find_plateaus(recording, found)) == 1 + 18 * cycles


@pytest.mark.parametrize("phase", np.arange(0.05, 1.0, 0.1))
def test_no_cycle_is_lost_to_the_choice_of_the_first_extreme(phase: float) -> None:
    """A triangle wave begun at any phase and cut 5.3 periods later: as many cycles as whole pairs of branches.

    The turning points are at multiples of half a period; a cycle needs three of them, two cycles five.
    """
    period = np.arange(phase, phase + 5.3, 1 / 3000)
    pressure = 5 + 45 * (2 * np.abs(2 * (period % 1) - 1) - 1)
    turns = np.floor(2 * period[-1]) - np.ceil(2 * phase) + 1
    found = find_cycles(continuous(pressure))
    assert len(found.used) >= (turns - 1) // 2
    assert found.used[0].turn - found.used[0].first == pytest.approx(1500, abs=40)


@pytest.mark.parametrize("ripple_kpa", [0.0, 0.05, 0.3, 0.9])
def test_pressure_that_is_held_has_no_cycle(ripple_kpa: float) -> None:
    """A ripple within the tolerance of a hold, with a period of 20 s, is no drive, and the reason gives its span."""
    found = find_cycles(continuous(3 + ripple_kpa * np.sin(2 * np.pi * TIME / 20), noise_kpa=0.02))
    assert found.complete == found.partial == found.excursions == ()
    assert found.void.endswith("nothing was driven")
    assert f"{found.span_kpa:.2g} kPa" in found.void


def test_a_smaller_tolerance_finds_the_cycles_of_a_small_drive() -> None:
    """Fifteen periods of 0.6 kPa are cycles where a held pressure stays within 0.1 kPa."""
    recording = continuous(3 + 0.3 * np.sin(2 * np.pi * TIME / 20), noise_kpa=0.005)
    assert len(find_cycles(recording, tolerance_kpa=0.1).used) in (14, 15)


@pytest.mark.parametrize(("branches", "complete"), [(("start",), 0), (("start", "unloading"), 0), ((), 1)])
def test_run_stopped_at_its_first_plateau_has_no_cycle(branches: tuple[str, ...], complete: int) -> None:
    """From 0 to the opening plateau and back is a cycle of the pressure, but not where the sequencer began none."""
    pressure = np.interp(np.arange(0.0, 60.0, 0.01), [0, 5, 15, 35, 45, 60], [0, 0, 50, 50, 0, 0])
    recording = continuous(pressure)
    rows = [
        (n, 0, n, int(n > 1), branch, 50.0, 5.0, 5.0 * n, None, None, 5.0 * n + 5.0, "aborted", "{}")
        for n, branch in enumerate((*branches, *(("end",) if branches else ())), 1)
    ]
    recording = dataclasses.replace(recording, steps=pd.DataFrame(rows, columns=list(STEP_COLUMNS)))
    found = find_cycles(recording)
    assert found.as_json()["complete"] == complete
    assert all("before its first cycle" in cycle.left_out for cycle in found.complete) is bool(branches)
