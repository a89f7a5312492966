"""The grid of readings, inferred from their own steps, said, and compared with what was stated."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.segmentation.plateau_readings import steps_of
from tests.analysis.boat_builder import Plant, Staircase


@pytest.mark.parametrize("grid", [1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.001])
@pytest.mark.parametrize("n", [19, 91])
def test_steps_of_readings_are_their_grid(grid: float, n: int) -> None:
    """Readings of an even range of elongations, rounded to the grid and written with its decimals; 40 sets."""
    for seed in range(40):
        x = np.random.default_rng(seed).uniform(-2.7, 3.8, n)
        assert steps_of(np.round(np.round(x / grid) * grid, 6)) == pytest.approx(grid)


def test_steps_of_few_readings_and_of_values_on_no_grid() -> None:
    """Two readings show their decimals alone; computed values have none; one slip does not refine a grid."""
    assert steps_of(np.array([-2.5, 4.0])) == pytest.approx(0.1)
    assert steps_of(np.array([np.pi, np.e, 2**0.5, 3**0.5])) == 0.0
    assert np.isnan(steps_of(np.full(3, np.nan)))
    halves = np.append(np.arange(-2.5, 4.1, 0.5), 1.93)
    assert steps_of(halves) == pytest.approx(0.5)


@pytest.fixture(scope="module")
def run_with(tmp_path_factory):
    """Return a function that analyses three cycles with readings rounded to a grid, in a file that states none."""
    stairs, folder = Staircase(Plant(loop_mm=0.2, noise_mv=(0.2, 0.2)), cycles=3), tmp_path_factory.mktemp("grid")

    def analysed(grid: float, **options):
        rows = stairs.elongations()
        rows["elongation_mm"] = (rows["elongation_mm"] / grid).round() * grid
        rows.round(6).to_csv(folder / "e.csv", index=False)
        return analyse(stairs.recording(), folder / "e.csv", options=Options(mcmc=False, **options))

    return analysed


def least_u(found) -> float:
    """Return the least U of the first sensor, mm."""
    return float(np.nanmin(found.u_elongation[0][:, 1]))


def test_three_decimals_are_read_on_a_grid_of_a_thousandth(run_with) -> None:
    """U is that of the stated grid of 0.001 mm, a fifth at most of the one on 0.5 mm; the grid is said."""
    inferred, stated, coarse = (
        run_with(0.001),
        run_with(0.001, x_resolution_mm=0.001),
        run_with(0.001, x_resolution_mm=0.5),
    )
    assert inferred.reading_sd_mm == pytest.approx(0.001 / 12**0.5)
    assert least_u(inferred) == pytest.approx(least_u(stated))
    assert least_u(inferred) < 0.2 * least_u(coarse)
    assert inferred.to_json()["reading_grid"] == {"mm": 0.001, "steps_mm": 0.001, "stated_mm": None, "from": "steps"}
    assert not [w for w in inferred.warnings if w.code == "reading_grid"]


def test_a_stated_grid_that_the_steps_contradict_is_named(run_with) -> None:
    """Stated coarser and finer than the steps: each is used as stated, and named; the p near 1 is a finding."""
    coarse, fine = run_with(0.02, x_resolution_mm=0.5), run_with(0.5, x_resolution_mm=0.02)
    (text,) = (w.text for w in coarse.warnings if w.code == "reading_grid")
    assert text == "the readings are in steps of 0.02 mm, finer than the stated grid of 0.5 mm: U may be too wide"
    (text,) = (w.text for w in fine.warnings if w.code == "reading_grid")
    assert text == "the readings are in steps of 0.5 mm, coarser than the stated grid of 0.02 mm: U is too small"
    assert [w.subject for w in coarse.warnings if w.code == "reading_error_overstated"] == ["s1", "s2"]
    assert not [w for w in run_with(0.5).warnings if w.code in ("reading_grid", "reading_error_overstated")]
