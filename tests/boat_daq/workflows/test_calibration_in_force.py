"""What the file of a unit or of a rig states: contributions to the uncertainty, refused by key, and a curve."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.workflows.calibration_in_force import chosen_curve, stated_contributions
from protocol.base.errors import RequestError

SCALE = {"scale": {"u_percent": 0.1, "certificate": "DKD 4711"}}


def run_of(unit: str, *, simulated: bool = False) -> SimpleNamespace:
    """What of a recording names its unit."""
    return SimpleNamespace(unit=unit, simulated=simulated, identity="a")


def test_rig_counts_before_the_unit(tmp_path: Path) -> None:
    """Nothing without a file; the unit's; the rig's in its place."""
    assert stated_contributions(run_of("ref-none")) == stated_contributions(run_of("")) == ()
    UnitLibrary().save(Unit("ref-unit", type_b=SCALE))
    assert [one.certificate for one in stated_contributions(run_of("ref-unit"))] == ["DKD 4711"]
    rig = tmp_path / "rig.toml"
    rig.write_text("[type_b.parallax]\nhalf_width_mm = 0.1\ndistribution = 'rectangular'\n")
    assert [one.name for one in stated_contributions(run_of("ref-unit"), rig)] == ["parallax"]


def test_curve_is_the_chosen_one_or_that_of_the_accepted_calibration() -> None:
    """The choice; without one the curve accepted last with this recording, of its kind of board; else the usual one."""
    sensor = {"sensors": [], "simulated": True}
    library = UnitLibrary(simulated=True)
    for uuid, curve in (("a", "4"), ("a", "auto"), ("b", "2")):
        library.add_calibration("ref-curve", sensor | {"curve": curve, "recording_id": uuid})
    simulated = run_of("ref-curve", simulated=True)
    assert (chosen_curve(simulated, "spline"), chosen_curve(simulated)) == ("spline", "auto")
    assert chosen_curve(run_of("ref-curve")) == chosen_curve(run_of("")) == 3
    with pytest.raises(RequestError, match="not a curve"):
        chosen_curve(simulated, "7")


def test_wrong_file_is_refused_with_its_key(tmp_path: Path) -> None:
    """A rig without contributions, and a unit whose contribution has no distribution."""
    rig = tmp_path / "rig.toml"
    rig.write_text("name = 'bench 2'\n")
    with pytest.raises(RequestError, match="'type_b' is missing"):
        stated_contributions(run_of(""), rig)
    UnitLibrary().save(Unit("ref-bad", type_b={"parallax": {"half_width_mm": 0.1}}))
    with pytest.raises(RequestError, match=r"type_b\.parallax: 'distribution'"):
        stated_contributions(run_of("ref-bad"))
