"""The race of designs: its bounds, what it eliminates, and that it is the same wherever it runs."""

from __future__ import annotations

import itertools
import json
import os
import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from analysis.optics.scene.curves import frames_of, parametric_curves
from analysis.optics.scene.geometry import pattern_of
from analysis.optics.scene.parameters import By, Design, Light, light_by
from analysis.optics.sweep.figure_of_merit import FLOOR, merit, p_bounds, resolution
from analysis.optics.sweep.race import Race, first_rays_of, race_sweep, rays_of_rounds
from analysis.optics.sweep.report import race_json, race_text, times_fewer, write_race
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, common_of, paper_grid, result_of, run_item
from protocol.base.errors import RequestError

BEST = Design(7, 1.0, 0.5, 0.6)


def known(
    designs: Sequence[Design], truth: np.ndarray, light: Light, rng: np.random.Generator, stated: float = 1.0
) -> SweepResult:
    """Return counts: a truth with normal noise that falls as one over the rays; `stated` is the part that is stated."""
    sd = np.full((len(designs), 15), 1_000.0 / light.rays)
    rows = truth[[round(design.width_mm * 100) for design in designs]] + sd * rng.standard_normal(sd.shape)
    sd *= stated
    request = SweepRequest(tuple(designs), light=light)
    none = np.zeros((len(designs), 15, 10), dtype=np.int64)
    return SweepResult(request, rows, sd, rows, sd, np.ones(15, dtype=bool), none, np.zeros((1, 15, 4)), 0.0, 0)


def test_bounds_contain_p_as_often_as_stated() -> None:
    """Each bound of P fails in no more than its probability of 2,000 noisy responses, with and without rises."""
    rng = np.random.default_rng(1)
    states = np.arange(15.0)
    for wave, sd in ((0.0, 0.3), (1.0, 0.3), (3.0, 1.0)):
        truth = 100.0 - 2.0 * states + wave * np.sin(2.1 * states)
        noisy = truth + sd * rng.standard_normal((2_000, 15))
        low, high = p_bounds(noisy, np.full(noisy.shape, sd), FLOOR, low_error=0.05, high_error=0.05)
        p = float(merit(truth, FLOOR).p)
        assert np.mean(low > p) < 0.07
        assert np.mean(high < p) < 0.07
        assert np.median(high / low) < 60


def test_bounds_hold_where_the_states_scatter_unequally() -> None:
    """A scene of the adversary: errors seven times as large in some states failed in 5.4 % in place of 4 %."""
    states = np.arange(15.0)
    truth = 100.0 - 1.42 * states + 1.81 * np.sin(0.436 * states)
    sd = np.exp(0.21 + 0.97 * np.sin(0.436 * states + 1.3))
    noisy = truth + sd * np.random.default_rng(4).standard_normal((1_500, 15))
    low, high = p_bounds(noisy, np.broadcast_to(sd, noisy.shape), FLOOR, low_error=0.04, high_error=0.04)
    p = float(merit(truth, FLOOR).p)
    assert np.mean(low > p) < 0.04
    assert np.mean(high < p) < 0.04


def test_bounds_close_as_the_noise_vanishes() -> None:
    """Without noise both bounds are P itself, as is the floor that the paper's rays give."""
    ndr = 100.0 - 2.0 * np.arange(15.0) + np.cos(np.arange(15.0))
    for sd in (0.0, 1e-6):
        low, high = p_bounds(ndr[None], np.full((1, 15), sd), FLOOR, low_error=0.01, high_error=0.01)
        assert low == pytest.approx(merit(ndr, FLOOR).p, rel=1e-4)
        assert high == pytest.approx(low, rel=1e-4)
    assert pytest.approx(resolution(250)) == FLOOR


@pytest.mark.nightly
def test_the_best_is_among_the_candidates_as_often_as_stated() -> None:
    """In 60 races of designs with a known truth the best is lost in no more than 5 %, and work is saved."""
    rng = np.random.default_rng(3)
    states = np.arange(15.0)
    truth = np.array([100.0 - 2.0 * states + rng.normal(0.0, 0.4 + 0.05 * i, 15) for i in range(40)])
    designs = tuple(Design(3, 0.01 * i, 0.5, 0.9) for i in range(1, 40))
    best = designs[int(np.argmax(merit(truth[1:], FLOOR).p))]
    lost, saved = 0, []
    for seed in range(60):
        race = Race(designs, Light(), 0.95, 64_000, seed)
        race.run(lambda some, light: known(some, truth, light, rng))
        lost += best not in [race.designs[i] for i in race.candidates]
        saved.append(race.saving)
    assert lost <= 3
    assert min(saved) > 3


PATTERN = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, 15), 6))[0][:, 6] * np.sqrt(15.0)
"""Root mean square 1, orthogonal to cubics: P of a line with it is its fall over rises and amplitude."""


