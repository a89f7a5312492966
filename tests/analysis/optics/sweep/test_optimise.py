"""The search beyond the grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.optics.scene.curves import default_curves
from analysis.optics.scene.parameters import PAPER_OPTIMUM, By, Design, Waveguide, light_by
from analysis.optics.sweep.figure_of_merit import FLOOR, merit
from analysis.optics.sweep.optimise import DesignMerit, design_at, optimise
from analysis.optics.sweep.report import optimum_json, optimum_text
from analysis.optics.sweep.sweep import SweepResult, paper_grid
from protocol.base.errors import RequestError


def test_merit_refuses_nothing_and_ranks_what_fits() -> None:
    """A design that cannot be built has P = -inf, one that can has a finite one, of counts another than of power."""
    from analysis.optics.scene.curves import frames_of

    frames, found = frames_of(default_curves(), Waveguide()), []
    rankings: tuple[By, ...] = ("power", "count")
    for by in rankings:
        merit = DesignMerit(frames, Waveguide(), light_by(by, 50), by)
        assert merit.p(Design(5, 1.0, 2.5, 0.9)) == -np.inf
        found.append(merit.p(PAPER_OPTIMUM))
    assert np.all(np.isfinite(found))
    assert found[0] != found[1]
    assert design_at(np.array([4.6, 0.7, 0.6, 0.5, 0.7])) == Design(5, 0.7, 0.6, 0.5, "inner")


def test_the_search_is_no_worse_than_where_it_starts() -> None:
    """Cut short it still returns a design as good as the grid's best, and reports that it was stopped."""
    seen: list[float] = []
    found = optimise(
        Waveguide(), default_curves(), rays=40, seconds=1.0, progress=lambda done, total: seen.append(done)
    )
    assert found.best.p >= found.start.p
    content = optimum_json(found)
    assert content["gain"] >= 1
    assert 0 < content["best"]["not_followed"] < 0.1
    assert len(content["best_power_sd"]) == 15
    assert "not followed" in optimum_text(found)
    assert "gain" in optimum_text(found)
    assert seen
    with pytest.raises(RequestError):
        optimise(Waveguide(), default_curves(), seconds=0)


