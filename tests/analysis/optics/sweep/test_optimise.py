"""The search beyond the grid."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.errors import RequestError
from analysis.optics.scene.curves import default_curves
from analysis.optics.scene.parameters import PAPER_OPTIMUM, By, Design, Waveguide, light_by
from analysis.optics.sweep.optimise import DesignMerit, design_at, optimise
from analysis.optics.sweep.report import optimum_json, optimum_text


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
