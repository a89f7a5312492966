"""Readings that must be checked: typing errors are found, sound readings on coarse grids are not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.calibration_export.run_record import elongation_reader
from analysis.calibration_export.verdict import Verdict, VerdictCode, VerdictState, verdict_of
from analysis.certificates.certificate import Request, certificate_of
from analysis.figures.reading_check import judge_readings
from analysis.reports.build import build_report
from boat_daq.workflows.acceptance import RunVerdict
from protocol.base.errors import DataError
from tests.analysis.boat_builder import PAPER, Plant, Staircase
from tests.conftest import mostly_at_night

LEVELS_KPA = np.arange(50.0, -41.0, -10.0)


def readings(seed: int, cycles: int, grid: float, signal=None):
    """Return x as read, the signals of both sensors, pressure and branch of a staircase; truth in closed form."""
    rng = np.random.default_rng(seed)
    down = [(p, -1.0 if i < LEVELS_KPA.size - 2 else 0.0) for i, p in enumerate(LEVELS_KPA[1:])]
    up = [(p, 1.0 if i < LEVELS_KPA.size - 2 else 0.0) for i, p in enumerate(LEVELS_KPA[::-1][1:])]
    pressure, branch = (
        np.array(c) for c in zip((50.0, 0.0), *[row for _ in range(cycles) for row in (*down, *up)], strict=True)
    )
    share = (pressure + 40.0) / 90.0
    x = rng.uniform(-0.2, 0.2) - 2.7 + 6.5 * share - 0.5 * branch * share * (1.0 - share)
    y = [np.polynomial.Polynomial(c)(x) if signal is None else signal(x) for c in PAPER]
    y = [one + 0.3 * rng.standard_normal(x.size) for one in y]
    return np.round(x / grid) * grid, y, pressure, branch


def off(found, grid: float) -> set[int]:
    """Return the readings that are off for any of two sensors."""
    x, signals, pressure, branch = found
    each = [judge_readings(x, y, pressure, branch, reading_sd=grid / np.sqrt(12.0), chance=0.01).off for y in signals]
    return set(np.flatnonzero(np.any(each, axis=0)).tolist())


@pytest.mark.parametrize("grid", mostly_at_night(0.1, 0.5, 0.02))
@pytest.mark.parametrize("cycles", [1, 5])
def test_sound_cubics_raise_no_alarm_on_any_grid(grid: float, cycles: int) -> None:
    """Of 28 sound runs at most one has a reading that is off: 2 % are allowed, 4 of 14 were named on 0.5 mm."""
    assert sum(bool(off(readings(seed, cycles, grid), grid)) for seed in range(28)) <= 1


@pytest.mark.parametrize("signal", [lambda x: 1600 + 150 * np.tanh(x / 3), lambda x: 1900 - 40 * x + 5 * np.sin(2 * x)])
def test_sound_sensors_that_no_cubic_follows_raise_no_alarm(signal) -> None:
    """A sensor that saturates, and a falling one with a wave: the curve misses, the readings are right."""
    assert sum(bool(off(readings(seed, 3, 0.1, signal), 0.1)) for seed in range(12)) <= 1


@pytest.mark.parametrize("cycles", [1, 5])
@pytest.mark.parametrize("wrong", [{4: 10.0}, {0: 37.8}, {9: 2.7}, {3: 10.0, 8: -8.0}, {6: lambda x: x + 1.5}])
def test_typing_errors_are_found_and_no_other_reading(wrong: dict[int, object], cycles: int) -> None:
    """10.00 for 1.00, a lost point, a lost sign, two at once, and 1.5 mm."""
    x, signals, pressure, branch = readings(7, cycles, 0.1)
    for row, value in wrong.items():
        x[row] = value(x[row]) if callable(value) else value
    assert off((x, signals, pressure, branch), 0.1) == set(wrong)


def test_reading_that_alone_determines_the_curve_is_named() -> None:
    """Four levels, one cycle: the lowest was read once, all others twice; a cubic passes through it in any case."""
    pressure = np.array([50.0, 20.0, -10.0, -40.0, -10.0, 20.0, 50.0])
    branch = np.array([0.0, -1.0, -1.0, 0.0, 1.0, 1.0, 0.0])
    x = 0.07 * pressure
    found = judge_readings(x, np.polynomial.Polynomial(PAPER[0])(x), pressure, branch)
    assert np.flatnonzero(found.alone).tolist() == [3]
    assert not found.off.any()


def table(cycles: int, **cells):
    """Return the readings of a staircase with other values at some rows."""
    stairs = Staircase(Plant(loop_mm=0.2), cycles=cycles)
    rows = stairs.elongations().round(2)
    for key, value in cells.items():
        rows.loc[int(key.removeprefix("row")), "elongation_mm"] = value
    return stairs, rows


@cache
def analysed(folder, cycles: int, confirmed: str = "", **cells):
    """Analyse a staircase with these readings; `confirmed` is the reason beside row 4."""
    stairs, rows = table(cycles, **cells)
    if confirmed:
        rows["confirmed"] = ["" if i != 4 else confirmed for i in range(len(rows))]
    rows.to_csv(folder / "e.csv", index=False)
    recording = stairs.recording(meta={"unit": "SA1", "simulated": True})
    return analyse(recording, folder / "e.csv", options=Options(mcmc=False, x_resolution_mm=0.01))


def test_typo_makes_the_calibration_to_be_checked_everywhere(tmp_path_factory) -> None:
    """10.00 for about 1.0 mm: named with its place, not green, no certificate; JSON has it in each calibration."""
    found = analysed(tmp_path_factory.mktemp("typo"), 3, row4=10.0)
    verdict = verdict_of(found)
    assert (verdict.code, verdict.state) == (VerdictCode.READINGS_TO_CHECK, VerdictState.CHECK)
    assert verdict.check_text == "1 reading to check: +10.00 mm at +10 kPa, unloading, cycle 1, 9.0 mm from the others"
    assert verdict.headline == "U is not known yet; 1 reading to check"  # the curve turns
    assert [w.code for w in found.warnings].count("outlier") == 1
    for sensor in found.to_json()["sensors"]:
        (entry,) = sensor["calibration"]["check"]
        assert (entry["kpa"], entry["mm"]) == (pytest.approx(10.0, abs=0.1), 10.0)
    with pytest.raises(DataError, match="1 reading to check"):
        certificate_of([found], Request())


def test_confirmed_reading_is_kept_and_its_reason_printed(tmp_path_factory) -> None:
    """The reason is in verdict, warnings and certificate; nothing is left to check."""
    found = analysed(tmp_path_factory.mktemp("sure"), 3, confirmed="read twice by A. B.", row4=10.0)
    verdict = verdict_of(found)
    assert verdict.readings == ()
    assert [one.confirmed for one in verdict.confirmed] == ["read twice by A. B."]
    assert any(w.code == "reading_confirmed" and "read twice by A. B." in w.text for w in found.warnings)


def test_sound_run_is_usable_with_the_largest_u_over_its_range(tmp_path_factory) -> None:
    """The headline's U is the largest that the live display would give inside the range."""
    found = analysed(tmp_path_factory.mktemp("sound"), 3)
    verdict = verdict_of(found)
    assert (verdict.code, verdict.state, verdict.readings) == (VerdictCode.USABLE, VerdictState.OK, ())
    assert verdict.headline == f"U = {verdict.u_mm:.2g} mm (k = 2) from -2.7 to 3.8 mm"
    least = min(u[:, 1].min() for u in found.u_elongation)
    inside = np.array([1.0 - 1e-7, 1e-7]) @ [verdict.range_mm, verdict.range_mm[::-1]]
    ends = elongation_reader(found).evaluate(np.array([s.calibration.predict(inside) for s in found.sensors]).T)
    assert verdict.u_mm == pytest.approx(2.0 * ends.standard_uncertainty_mm.max(), rel=1e-4)  # at an end of the range
    assert 0.5 * least < verdict.u_mm < max(u[:, 1].max() for u in found.u_elongation)
    assert Verdict().state is VerdictState.NONE


