"""The study of what determines the ranking."""

from __future__ import annotations

from itertools import islice

import pytest

from analysis.optics.sweep.sweep import SweepRequest, paper_grid
from tests.analysis.optics.sweep.ranking_study import cases, draw_convergence, study


def test_a_study_compares_its_cases(tmp_path: object) -> None:
    """Each case has its best, its ties, and the paper's rank; more rays scatter less; the first is like itself."""
    chosen = cases(SweepRequest(tuple(paper_grid((5,))[::60])), rays=(250, 1000))
    assert list(chosen) == [
        "250 rays",
        "1000 rays",
        "1000 rays, secondaries in proportion",
        "1000 rays, no secondaries",
        "1000 rays, by power",
        "order bounce",
        "order index",
        "index 1.48",
        "index 1.52",
        "thickness 1.5 mm",
        "thickness 2.5 mm",
    ]
    found = list(study(dict(islice(chosen.items(), 3))))
    assert found[0].rank_correlation == pytest.approx(1.0)
    assert found[1].noise < found[0].noise
    assert all(1 <= case.paper_rank <= 5 for case in found)
    assert len(draw_convergence(found).axes) == 3
