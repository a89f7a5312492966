"""What lies between levels and beyond the outermost bins, and the noise of a bin's mean."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from analysis.statistics import bound_between
from tests.analysis import boat_builder
from tests.analysis.boat_builder import PAPER, Plant, Staircase, triangle

SYSTEM, ACTUATOR = "system_hysteresis_percent_fso", "actuator_hysteresis_percent"
QUICK = Options(mcmc=False, fidelity="draft", x_resolution_mm=0.02)
FSO_MV = float(np.polynomial.Polynomial(PAPER[0])(3.8) - np.polynomial.Polynomial(PAPER[0])(-2.7))
SHAPES = {
    "parabola": lambda s: 4.0 * s * (1.0 - s),
    "roof": lambda s: 1.0 - np.abs(2.0 * s - 1.0) ** 1.4,
    "flat top": lambda s: np.minimum(1.0, 4.0 * np.minimum(s, 1.0 - s)),
    "skew": lambda s: np.where(s < 0.35, s / 0.35, (1.0 - s) / 0.65),
}


@dataclass(frozen=True)
class ShapedPlant(Plant):
    """A plant whose actuator's loop has another shape over pressure; its greatest width is `loop_mm`."""

    shape: str = "parabola"

    def elongation(self, pressure_kpa: np.ndarray, loading: np.ndarray) -> np.ndarray:
        """x(p), as of `Plant`."""
        share = (pressure_kpa + 40.0) / 90.0
        bow = 0.5 * self.loop_mm * SHAPES[self.shape](np.clip(share, 0.0, 1.0))
        return -2.7 + 6.5 * share + np.where(loading, -bow, bow)


def truth(plant: Plant) -> dict[str, float]:
    """Return the greatest widths of the loops over all pressures, % of their spans."""
    p, cubic = np.linspace(-40.0, 50.0, 2001), np.polynomial.Polynomial(PAPER[0])
    down, up = (plant.elongation(p, np.full(p.size, way)) for way in (False, True))
    return {
        SYSTEM: 100.0 * float(np.abs(cubic(up) - cubic(down)).max()) / FSO_MV,
        ACTUATOR: 100.0 * float(np.abs(up - down).max()) / 6.5,
    }


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "levels",
    [(50, 20, -10, -40), pytest.param(tuple(range(50, -41, -10)), marks=pytest.mark.nightly)],
    ids=["four levels", "ten levels"],
)
def test_intervals_hold_the_loop_between_the_levels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, levels: tuple[int, ...], shape: str
) -> None:
    """A loop of 12 % of four shapes: that of the actuator, and that of the system over pressure."""
    monkeypatch.setattr(boat_builder, "LEVELS", np.array(levels))
    stairs = Staircase(ShapedPlant(loop_mm=0.78, seed=4, shape=shape), cycles=3)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=QUICK)
    figures = dict(analysis.sensors[0].figures) | analysis.system_figures
    for key, expected in truth(stairs.plant).items():
        assert figures[key].low <= expected <= figures[key].high, (key, expected, figures[key])
    if len(levels) == 10:
        assert figures[SYSTEM].high - figures[SYSTEM].low < 0.2 * figures[SYSTEM].value


def test_the_bound_between_levels_by_hand() -> None:
    """A roof reaches it; a loop that is flat at the top is bounded by its own height; two levels are all that is."""
    assert bound_between(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 2.0, 2.0, 0.0])) == pytest.approx(3.0, rel=0.02)
    assert bound_between(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([0.0, -2, -2, -2, 0.0])) == pytest.approx(2.0)
    assert bound_between(np.array([0.0, 1.0]), np.array([1.0, np.nan])) == 1.0


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_full_scale_and_repeatability_of_a_continuous_run_are_those_of_no_rate(rate_hz: float) -> None:
    """15 bins or 45: the full scale is extrapolated with its curvature; cycles that differ by 0.6 mV have 0.23 %."""
    pressure, loading, cycle = triangle(10, 9.0, rate_hz)
    found, held, expected = [], 0, 100.0 * 0.6 / FSO_MV
    for seed in range(6):
        plain = Plant(loop_mm=0.25, rate_hz=rate_hz, seed=seed).run(pressure, loading, cycle)
        offset = 0.6 * np.random.default_rng(100 + seed).standard_normal(12)[np.minimum(cycle.astype(int), 11)]
        run = Recording.from_arrays(plain.time_s, plain.pressure_kpa, plain.signal_mv + offset[:, None])
        analysis = analyse(run, options=QUICK)
        figures = analysis.sensors[0].figures
        assert figures["fso_mv"].low <= FSO_MV <= figures["fso_mv"].high
        spread = figures["repeatability_percent_fso"]
        found.append(spread.value)
        held += spread.low <= expected <= spread.high
    assert analysis.loops.level_kpa.size == (15 if rate_hz == 20.0 else 45)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(expected, rel=0.25)
    assert held >= 5


def test_cycles_alike_have_no_repeatability_but_an_interval() -> None:
    """Noise alone at 20 Hz: less than a fifth of what the bins' means scatter by; the interval begins at zero."""
    run = Plant(loop_mm=0.25, rate_hz=20.0, seed=7).run(*triangle(10, 9.0, 20.0))
    figures = analyse(run, options=QUICK).sensors[0].figures
    spread, worst = figures["repeatability_percent_fso"], figures["repeatability_worst_percent_fso"]
    assert spread.value < 0.1
    assert spread.low == 0.0 < spread.high < 0.3
    assert worst.low == 0.0
