"""Holds that are not settled: creep of the signal, of the elongation, and a leak; the truth at rest by formulas."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from analysis.figures.pipeline import Analysis
from analysis.numbers import finite
from analysis.segmentation.settling import _gamma
from analysis.warning import WarningCode
from tests.analysis.boat_builder import PAPER, Plant, Staircase
from tests.conftest import mostly_at_night

LOOP_MM = 0.25
STAIRS = Staircase(Plant(loop_mm=LOOP_MM), dwell_s=2.5)
SYSTEM, ACTUATOR = "system_hysteresis_percent_fso", "actuator_hysteresis_percent"
SENSOR = "sensor_hysteresis_percent_fso"


def creeping(values: np.ndarray, share: float, tau_s: float) -> np.ndarray:
    """Return values of which a share follows with a time constant, at 100 Hz."""
    level, out = values[0], np.empty_like(values)
    for i, value in enumerate(values):
        level = level + (value - level) * 0.01 / tau_s
        out[i] = (1.0 - share) * value + share * level
    return out


def run(of: str = "none", share: float = 0.0, tau_s: float = 5.0, stairs: Staircase = STAIRS) -> Recording:
    """Return a staircase with a creep of the `signal`, of the `elongation`, or a `leak` that lowers each pressure."""
    pressure, loading, _, _ = stairs.trace()
    plant = stairs.plant
    rng = np.random.default_rng(plant.seed)
    x = plant.elongation(pressure, loading)
    if of == "elongation":
        x = creeping(x, share, tau_s)
    signal = np.stack([np.polynomial.Polynomial(c)(x) for c in PAPER], axis=1)
    if of == "signal":
        signal = np.stack([creeping(column, share, tau_s) for column in signal.T], axis=1)
    if of == "leak":
        since = np.arange(pressure.size) - np.maximum.accumulate(
            np.where(np.diff(pressure, prepend=np.nan) != 0, np.arange(pressure.size), 0)
        )
        signal *= 1.0 - share * np.exp(-since / (100.0 * tau_s))[:, None]
    signal += rng.standard_normal(signal.shape) * np.asarray(plant.noise_mv)
    measured = pressure + 0.05 * rng.standard_normal(pressure.size)
    return Recording.from_arrays(np.arange(pressure.size) / 100.0, measured, signal)


def analysed(recording: Recording, folder: Path, stairs: Staircase = STAIRS) -> Analysis:
    """Return the analysis with exact readings."""
    stairs.elongations().to_csv(folder / "e.csv", index=False)
    return analyse(recording, folder / "e.csv", options=Options(mcmc=False, fidelity="draft", x_resolution_mm=0.02))


def truth() -> dict[str, float]:
    """Return figures at rest: of the noise-free plant without creep, at its own levels."""
    levels = np.arange(-40.0, 51.0, 10.0)
    down, up = (STAIRS.plant.elongation(levels, np.full(levels.size, loading)) for loading in (False, True))
    cubic = np.polynomial.Polynomial(PAPER[0])
    fso = float(cubic(3.8) - cubic(-2.7))
    return {
        "fso_mv": fso,
        SYSTEM: 100.0 * float(np.abs(cubic(up) - cubic(down)).max()) / fso,
        ACTUATOR: 100.0 * LOOP_MM / 6.5,
        SENSOR: 0.0,  # what is seen of it is creep
    }


@pytest.mark.parametrize(("of", "share", "tau_s"), mostly_at_night(
    ("signal", 0.1, 12.0), ("elongation", 0.05, 5.0), ("signal", 0.03, 5.0), ("signal", 0.1, 5.0), by_day=2
))  # fmt: skip
def test_intervals_of_unsettled_holds_contain_the_figures_at_rest(
    tmp_path: Path, of: str, share: float, tau_s: float
) -> None:
    """The figures say at which time they are, a warning says so too, and the interval reaches to those at rest."""
    analysis = analysed(run(of, share, tau_s), tmp_path)
    sensor, expected = analysis.sensors[0], truth()
    assert not sensor.settling.settled
    figures = dict(sensor.figures) | analysis.system_figures
    for key in ("fso_mv", SYSTEM, SENSOR, *([ACTUATOR] if of == "elongation" else [])):
        assert figures[key].low <= expected[key] <= figures[key].high, key
        assert figures[key].note.startswith("at 2.5 s: the holds are not settled"), key
    assert {w.code for w in analysis.warnings if w.subject == "s1"} >= {WarningCode.NOT_SETTLED}
    stored = finite(analysis.to_json())["sensors"][0]["settling"]
    assert stored["settled"] is False
    assert stored["held_s"] == pytest.approx(2.5, abs=0.1)


def test_a_change_of_the_positions_alike_is_not_settled_either(tmp_path: Path) -> None:
    """What follows no step, as of a leak: each hold moves the same way, whatever the step before."""
    analysis = analysed(run("leak", 0.002, 5.0), tmp_path)
    assert not analysis.sensors[0].settling.settled
    assert any(w.code is WarningCode.NOT_SETTLED for w in analysis.warnings)


@pytest.mark.parametrize("cycles", [1, 3])
def test_sound_holds_are_settled_and_their_figures_as_before(tmp_path: Path, cycles: int) -> None:
    """No note and no warning; a drift over the run is not taken for a hold that is not settled."""
    stairs = replace(STAIRS, cycles=cycles, plant=replace(STAIRS.plant, drift_mv_per_cycle=1.0))
    analysis = analysed(stairs.recording(), tmp_path, stairs)
    assert analysis.sensors[0].settling.settled
    assert all("settled" not in figure.note for figure in analysis.sensors[0].figures.values())
    assert not any(w.code is WarningCode.NOT_SETTLED for w in analysis.warnings)
    assert finite(analysis.to_json())["sensors"][0]["settling"]["settled"] is True


def test_a_run_without_holds_is_not_tested() -> None:
    """Of a continuous run the test says nothing."""
    pressure = -40.0 + 90.0 * np.abs(1.0 - 2.0 * (np.arange(6001) / 2000.0 % 1.0))
    plain = STAIRS.plant.run(pressure, np.zeros(pressure.size, bool), np.zeros(pressure.size))
    analysis = analyse(plain, options=Options(mcmc=False, fidelity="draft"))
    assert finite(analysis.to_json())["sensors"][0]["settling"]["settled"] is None


def test_a_hold_of_an_hour_has_no_creep_left() -> None:
    """Beside holds of seconds, whose time constants are tried, its course is finite; a warning would be an error."""
    quarters = np.linspace(0.125, 0.875, 4)
    time_s = np.stack([2.5 * quarters, 3600.0 * quarters])
    signal = np.stack([-np.exp(-(time_s[0] - 1.25) / 0.5), np.zeros(4)])
    signal -= signal.mean(axis=1, keepdims=True)
    gamma, standard_error, course = _gamma(np.array([1.0, 0.0]), time_s, signal, tau=0.5)
    assert gamma == pytest.approx(1.0)
    assert np.isfinite(standard_error) and np.isfinite(course).all()
