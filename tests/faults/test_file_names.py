"""Names that lead out of a folder: refused where a name is required, used where a path is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from boat_daq.commands.demo import free_name
from boat_daq.commands.record import dated_name
from boat_daq.engine.file_names import path_in
from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.viewmodels.app_model import AppModel
from protocol.base.errors import RequestError
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import Source
from tests.boat_daq.gui.recorded_session import RecordedSession, connected

PATHS = ["../x", "FOLDER/x", "a/../../x", "~/x", "\\\\host\\x", "C:x", "x\0y"]
NO_NAMES = ["", ".", "..", "NUL", "con.x"]


def record_in_window(folder: Path, unit: str) -> None:
    """Record with a unit of that name, as the window's button does."""
    session, units = RecordedSession(connected()), UnitLibrary(folder / "units")
    model = AppModel(session, folder / "config", folder / "recordings", units)
    model.connection.set_unit(unit)
    model.run.record()


WRITERS: dict[str, Callable[[Path, str], object]] = {
    "load a unit": lambda folder, name: UnitLibrary(folder).load(name),
    "store a unit": lambda folder, name: UnitLibrary(folder).save(Unit(name)),
    "add a calibration": lambda folder, name: UnitLibrary(folder).add_calibration(name, {"degree": 3}),
    "any file": path_in,
    "record in the window": record_in_window,
    "record on the command line": lambda _, name: dated_name(name),
    "demo": lambda folder, name: free_name(folder, f"demo_{name}"),
}
FROM_NAME_ALONE = ["load a unit", "store a unit", "add a calibration", "any file"]


@pytest.mark.fault(51, how="names of units and recordings that lead out of their folder", times=49)
@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("writer", WRITERS)
def test_name_that_leaves_its_folder_is_refused(tmp_path: Path, writer: str, name: str) -> None:
    """Before anything is written, inside or outside; the window stores its choices as ever."""
    folder = tmp_path / "inner"
    folder.mkdir()
    with pytest.raises(RequestError):
        WRITERS[writer](folder, name.replace("FOLDER", str(tmp_path)))
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} <= {"window.json"}


@pytest.mark.fault(51, how="names that are no file names, or devices of Windows", times=20)
@pytest.mark.parametrize("name", NO_NAMES)
@pytest.mark.parametrize("writer", FROM_NAME_ALONE)
def test_name_of_no_file_is_refused(tmp_path: Path, writer: str, name: str) -> None:
    """The folder itself, its parent, a device; nothing is written."""
    with pytest.raises(RequestError):
        WRITERS[writer](tmp_path, name)
    assert list(tmp_path.iterdir()) == []


def test_path_is_used_wherever_it_leads(tmp_path: Path) -> None:
    """A recording's path is the operator's: absolute, or up and down again."""
    (tmp_path / "inner").mkdir()
    for path in (tmp_path / "absolute.boat", tmp_path / "inner" / ".." / "up.boat"):
        RecordingFile.create(path, meta_of(Source().link)).abandon()
    assert {path.name for path in tmp_path.glob("*.boat")} == {"absolute.boat", "up.boat"}


@pytest.mark.fault(51, how="a link in the place of a new recording", times=1)
def test_link_in_place_of_a_recording_is_not_followed_by_writes(tmp_path: Path) -> None:
    """A new recording never opens what is there already, a dangling link included."""
    (tmp_path / "run.boat").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RequestError, match="exists already"):
        RecordingFile.create(tmp_path / "run.boat", meta_of(Source().link))
    assert not (tmp_path / "elsewhere").exists()
