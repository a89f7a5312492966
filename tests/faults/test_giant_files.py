"""Giant files and values: refused with a cause, in bounded memory."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import meshio
import numpy as np
import pytest

from analysis.data.csv_import import import_csv
from analysis.shadow.fem import mesh_files
from analysis.shadow.fem.mesh_files import read_mesh
from protocol.base.errors import FileError
from tests.faults.drill import ROOT
from tests.faults.forged_sqlite import shared_pages
from tests.faults.old_recordings import write_recording
from tests.faults.seeds import seeds

READERS = """
import resource, sys
from pathlib import Path
from analysis.data.csv_import import load_profile as load_map
from analysis.data.csv_import import import_csv
from analysis.segmentation.plateau_readings import read_elongation_file
from analysis.optics.scene.curve_file import read_curves
from analysis.data.load import load_recording
from analysis.reports.build import write_report
from analysis.shadow.fem.mesh_files import read_mesh
from analysis.shadow.fem.parameters import read_parameters
from boat_daq.engine.plan import load_plan
from protocol.recording.elongation_file import read_elongation_rows
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.settings import UnitLibrary, load_settings
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.text.profile import load_profile
pages = int(Path("/proc/self/statm").read_text().split()[0])
limit = pages * resource.getpagesize() + (300 << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
folder = Path(sys.argv[1])
readers = {
    "line.csv": (import_csv, read_elongation_file, read_elongation_rows, read_curves),
    "columns.csv": (import_csv, read_elongation_file),
    "rows.csv": (read_curves,),
    "map.json": (load_map,), "plan.toml": (lambda p: load_plan(str(p)), load_profile, read_parameters),
    "settings.toml": (lambda p: load_settings(p.parent),), "SA1.toml": (lambda p: UnitLibrary(p.parent).load("SA1"),),
    "mesh.vtu": (read_mesh,), "mesh.msh": (read_mesh,), "run.boat": (load_recording,),
    "shared.boat": (load_recording, verify_recording),
    "text.boat": (load_recording, verify_recording, summarise, recover),
}
for name, functions in readers.items():
    for read in functions:
        try:
            read(folder / name)
            print("TAKEN", name, read)
        except Exception as error:
            if not getattr(error, "cause", ""):
                print("TRACEBACK", name, read, repr(error)[:200])
recovery = recover(folder / "shared.boat")
if recovery.status != "salvaged" or recovery.path.stat().st_size > 2 * (folder / "shared.boat").stat().st_size:
    print("SALVAGED", recovery)
"""


def hollow(path: Path, head: bytes) -> None:
    """Write a sparse file of 1 GB: `head`, then a hole."""
    with path.open("wb") as file:
        file.write(head)
        file.truncate(1 << 30)


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS and holes in files are Linux's")
@pytest.mark.fault(52, how="a recording of 4 MB that claims 4 GB, and one whose note is 40 MB of JSON", times=8)
@pytest.mark.fault(52, how="files of 1 GB without a line's end, and a million columns, with 300 MB of memory", times=16)
def test_giant_files_are_refused_in_bounded_memory(tmp_path: Path) -> None:
    """Every kind of file that the program reads is refused with a cause, within 300 MB beyond the program itself."""
    hollow(tmp_path / "line.csv", b"1,2,3," * 400_000)
    (tmp_path / "columns.csv").write_bytes(b"a," * 1_000_000 + b"\n" + b"1," * 1_000_000 + b"\n")
    hollow(tmp_path / "rows.csv", b"x,z\n" + b"1,2\n" * 1000)
    for name in ("map.json", "plan.toml", "settings.toml", "SA1.toml", "mesh.vtu", "mesh.msh"):
        hollow(tmp_path / name, b"x = 1\n")
    hollow(tmp_path / "run.boat", b"SQLite format 3\0")
    shared_pages(write_recording(tmp_path / "shared.boat"), rows=1000)
    with closing(sqlite3.connect(write_recording(tmp_path / "text.boat"))) as db:
        db.execute("UPDATE session SET value = ? WHERE key = 'note'", (f"[{'{},' * 13_000_000}0]",))
        db.commit()
    done = subprocess.run(
        [sys.executable, "-c", READERS, str(tmp_path)], capture_output=True, text=True, cwd=ROOT, timeout=200
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout == ""


@pytest.mark.fault(52, how="a mesh whose compressed arrays expand beyond all bounds", times=1)
def test_mesh_that_expands_too_far_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """2 MB of zeros that were compressed took 1.9 GB; what the header says of their size is not believed."""
    meshio.write(path := tmp_path / "mesh.vtu", meshio.Mesh(np.zeros((1000, 3)), [("line", np.array([[0, 1]]))]))
    with pytest.raises(FileError, match="does not mark which cells"):  # it was read
        read_mesh(path)
    monkeypatch.setattr(mesh_files._Vtu, "_left", 1000)
    with pytest.raises(FileError, match="is not a mesh that can be read"):
        read_mesh(path)


def test_mesh_with_a_distant_point_is_refused(tmp_path: Path) -> None:
    """Its element areas would not be finite."""
    (path := tmp_path / "mesh.vtu").write_bytes(seeds("mesh")[0])
    assert len(read_mesh(path).nodes)
    found = meshio.read(path)
    found.points[5, 0] = 1e200
    meshio.write(path, found)
    with pytest.raises(FileError, match="not finite, or beyond"):
        read_mesh(path)


def test_unclosed_quote_is_one_text(tmp_path: Path) -> None:
    """A cell beyond the standard library's 131,072 characters, in a row, a header and a comment: no traceback."""
    long = '"' + "4," * 70_000
    good = "time_s,pressure_kpa,s1_mv\n0,1,2\n1,2,3\n2,3,4\n"
    (tmp_path / "row.csv").write_text(good + f"3,4,{long}", encoding="utf-8")
    assert import_csv(tmp_path / "row.csv").n == 3
    (tmp_path / "comment.csv").write_text(f'"# {"4;" * 70_000}\n{good}', encoding="utf-8")
    assert import_csv(tmp_path / "comment.csv").n == 3
    (tmp_path / "header.csv").write_text(long, encoding="utf-8")
    with pytest.raises(FileError, match="no rows of numbers"):
        import_csv(tmp_path / "header.csv")
