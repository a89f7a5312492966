"""The study of what determines the ranking."""

from __future__ import annotations

import pytest

from analysis.optics.scene.parameters import Light, Waveguide
from analysis.optics.sweep.sweep import paper_grid
from tests.analysis.optics.sweep.ranking_study import cases, draw_convergence, study


def test_a_study_compares_its_cases(tmp_path: object) -> None:
    """Each case has its best, its ties, and the paper's rank; more rays scatter less; the first is like itself."""
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
    found = study(chosen[:3], paper_grid((5,))[::60])
    assert found[0].rank_correlation == pytest.approx(1.0)
    assert found[1].noise < found[0].noise
    assert all(1 <= case.paper_rank <= 5 for case in found)
    assert len(draw_convergence(found).axes) == 3