@pytest.mark.nightly
def test_a_tolerance_chooses_the_rays_of_the_final_evaluation(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stated error is within it, a smaller one takes more rays, and one that cannot be met names the least."""
    monkeypatch.setattr("analysis.optics.sweep.optimise.paper_grid", lambda face: paper_grid((5,), face)[::16])
    coarse, fine = (
        optimise(Waveguide(), default_curves(), rays=50, seconds=0.3, by="count", tolerance=tolerance)
        for tolerance in (8.0, 0.8)
    )
    assert coarse.error <= 8.0
    assert fine.error <= 0.8
    assert coarse.checked_rays < fine.checked_rays
    assert optimum_json(fine)["error"] == fine.error
    assert "at k = 2" in optimum_text(fine)
    searched: list[float] = []
    with pytest.raises(RequestError) as refused:
        optimise(Waveguide(), default_curves(), tolerance=1e-9, progress=lambda done, total: searched.append(done))
    assert "rays or more" in str(refused.value.remedy)
    assert not searched


def test_a_tolerance_that_the_best_of_the_grid_cannot_meet_is_refused_before_the_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Most of the grid may be less noisy than its best: that was refused only after the whole search."""
    monkeypatch.setattr("analysis.optics.sweep.optimise.paper_grid", lambda face: paper_grid((5,), face)[::16])
    monkeypatch.setattr("analysis.optics.sweep.optimise.light_within", lambda request, tolerance: request.light)
    monkeypatch.setattr(
        "analysis.optics.sweep.optimise._Search.evolve", lambda *_: pytest.fail("the search was started")
    )
    with pytest.raises(RequestError) as refused:
        optimise(Waveguide(), default_curves(), rays=50, seconds=0.3, by="count", tolerance=1e-9)
    assert "rays or more" in str(refused.value.remedy)


def test_the_race_of_a_search_keeps_the_best_design(monkeypatch: pytest.MonkeyPatch) -> None:
    """With P in closed form, largest for 5 cavities 1.2 mm wide, the search finds it and the race keeps it."""
    pattern = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, 15), 6))[0][:, 6] * np.sqrt(15.0)

    def p_in_closed_form(design: Design) -> float:
        away = (design.cavities - 5, 4 * (design.width_mm - 1.2), 4 * (design.depth_mm - 0.6), design.spacing_mm - 1.0)
        return 30.0 / (1.0 + float(np.sum(np.square(away))) + (design.face == "inner"))

    def swept(merit: DesignMerit, designs: Sequence[Design], _: object) -> SweepResult:
        request = replace(merit.request, designs=tuple(designs))
        values = np.array([p_in_closed_form(design) for design in designs])[:, None]
        rng, sd = np.random.default_rng(len(designs)), 100.0 / request.light.rays
        truth = (50.0 - 20.0 * np.linspace(0.0, 1.0, 15) + 20.0 / values * pattern) / 250.0
        power = truth + sd / 250.0 * rng.standard_normal(truth.shape)
        none = np.zeros((len(designs), 15, 10), dtype=np.int64)
        spread = np.full(truth.shape, sd)
        states = np.ones(15, dtype=bool), none, np.zeros((len(designs), 15, 4))
        return SweepResult(request, 250.0 * power, spread, power, spread / 250.0, *states, 0.0, 0)

    monkeypatch.setattr(DesignMerit, "swept", swept)
    monkeypatch.setattr("analysis.optics.sweep.optimise.PATIENCE", 2)
    monkeypatch.setattr("analysis.optics.sweep.optimise.paper_grid", lambda face: paper_grid((5,), face)[::8])
    found = optimise(Waveguide(), default_curves(), rays=4_000, seconds=30.0, confidence=0.95)
    race = found.race
    assert race is not None
    best = max(race.designs, key=lambda design: merit_of(p_in_closed_form(design), pattern))
    assert best in [race.designs[i] for i in race.candidates]
    assert found.best.design.cavities == 5
    assert found.best.design.face == "outer"
    assert found.best.design == race.designs[race.best]
    content = optimum_json(found)
    assert content["race"]["times_less_work"] == pytest.approx(race.saving)
    assert content["equal_work_rays"] == race.equal_rays * len(race.designs)
    assert content["work_rays"] * content["times_less_work"] == pytest.approx(content["equal_work_rays"])
    assert content["work_rays"] > race.work + 4_000 * len(race.designs) / 2
    assert "with the search" in optimum_text(found)


def test_every_design_of_a_search_races(monkeypatch: pytest.MonkeyPatch) -> None:
    """The grid's and the search's designs compete; stopped at once, the race leaves those it did not trace."""
    monkeypatch.setattr("analysis.optics.sweep.optimise.paper_grid", lambda face: paper_grid((5,), face)[::8])
    searched: list[Design] = []
    evaluate = DesignMerit.p

    def p(merit: DesignMerit, design: Design) -> float:
        searched.append(design)
        return evaluate(merit, design)

    monkeypatch.setattr(DesignMerit, "p", p)
    found = optimise(
        Waveguide(), default_curves(), rays=100, seconds=0.5, by="count", confidence=0.95, most_rays=4_000,
        race_seconds=1e-9,
    )  # fmt: skip
    race = found.race
    assert race is not None
    assert not race.finished
    assert set(race.designs) <= set(searched)
    assert {d for d in searched if d in paper_grid((5,))} <= {*race.designs, PAPER_OPTIMUM}
    assert found.best.design in [race.designs[i] for i in race.candidates]
    assert 0 < np.sum(race.level == 0) < len(race.designs)


def merit_of(p: float, pattern: np.ndarray) -> float:
    """Return P of the line whose amplitude is that of a P with one rise."""
    return float(merit(20.0 * (1.0 - np.linspace(0.0, 1.0, 15)) + 20.0 / p * pattern, FLOOR).p)
