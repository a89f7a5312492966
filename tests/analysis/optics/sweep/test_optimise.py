"""The search beyond the grid."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.errors import RequestError
from analysis.optics.scene.curves import default_curves
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Waveguide
from analysis.optics.sweep.optimise import PowerMerit, design_at, optimise
from analysis.optics.sweep.report import optimum_json, optimum_text


def test_power_merit_refuses_nothing_and_ranks_what_fits() -> None:
    """A design that cannot be built has P = -inf, one that can has a finite one."""
    from analysis.optics.scene.curves import frames_of

    merit = PowerMerit(frames_of(default_curves(), Waveguide()), Waveguide(), 50)
    assert merit.p(Design(5, 1.0, 2.5, 0.9)) == -np.inf
    assert np.isfinite(merit.p(PAPER_OPTIMUM))
    assert design_at(np.array([4.6, 0.7, 0.6, 0.5, 0.7])) == Design(5, 0.7, 0.6, 0.5, "inner")


def test_the_search_is_no_worse_than_where_it_starts() -> None:
    """Cut short it still returns a design as good as the grid's best, and reports that it was stopped."""
    seen: list[float] = []
    found = optimise(
        Waveguide(), default_curves(), rays=40, seconds=1.0, progress=lambda done, total: seen.append(done)
    )
    assert found.best.p >= found.start.p
    assert optimum_json(found)["gain"] >= 1
    assert "gain" in optimum_text(found)
    assert seen
    with pytest.raises(RequestError):
        optimise(Waveguide(), default_curves(), seconds=0)
