"""The study of what decides the ranking, and the search beyond the grid."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.errors import RequestError
from analysis.optics.scene.curves import default_curves
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sweep.optimise import PowerMerit, design_at, optimise
from analysis.optics.sweep.report import optimum_json, optimum_text
from analysis.optics.sweep.sweep import paper_grid
from tests.analysis.optics.sweep.ranking_study import cases, draw_convergence, study


def test_a_study_compares_its_cases(tmp_path: object) -> None:
    """Each case tells its best, its ties, and the paper's place; more rays scatter less; the first is like itself."""
    chosen = cases(Waveguide(), Light(), rays=(250, 1000))
    names = [name for name, _, _ in chosen]
    assert names == [
        "250 rays",
        "1000 rays",
        "2500 rays, secondaries in proportion",
        "2500 rays, no secondaries",
        "order bounce",
        "order index",
        "index 1.48",
        "index 1.52",
        "thickness 1.5 mm",
        "thickness 2.5 mm",
    ]
    found = study(chosen[:3], paper_grid((5,))[::30])
    assert found[0].rank_correlation == pytest.approx(1.0)
    assert found[1].noise < found[0].noise
    assert all(1 <= case.paper_rank <= 9 for case in found)
    assert len(draw_convergence(found).axes) == 3


def test_proportional_are_the_same_model() -> None:
    """The budget of secondaries grows with the rays."""
    assert Light().with_rays(25_000).secondary == 10_000


def test_power_merit_refuses_nothing_and_ranks_what_fits() -> None:
    """A design that cannot be built has P = -inf, one that can has a finite one."""
    from analysis.optics.scene.curves import frames_of

    judge = PowerMerit(frames_of(default_curves(), Waveguide()), Waveguide(), 50)
    assert judge.p(Design(5, 1.0, 2.5, 0.9)) == -np.inf
    assert np.isfinite(judge.p(PAPER_OPTIMUM))
    assert design_at(np.array([4.6, 0.7, 0.6, 0.5, 0.7])) == Design(5, 0.7, 0.6, 0.5, "inner")


def test_the_search_is_no_worse_than_where_it_starts() -> None:
    """Cut short it still returns a design as good as the grid's best, and says that it was cut short."""
    seen: list[float] = []
    found = optimise(
        Waveguide(), default_curves(), rays=40, seconds=3.0, progress=lambda done, total: seen.append(done)
    )
    assert found.best_p >= found.start_p
    assert optimum_json(found)["gain"] >= 1
    assert "gain" in optimum_text(found)
    assert seen
    with pytest.raises(RequestError):
        optimise(Waveguide(), default_curves(), seconds=0)