def line_races(races: int, *, stated: float = 1.0, seconds: float = np.inf) -> list[Race]:
    """Return races of 30 designs with a known P: 24, 24, 23, 22, 20, and others below 15.

    Parameters
    ----------
    races : how many. stated : part of their errors that the race is told. seconds : of each.
    """
    rng, found = np.random.default_rng(5), []
    fall = np.concatenate([[24.0, 24.0, 23.0, 22.0, 20.0], np.linspace(4.0, 15.0, 25)])
    rises = np.sum(np.diff(PATTERN) > fall[:, None] / 14, axis=1)
    for seed in range(races):
        amplitude = rng.uniform(0.5, 1.2, fall.size)
        truth = 100.0 - np.linspace(0.0, 1.0, 15) * (fall * amplitude)[:, None] + amplitude[:, None] * PATTERN
        assert np.allclose(merit(truth, FLOOR).p, fall / np.maximum(rises, 1))
        truth = np.concatenate([np.zeros((1, 15)), truth])
        designs = tuple(Design(3, 0.01 * (i + 1), 0.5, 0.9) for i in range(fall.size))
        race = Race(designs, Light(), 0.95, 64_000, seed)

        def simulate(some: Sequence[Design], light: Light, truth: np.ndarray = truth) -> SweepResult:
            return known(some, truth, light, rng, stated)

        found.append(race.run(simulate, seconds=seconds))
    return found


@pytest.mark.parametrize("races", [8, pytest.param(400, marks=pytest.mark.nightly)])
def test_designs_that_tie_are_left_together(races: int) -> None:
    """Both of the best in closed form are among the candidates as often as stated, and hardly any other."""
    found = [set(race.candidates) for race in line_races(races)]
    assert np.mean([{0, 1} <= left for left in found]) >= 0.95
    assert np.mean([left == {0, 1} for left in found]) > 0.5
    assert all(left < {0, 1, 2, 3, 4} for left in found)


@pytest.mark.nightly
def test_a_race_whose_errors_are_understated_loses_the_best() -> None:
    """The proof above can fail: with errors stated as two fifths, one of the best is lost more often than stated."""
    found = [set(race.candidates) for race in line_races(40, stated=0.4)]
    assert np.mean([{0, 1} <= left for left in found]) < 0.95


@pytest.mark.parametrize("looks", [1, 3, 5])
def test_a_stopped_race_leaves_the_best(looks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped at the first, third or fifth look at the clock, both of the best are left, and it is not finished."""
    clock = itertools.count()
    monkeypatch.setattr("analysis.optics.sweep.race.time", SimpleNamespace(perf_counter=lambda: float(next(clock))))
    races = line_races(20, seconds=looks - 0.5)
    assert np.mean([{0, 1} <= set(race.candidates) for race in races]) >= 0.95
    assert not any(race.finished for race in races)
    assert all(1 <= len(race.history) <= looks for race in races)
    with pytest.raises(RequestError):
        races[0].run(lambda some, light: known(some, np.zeros((31, 15)), light, np.random.default_rng()), seconds=0.0)


def test_a_race_stopped_in_its_first_round_keeps_what_was_not_traced(tmp_path: Path) -> None:
    """Designs that no ray met are left, without P, and its result and chart are written."""
    request = SweepRequest(paper_grid()[::10])
    race = race_sweep(request, 0.95, most_rays=4_000, seconds=1e-9)
    assert 0 < np.sum(race.level > 0) < len(request.designs)
    assert np.all(race.left[race.level == 0])
    content = race_json(race, "count")
    assert not content["finished"]
    assert content["winner"] is None
    assert content["tied"] == content["candidates"]
    assert content["candidates"][-1]["p"] is None
    assert content["candidates"][-1]["rays"] == 0
    assert content["rays_equal_precision"] == 1_000 * len(request.designs)
    assert "the time ran out" in race_text(race, "count")
    assert json.loads(write_race(race, "count", tmp_path)[0].read_text())["finished"] is False


def test_progress_of_a_race_never_falls() -> None:
    """It rises to the number of designs while rounds become smaller."""
    seen: list[tuple[float, float]] = []
    request = SweepRequest((*paper_grid((3,))[::40], BEST))
    race_sweep(request, 0.95, most_rays=4_000, progress=lambda done, total: seen.append((done, total)))
    assert all(later[0] > sooner[0] - 1e-9 for sooner, later in itertools.pairwise(seen))
    assert seen[-1] == (7.0, 7.0)


@pytest.mark.parametrize("by", ["power", pytest.param("count", marks=pytest.mark.nightly)])
def test_a_race_on_a_cluster_gives_the_same_bits(by: By, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two Dask workers behind TCP trace the race that this process traces: every bound and the history."""
    distributed = pytest.importorskip("distributed")
    for name in ("FIRST_RAYS", "FIRST_RAYS_OF_POWER"):
        monkeypatch.setattr(f"analysis.optics.sweep.race.{name}", 100)
    request = SweepRequest((*paper_grid((3,))[::70], BEST), light=light_by(by, 250), by=by)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None, silence_logs=50
    ) as cluster:
        there = race_sweep(request, 0.95, most_rays=400, scheduler=cluster.scheduler_address)
    assert len(there.history) > 1
    assert_same(there, race_sweep(request, 0.95, most_rays=400))


