"""Studies by name; no point of any map is wrong without warning."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.maps import STUDIES, chosen_studies
from analysis.studies.failure_maps.sweep import CellOutcome, sweep
from protocol.base.errors import RequestError


def test_studies_are_chosen_by_method_or_map() -> None:
    """Unknown names are refused with the known ones."""
    assert chosen_studies([]) == list(STUDIES.values())
    assert {s.method for s in chosen_studies(["inverse"])} == {"inverse"}
    assert [s.name for s in chosen_studies(["fit-offset"])] == ["fit-offset"]
    with pytest.raises(RequestError, match="'fitt'"):
        chosen_studies(["fitt"])


@pytest.mark.nightly
@pytest.mark.parametrize("name", list(STUDIES))
def test_no_point_of_a_map_is_wrong_without_warning(name: str) -> None:
    """The whole map: no number is wrong without warning, and the method works somewhere."""
    drawn = sweep(STUDIES[name])
    assert [(c.x, c.y, c.error) for c in drawn.found(CellOutcome.WRONG_UNWARNED)] == []
    assert drawn.found(CellOutcome.WORKS)