@pytest.mark.parametrize(("turn_mm", "code"), [(4.0, VerdictCode.LARGE_U), (3.0, VerdictCode.TURNS)])
def test_curve_that_turns_near_an_end_is_not_usable(tmp_path, turn_mm: float, code: VerdictCode) -> None:
    """y = -(x - turn)^2 gives y' = 0 at the turn: a green "U = 3.1 mm" of a range of 6.5 mm was accepted."""
    parabola = (1600.0 - 5.0 * turn_mm**2, 10.0 * turn_mm, -5.0)
    stairs = Staircase(Plant(cubics=(parabola,), noise_mv=(1.0,), loop_mm=0.2), cycles=3)
    rows = stairs.elongations()
    late = 0.4 * np.cos(np.arange(len(rows)))  # mm, readings taken too early or late
    (rows.assign(elongation_mm=rows.elongation_mm + late)).to_csv(tmp_path / "e.csv", index=False)
    found = analyse(stairs.recording(meta={"unit": "SA1"}), tmp_path / "e.csv", options=Options(mcmc=False, degree=2))
    verdict, report = verdict_of(found), build_report([found])
    assert verdict.code is code, (verdict, verdict.range_mm)
    assert verdict.state is (VerdictState.FAIL if code is VerdictCode.TURNS else VerdictState.CHECK)
    assert verdict.as_json()["code"] == RunVerdict.of(found).code == code
    assert report.alert
    assert verdict.headline in report.verdict
    if code is VerdictCode.LARGE_U:
        share = verdict.u_mm / (verdict.range_mm[1] - verdict.range_mm[0])
        assert verdict.doubts[0].startswith(f"U is {100 * share:.0f} % of the range, a curve turns at ")
