"""Ranks and winners over turns of the fan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light
from analysis.optics.sweep.fans import PAPER_FANS, FanResult, Rank, compare_fans, fans_of, turned
from analysis.optics.sweep.figure_of_merit import ranks_within
from analysis.optics.sweep.report import rank_text, sweep_json, sweep_text
from analysis.optics.sweep.sweep import FILE_NAME, SweepResult, run_sweep

DESIGNS = (PAPER_OPTIMUM, Design(5, 1.0, 0.6, 0.9), Design(5, 0.9, 0.5, 0.9), Design(7, 1.0, 0.5, 0.6))


def test_ranks_within_a_group_share_the_better_rank_when_equal() -> None:
    """A design outside the group has the rank that it would have in it."""
    p = np.array([3.0, 5.0, 5.0, 1.0])
    np.testing.assert_array_equal(ranks_within(p, np.ones(4, bool)), [3, 1, 1, 4])
    np.testing.assert_array_equal(ranks_within(p, np.array([True, True, False, True])), [2, 1, 1, 3])


def test_paper_is_ranked_among_all_its_count_and_its_map_over_the_fans() -> None:
    """The rank is that of the sweep's own fan, the range is over all; shares of the winners sum to 1."""
    found = FanResult(DESIGNS, np.array([[2.0, 3.0, 1.0, 9.0], [2.0, 1.0, 4.0, 8.0], [7.0, 1.0, 4.0, 2.0]]))
    assert found.paper_ranks() == {
        "all": Rank(3, 4, 1, 3),
        "same_cavities": Rank(2, 3, 1, 2),
        "paper_map": Rank(2, 2, 1, 2),
    }
    assert found.winners() == [(DESIGNS[3], 2 / 3), (PAPER_OPTIMUM, 1 / 3)]
    assert (
        rank_text(found) == "3 of 4 designs (1 to 3), 2 of 3 with as many cavities (1 to 2), 2 of 2 in its map (1 to 2)"
    )
    voids = tuple(replace(design, face="midline") for design in DESIGNS)
    assert FanResult(voids, found.p).paper_ranks() == found.paper_ranks()
    assert FanResult(DESIGNS[1:], found.p[:, 1:]).paper_ranks() == {}


def test_turned_fans_are_different_samples_within_half_a_step() -> None:
    """No two of many turns are the same or mirror images of each other; the first is the light's own."""
    phases = np.array([turned(Light(), fan).phase for fan in range(50)])
    assert phases[0] == 0.0
    assert np.all(np.abs(phases) <= 0.5)
    assert len(np.unique(np.round(np.abs(phases), 6))) == 50
    assert (fans_of(250), fans_of(5_000)) == (PAPER_FANS, 1)


def test_each_fan_is_the_sweep_with_its_turn_and_is_kept(small_result: SweepResult, tmp_path: Path) -> None:
    """P of each fan is that of the same request with its phase; a second call reads them from their files."""
    file, size = tmp_path / FILE_NAME, small_result.ndr.size
    seen: list[tuple[float, float]] = []
    found = compare_fans(small_result, 3, file=file, progress=lambda done, total: seen.append((done, total)))
    np.testing.assert_array_equal(found.p[0], small_result.merit().p)
    request = small_result.request
    again = run_sweep(replace(request, light=turned(request.light, 2)), file=tmp_path / "sweep_fan_2.sqlite")
    assert again.simulated == 0
    np.testing.assert_array_equal(found.p[2], again.merit().p)
    assert seen[-1] == (2 * size, 2 * size)
    content = sweep_json(small_result, found)
    assert content["fans"] == 3
    assert sum(winner["share"] for winner in content["winners"]) == 1.0
    assert content["paper_optimum"]["ranks"]["all"]["rank"] == content["paper_optimum"]["rank"]
    assert "turns of the fan" in sweep_text(small_result, found)
    assert "turns of the fan" not in sweep_text(small_result)
