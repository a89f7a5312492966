"""Names that lead elsewhere: nothing is written outside the target."""

from __future__ import annotations

from pathlib import Path

import pytest

from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.settings import UnitLibrary
from boat_daq.errors import OperatorError
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import Source
from tests.faults.decoders import REFUSALS


@pytest.mark.fault(51, how="recordings and units with names that lead out of their folder", times=10)
@pytest.mark.parametrize("name", ["../x", "..", "/etc/x", "a/../../x", "~/x", "\\\\host\\x", "C:x", "x\0y", ".", ""])
def test_nothing_is_written_outside(tmp_path: Path, name: str) -> None:
    """Refused by name; no file appears anywhere."""
    inner = tmp_path / "inner"
    inner.mkdir()
    library = UnitLibrary(inner / "units")
    with pytest.raises(OperatorError):
        library.load(name)
    with pytest.raises((*REFUSALS, ValueError)):
        RecordingFile.create(inner / f"run_{name}.boat" / f"{name}.boat", meta_of(Source().link))
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.fault(51, how="a link in the place of a new recording", times=1)
def test_a_link_is_not_written_through(tmp_path: Path) -> None:
    """A new recording never opens what is there already, a dangling link included."""
    (tmp_path / "run.boat").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OperatorError, match="exists already"):
        RecordingFile.create(tmp_path / "run.boat", meta_of(Source().link))
    assert not (tmp_path / "elsewhere").exists()
