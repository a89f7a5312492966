"""Pipes and devices in the place of files: refused at once, with a cause."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from analysis.data.csv_import import import_csv
from analysis.data.csv_import import load_profile as load_map
from analysis.data.load import load_recording
from analysis.optics.scene.curve_file import read_curves
from analysis.optics.scene.scene_file import read_scene
from analysis.segmentation.plateau_readings import read_elongation_file
from analysis.shadow.fem.mesh_files import read_mesh
from analysis.shadow.fem.parameters import read_parameters
from boat_daq.engine.plan import load_plan
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.settings import UnitLibrary, load_settings
from protocol.base.errors import FileError
from protocol.recording.elongation_file import read_elongation_rows
from protocol.text.profile import load_profile

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="FIFOs and /dev/zero are Unix's")

READERS: dict[str, tuple[Callable[[Path], object], ...]] = {
    "run.csv": (import_csv, load_recording, read_elongation_file, read_elongation_rows, read_curves),
    "run.boat": (load_recording, summarise, recover, verify_recording),
    "plan.toml": (lambda path: load_plan(str(path)), read_parameters, read_scene),
    "settings.toml": (lambda path: load_settings(path.parent),),
    "SA1.toml": (lambda path: UnitLibrary(path.parent).load("SA1"),),
    "map.json": (load_map,),
    "profile.toml": (load_profile,),
    "mesh.vtu": (read_mesh,),
}


@pytest.mark.fault(52, how="a pipe without a writer, and an endless device, in the place of every input file", times=16)
@pytest.mark.parametrize("kind", ["pipe", "device"])
@pytest.mark.parametrize("name", READERS)
@pytest.mark.timeout(20)
def test_pipe_and_device_are_refused_at_once(tmp_path: Path, name: str, kind: str) -> None:
    """No reader waits for a writer, and none reads a device."""
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    for read in READERS[name]:
        with pytest.raises(Exception) as refusal:  # each package has its own family
            read(path)
        assert getattr(refusal.value, "cause", ""), refusal.value


def test_many_lines_that_do_not_fit_are_not_all_read(tmp_path: Path) -> None:
    """An unclosed quotation of a million lines: refused after 10,000 of them."""
    good = "time_s,pressure_kpa,s1_mv\n" + "".join(f"{i},{i % 50},{1500 + i % 9}\n" for i in range(200))
    (path := tmp_path / "run.csv").write_text(good + '"' + "abc,1\n" * 1_000_000, encoding="utf-8")
    with pytest.raises(FileError, match="10001 rows do not fit"):
        import_csv(path)


def test_curves_of_many_lines_are_refused(tmp_path: Path) -> None:
    """Sixteen megabytes of blank lines took 5.7 GB and more than a minute."""
    (path := tmp_path / "curves.csv").write_text("x,z\n" + "\n" * 400_000, encoding="utf-8")
    with pytest.raises(FileError, match="more than 400000 lines"):
        read_curves(path)


def test_many_states_of_curves_are_counted_first(tmp_path: Path) -> None:
    """20,000 states, which took memory with the square of their number."""
    rows = "".join(f"{n},1,2\n" for n in range(20_000))
    (path := tmp_path / "curves.csv").write_text("state,x,z\n" + rows, encoding="utf-8")
    with pytest.raises(FileError, match="holds 20000 states"):
        read_curves(path)
