"""Names of recordings from a template."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest

from boat_daq.engine.file_names import named
from protocol.base.errors import RequestError

NOW = datetime(2026, 11, 23, 9, 5, 7)


def test_fields_are_filled_and_numbers_are_free(tmp_path: Path) -> None:
    given = {"unit": "SA1", "plan": "calibration", "operator": "A/B"}
    assert named("{unit}_{date}_{time}", tmp_path, NOW, **given).name == "SA1_2026-11-23_090507.boat"
    first = named("{operator}_{plan}_{number}", tmp_path, NOW, **given)
    assert first.name == "A-B_calibration_001.boat"
    first.touch()
    assert named("{operator}_{plan}_{number}.boat", tmp_path, NOW, **given).name == "A-B_calibration_002.boat"
    assert named("{unit}_{plan}", tmp_path, NOW, plan="x").name == "x.boat"
    (tmp_path / "x.boat").touch()  # a second run was refused at its start
    assert named("{plan}", tmp_path, NOW, plan="x").name == "x_002.boat"


@pytest.mark.parametrize("template", ["{user}", "{unit", "", "{unit}", "../{plan}", "{unit!r}", "{0}", "{unit.x}"])
def test_other_templates_are_refused(tmp_path: Path, template: str) -> None:
    with pytest.raises(RequestError):
        named(template, tmp_path, NOW, plan="p")