def assert_same(one: Race, other: Race) -> None:
    """Compare two races to the last bit."""
    for name in ("p", "low", "high", "level"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    assert one.history == other.history


@pytest.mark.nightly
def test_a_race_survives_a_killed_worker() -> None:
    """One of two worker processes is killed in the first round: the race is that of this process, bit for bit."""
    distributed = pytest.importorskip("distributed")
    request, killed = SweepRequest((*paper_grid((3,))[::10], BEST)), []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, protocol="tcp", dashboard_address=None, silence_logs=50
    ) as cluster:

        def kill(done: float, _: float) -> None:
            if not killed and done > 0:
                killed.append(next(iter(cluster.workers.values())).process.process.pid)
                os.kill(killed[0], signal.SIGKILL)

        there = race_sweep(request, 0.95, most_rays=4_000, scheduler=cluster.scheduler_address, progress=kill)
    assert killed
    assert_same(there, race_sweep(request, 0.95, most_rays=4_000))


def test_a_race_finds_the_best_of_traced_designs_on_any_thread(tmp_path: Path) -> None:
    """The leader of the default states wins, resumes from its files, and tells what it saved."""
    request = SweepRequest((*paper_grid((3,))[::60], BEST))
    race = race_sweep(request, 0.95, most_rays=4_000, folder=tmp_path)
    assert race.designs[race.best] == BEST
    again = race_sweep(request, 0.95, most_rays=4_000, folder=tmp_path)
    assert np.array_equal(again.p, race.p)
    content, text = race_json(race, "count"), race_text(race, "count")
    assert content["best"]["cavities"] == 7
    alone = len(content["candidates"]) == 1
    assert (content["winner"], content["tied"]) == ((content["best"], []) if alone else (None, content["candidates"]))
    assert content["rays_total"] * content["times_less_work"] == pytest.approx(content["rays_equal_precision"])
    assert "confidence" in text
    assert {path.name for path in write_race(race, "count", tmp_path)} == {"race.json", "race.png", "race.svg"}


@pytest.mark.parametrize(
    ("saving", "text"), [(33.04, "33.0 times fewer"), (1.0, "1.0 times fewer"), (0.7, "1.4 times more")]
)
def test_a_race_that_took_more_rays_says_so(saving: float, text: str) -> None:
    """It read "0.7 times fewer"."""
    assert times_fewer(saving) == text


@pytest.mark.parametrize(("confidence", "most_rays"), [(0.0, 4_000), (1.0, 4_000), (float("nan"), 4_000), (0.95, 999)])
def test_a_race_without_sense_is_rejected(confidence: float, most_rays: int) -> None:
    """A confidence outside 0 to 1, or fewer rays than the first round's, is refused with a remedy."""
    with pytest.raises(RequestError) as refused:
        Race((BEST,), Light(), confidence, most_rays)
    assert refused.value.remedy


def test_rays_grow_twofold_then_fourfold_up_to_the_most() -> None:
    """The last number of rays is the most allowed; the first is near a thousand."""
    assert rays_of_rounds(64_000) == (1_000, 2_000, 4_000, 16_000, 64_000)
    assert rays_of_rounds(20_000) == (1_250, 5_000, 20_000)
    assert rays_of_rounds(1_500) == (1_500,)
    assert rays_of_rounds(256_000, first_rays_of("power")) == (2_000, 4_000, 16_000, 64_000, 256_000)
    assert rays_of_rounds(1_500, first_rays_of("power")) == (1_500,)


@pytest.mark.nightly
@pytest.mark.parametrize("curves", ["default", "parametric"])
def test_traced_races_contain_the_best(curves: str) -> None:
    """Of 200 races of 12 traced designs, at least 95 % contain the best one at 100,000 rays."""
    designs = (BEST, Design(5, 0.6, 0.6, 1.0), Design(3, 0.8, 0.6, 0.8), *paper_grid()[::72])
    request = SweepRequest(designs)
    if curves == "parametric":
        request = replace(request, curves=parametric_curves())
    frames = frames_of(request.curves, request.guide)
    mirrored = np.array([frame.mirrored for frame in frames])

    def simulate(some: Sequence[Design], light: Light) -> SweepResult:
        results = run_item(common_of(frames, request.guide, light), np.array([pattern_of(each) for each in some]))
        return result_of(replace(request, designs=tuple(some), light=light), mirrored, results)

    truth = merit(simulate(designs, Light().with_rays(100_000)).ndr, FLOOR).p
    races = [Race(designs, Light(), 0.95, 16_000, seed).run(simulate) for seed in range(200)]
    assert np.mean([int(np.argmax(truth)) in race.candidates for race in races]) >= 0.95
