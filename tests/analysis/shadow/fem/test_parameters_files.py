"""Parameters from TOML files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from analysis.shadow.fem.parameters import ActuatorParameters, read_parameters
from protocol.base.errors import FileError, RequestError


@pytest.mark.fault(53, how="an actuator's parameters with a misspelt name, and no TOML", times=2)
def test_parameter_files(tmp_path: Path) -> None:
    """A file changes what it names; a misspelt name is refused with the right one; no TOML is refused."""
    path = tmp_path / "actuator.toml"
    path.write_text("cells = 4\nwall_mm = 1.9\n")
    assert read_parameters(path) == replace(ActuatorParameters(), cells=4, wall_mm=1.9)
    path.write_text("wall = 1.9\n")
    with pytest.raises(RequestError) as refusal:
        read_parameters(path)
    assert "wall" in refusal.value.remedy
    path.write_text("cells: 4")
    with pytest.raises(FileError):
        read_parameters(path)
    with pytest.raises(FileError):
        read_parameters(tmp_path / "none.toml")
