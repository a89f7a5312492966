"""Contributions of a reference: from the unit's file or a rig's, refused by key."""

from __future__ import annotations

from pathlib import Path

import pytest

from analysis.errors import RequestError
from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.reference import stated_contributions

SCALE = {"scale": {"u_percent": 0.1, "certificate": "DKD 4711"}}


def test_rig_counts_before_the_unit(tmp_path: Path) -> None:
    """Nothing without a file; the unit's; the rig's in its place."""
    assert stated_contributions("ref-none") == stated_contributions("") == ()
    UnitLibrary().save(Unit("ref-unit", type_b=SCALE))
    assert [one.certificate for one in stated_contributions("ref-unit")] == ["DKD 4711"]
    rig = tmp_path / "rig.toml"
    rig.write_text("[type_b.parallax]\nhalf_width_mm = 0.1\ndistribution = 'rectangular'\n")
    assert [one.name for one in stated_contributions("ref-unit", rig)] == ["parallax"]


def test_wrong_file_is_refused_with_its_key(tmp_path: Path) -> None:
    """A rig without contributions, and a unit whose contribution has no distribution."""
    rig = tmp_path / "rig.toml"
    rig.write_text("name = 'bench 2'\n")
    with pytest.raises(OperatorError, match="'type_b' is missing"):
        stated_contributions("", rig)
    UnitLibrary().save(Unit("ref-bad", type_b={"parallax": {"half_width_mm": 0.1}}))
    with pytest.raises(RequestError, match=r"type_b\.parallax: 'distribution'"):
        stated_contributions("ref-bad")
