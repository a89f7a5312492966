"""Malicious and broken files: refused or neutralised, in bounded memory, and nothing written outside the target."""

from __future__ import annotations

import ast
import csv
import io
import pickle
import shutil
import sqlite3
import struct
import subprocess
import sys
import zlib
from contextlib import closing
from functools import cache
from pathlib import Path

import meshio
import numpy as np
import pytest

from analysis import Options, analyse
from analysis.batch import write_table
from analysis.boat_writer import write_boat_file
from analysis.cluster import check_scheduler
from analysis.csv_import import import_csv
from analysis.errors import FileError, RequestError
from analysis.export import neutral
from analysis.optics.sweep_file import SweepFile
from analysis.recording import load_recording
from analysis.reports.writing import write_report
from analysis.shadow.mesh_files import read_mesh
from analysis.shadow.table import read_table
from boat_daq.engine.board_carriers import TcpCarrier
from boat_daq.engine.recording_file import RecordingFile
from boat_daq.engine.recovery import find_interrupted, recover
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.transports import open_transport
from boat_daq.engine.upgrade import upgrade
from boat_daq.errors import DeviceError, OperatorError
from protocol.errors import RecordingError
from tests.boat_daq.board_link import meta_of
from tests.boat_daq.recording_source import Source
from tests.faults.decoders import REFUSALS
from tests.faults.drill import ROOT
from tests.faults.old_recordings import write_recording
from tests.faults.seeds import seeds

PRODUCT = [path for room in ("protocol", "analysis", "boat_daq") for path in sorted((ROOT / room).rglob("*.py"))]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("sound") / "run.boat")


# ---- recordings that somebody made -----------------------------------------------------------------------------------

ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x AS key, x AS value FROM n"
FORGED = {
    "a view in a table's place": ["DROP TABLE session", f"CREATE VIEW session AS {ENDLESS}"],
    "a view that never ends": ["DROP TABLE block", f"CREATE VIEW block AS {ENDLESS}"],
    "a trigger": ["CREATE TRIGGER t AFTER INSERT ON reading BEGIN DELETE FROM chunk; END"],
    "a virtual table": ["CREATE VIRTUAL TABLE found USING fts5(x)"],
    "a generated column": [
        "ALTER TABLE block RENAME TO kept",
        "CREATE TABLE block (id INTEGER PRIMARY KEY, segment INTEGER, last_chunk INTEGER, n INTEGER,"
        " first_time_us INTEGER, last_time_us INTEGER, crc32 INTEGER, samples BLOB AS (zeroblob(900000000)))",
    ],
    "text for numbers": ["UPDATE block SET n = 'many'"],
    "a number for bytes": ["UPDATE block SET samples = 7"],
    "times beyond any measure": ["UPDATE event SET host_ns = 9223372036854775807"],
    "an infinite figure": ["UPDATE step SET target_kpa = 9e999"],
    "samples that are objects": ["""UPDATE session SET value = '[["index","|O",[]]]' WHERE key = 'sample_dtype'"""],
    "samples without a time": ["""UPDATE session SET value = '[["index","<u4",[]]]' WHERE key = 'sample_dtype'"""],
    "a year that no calendar has": ["UPDATE session SET value = '\"99999-01-01\"' WHERE key = 'started_utc'"],
    "a converter of 10^9 bits": ["UPDATE session SET value = '1000000000' WHERE key = 'adc_bits'"],
    "nested JSON": [f"UPDATE session SET value = '{'[' * 50_000}' WHERE key = 'note'"],
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(FORGED))
def test_a_forged_recording_is_refused_everywhere(sound: Path, tmp_path: Path, name: str) -> None:
    """Refused in words by whoever opens it, without running what it holds, and left as it is."""
    path = tmp_path / "run.boat"
    shutil.copy(sound, path)
    with closing(sqlite3.connect(path)) as db:
        for statement in FORGED[name]:
            db.execute(statement)
        db.commit()
    content = path.read_bytes()
    with pytest.raises(REFUSALS):
        load_recording(path)
    for read in (RecordingFile.reopen, upgrade):
        try:
            found = read(path)  # type: ignore[operator]
        except REFUSALS:
            continue
        if isinstance(found, RecordingFile):
            found.abandon()
    assert find_interrupted(tmp_path) == []
    try:
        recovery = recover(path)
    except REFUSALS as refusal:
        assert refusal.cause
    else:
        assert recovery.damaged or recovery.status == "closed"
    assert path.read_bytes() == content


def test_pages_that_lead_back_to_themselves_end(sound: Path, tmp_path: Path) -> None:
    """A forged tree in which a page is its own child, many times over: given up, not followed for ever."""
    content = bytearray(sound.read_bytes())
    with closing(sqlite3.connect(sound)) as db:
        pages = dict(db.execute("SELECT name, rootpage FROM sqlite_schema WHERE type = 'table'"))
    root = pages["event"]
    at = (root - 1) * 4096
    cells = 300
    page = bytearray(4096)
    page[:12] = struct.pack(">BHHHBI", 5, 0, cells, 4096 - 8 * cells, 0, root)
    for cell in range(cells):
        where = 4096 - 8 * (cell + 1)
        page[12 + 2 * cell : 14 + 2 * cell] = struct.pack(">H", where)
        page[where : where + 5] = struct.pack(">IB", root, cell % 127 + 1)
    content[at : at + 4096] = page
    path = tmp_path / "run.boat"
    path.write_bytes(content)
    with pytest.raises(REFUSALS):
        load_recording(path)
    recovery = recover(path)
    assert recovery.status == "salvaged"
    assert any("event" in text for text in recovery.damaged)
    assert recovery.samples > 50


def test_a_sweep_with_a_view_in_it_is_refused(tmp_path: Path) -> None:
    """The other kind of SQLite file that the program opens."""
    SweepFile(tmp_path / "sweep.sqlite", {"rays": 1})
    with closing(sqlite3.connect(tmp_path / "sweep.sqlite")) as db:
        db.execute("CREATE VIEW v AS SELECT 1")
    with pytest.raises(REFUSALS, match="runs when read"):
        SweepFile(tmp_path / "sweep.sqlite", {"rays": 1})


@cache
def sources() -> list[tuple[Path, str]]:
    """The product's files and what stands in them."""
    return [(path, path.read_text(encoding="utf-8")) for path in PRODUCT]


def functions_that(calls: str) -> list[tuple[Path, str]]:
    """Every function of the product, with its source, that has that call in it."""
    trees = [(path, ast.parse(source)) for path, source in sources() if calls in source]
    functions = [(path, node) for path, tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return [(path, ast.unparse(node)) for path, node in functions if calls in ast.unparse(node)]


def test_no_database_is_opened_unguarded() -> None:
    """Whatever opens SQLite hardens the connection at once, or opens what it has just made itself."""
    found = functions_that("sqlite3.connect(")
    assert len(found) >= 7
    for path, source in found:
        own = "':memory:'" in source or "unfinished" in source
        assert own or "harden(" in source or "trusted_schema=off" in source, path


@pytest.mark.parametrize("time_s", ["1e31", "-1e13"])
def test_a_time_that_no_clock_reaches_is_refused_and_leaves_no_file(tmp_path: Path, time_s: str) -> None:
    """More microseconds than 64 bits hold would wrap round into some other time."""
    path = tmp_path / "table.csv"
    first, second = sorted(["0", time_s], key=float)
    path.write_text(f"time_s,pressure_kpa,s1_mv\n{first},1,2\n{second},3,4\n", encoding="utf-8")
    with pytest.raises(FileError, match="cannot be recorded"):
        write_boat_file(tmp_path / "run.boat", import_csv(path), original=path)
    assert list(tmp_path.iterdir()) == [path]


def test_a_mesh_with_a_point_far_away_is_refused(tmp_path: Path) -> None:
    """Its areas would not be finite."""
    (path := tmp_path / "mesh.vtu").write_bytes(seeds("mesh")[0])
    assert len(read_mesh(path).nodes)
    found = meshio.read(path)
    found.points[5, 0] = 1e200
    meshio.write(path, found)
    with pytest.raises(FileError, match="nowhere"):
        read_mesh(path)


def test_sql_has_parameters_and_the_linter_holds_it() -> None:
    """S608 is on; where it is waived the line puts in names of columns and tables, never a value."""
    import tomllib

    ruff = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ruff"]["lint"]
    assert "S" in ruff["select"]
    assert not {"S", "S6", "S608"} & set(ruff["ignore"])
    waived = [line for _, source in sources() for line in source.splitlines() if "S608" in line]
    assert waived
    assert all("VALUES ('" not in line and "= '{" not in line for line in waived)


# ---- sizes -----------------------------------------------------------------------------------------------------------

READERS = """
import resource, sys
from pathlib import Path
from analysis.csv_columns import load_profile as load_map
from analysis.csv_import import import_csv
from analysis.elongation import read_elongation_file
from analysis.optics.curve_file import read_curves
from analysis.recording import load_recording
from analysis.reports.writing import write_report
from analysis.shadow.mesh_files import read_mesh
from analysis.shadow.parameter_files import read_parameters
from boat_daq.engine.plan import load_plan
from boat_daq.engine.readings import read_elongation_csv
from boat_daq.engine.settings import UnitLibrary, load_settings
from protocol.profile_file import load_profile
pages = int(Path("/proc/self/statm").read_text().split()[0])
limit = pages * resource.getpagesize() + (300 << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
folder = Path(sys.argv[1])
readers = {
    "line.csv": (import_csv, read_elongation_file, read_elongation_csv, read_curves),
    "columns.csv": (import_csv, read_elongation_file),
    "rows.csv": (read_curves,),
    "map.json": (load_map,), "plan.toml": (lambda p: load_plan(str(p)), load_profile, read_parameters),
    "settings.toml": (lambda p: load_settings(p.parent),), "SA1.toml": (lambda p: UnitLibrary(p.parent).load("SA1"),),
    "mesh.vtu": (read_mesh,), "mesh.msh": (read_mesh,), "run.boat": (load_recording,),
}
for name, doors in readers.items():
    for door in doors:
        try:
            door(folder / name)
            print("TAKEN", name, door)
        except Exception as error:
            if not getattr(error, "cause", ""):
                print("TRACEBACK", name, door, repr(error)[:200])
"""


def hollow(path: Path, head: bytes) -> None:
    """A file of 1 GB that takes no room: `head`, and then a hole."""
    with path.open("wb") as file:
        file.write(head)
        file.truncate(1 << 30)


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS and holes in files are Linux's")
@pytest.mark.fault(52, how="files of 1 GB without a line's end, and a million columns, with 300 MB of memory", times=16)
def test_giant_files_are_refused_in_bounded_memory(tmp_path: Path) -> None:
    """Every kind of file that the program reads: refused in words, with 300 MB beyond what the program itself takes."""
    hollow(tmp_path / "line.csv", b"1,2,3," * 400_000)
    (tmp_path / "columns.csv").write_bytes(b"a," * 1_000_000 + b"\n" + b"1," * 1_000_000 + b"\n")
    hollow(tmp_path / "rows.csv", b"x,z\n" + b"1,2\n" * 1000)
    for name in ("map.json", "plan.toml", "settings.toml", "SA1.toml", "mesh.vtu", "mesh.msh"):
        hollow(tmp_path / name, b"x = 1\n")
    hollow(tmp_path / "run.boat", b"SQLite format 3\0")
    done = subprocess.run(
        [sys.executable, "-c", READERS, str(tmp_path)], capture_output=True, text=True, cwd=ROOT, timeout=200
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout == ""


# ---- text that something would run -----------------------------------------------------------------------------------


@pytest.mark.fault(49, how="cells that begin with = + - @ TAB and CR, in a table written for a spreadsheet", times=6)
@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r"])
def test_no_cell_of_a_table_is_a_formula(tmp_path: Path, start: str) -> None:
    """Text gets an apostrophe; numbers, negative ones too, stay numbers."""
    import pandas as pd

    text = start + 'cmd|" /C calc"!A0'
    assert neutral(text) == "'" + text
    write_table(pd.DataFrame({"unit": [text], "drift": [-1.5]}), tmp_path / "table.csv")
    rows = list(csv.reader(io.StringIO((tmp_path / "table.csv").read_bytes().decode("utf-8-sig"))))
    assert rows[1][0].startswith("'")
    assert float(rows[1][1]) == -1.5


class Bomb:
    """Unpickling it would leave a file."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str, str]]:
        return open, (self.path, "w")


@pytest.mark.fault(50, how="a pickle in an array file, where a cached table is read", times=1)
def test_a_pickle_is_never_opened(tmp_path: Path) -> None:
    """An array of objects in the cache of the shadow: not read, not run; the table is built anew."""
    mark = tmp_path / "exploded"
    np.savez(tmp_path / "table.npz", nodes=np.array([Bomb(str(mark))], dtype=object))
    assert read_table(tmp_path / "table.npz") is None
    (tmp_path / "raw.npz").write_bytes(pickle.dumps(Bomb(str(mark))))
    assert read_table(tmp_path / "raw.npz") is None
    assert not mark.exists()


@pytest.mark.fault(50, how="the whole program searched for what would unpickle, evaluate, or read YAML tags", times=1)
@pytest.mark.fault(51, how="the whole program searched for what would unpack an archive into files", times=1)
def test_nothing_evaluates_what_it_reads() -> None:
    """No pickle, YAML, eval or exec; arrays are loaded without objects, archives never unpacked into files."""
    forbidden = {"pickle", "marshal", "shelve", "yaml", "dill", "joblib", "cloudpickle", "tarfile"}
    for path, source in sources():
        for node in ast.walk(ast.parse(source)):
            names: set[str] = set()
            if isinstance(node, ast.Import):
                names = {alias.name.split(".")[0] for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                names = {(node.module or "").split(".")[0]}
            assert not names & forbidden, path
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert not called.endswith((".extractall", ".extract", "unpack_archive")), path
                assert called not in {"eval", "exec", "pd.read_pickle", "os.system"}, path
                if called in {"np.load", "numpy.load"}:
                    options = {key.arg: ast.unparse(key.value) for key in node.keywords}
                    assert options.get("allow_pickle") == "False", path


@pytest.mark.fault(
    48, how="markup in the header, the comments and the name of an imported table, up to its report", times=4
)
def test_a_tables_markup_is_text_in_its_report(tmp_path: Path) -> None:
    """A CSV from elsewhere: column names, operator, unit and note are words in the HTML, and nothing is loaded."""
    bad = "<script src='//x'>alert(1)</script>"
    rows = [f"{0.05 * n:g},{50 * np.cos(n / 60):.4f},{1600 + 200 * np.cos(n / 60):.3f}" for n in range(800)]
    head = [f"# {key}: {bad}" for key in ("operator", "unit", "note")]
    path = tmp_path / "a&<b>.csv"
    path.write_text("\n".join([*head, f"time_s,pressure_kpa,{bad} s1 [mV]", *rows]) + "\n", encoding="utf-8")
    run = load_recording(path, columns={"s1_mv": "3"})
    write_report([analyse(run, options=Options(mcmc=False))], tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script" not in html
    assert "&lt;script" in html
    assert "a&<b>" not in html


# ---- names that lead elsewhere ---------------------------------------------------------------------------------------


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


# ---- the network -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "address", ["tcp://10.0.0.7:8786", "scheduler.example:8786", "tls://192.0.2.1:1", "tcp://[::]:1"]
)
def test_a_scheduler_elsewhere_needs_a_word(address: str) -> None:
    """Loopback only, unless the user vouches for the network."""
    with pytest.raises(RequestError, match="not on this computer") as refusal:
        check_scheduler(address, allow_remote=False)
    assert "--allow-remote" in refusal.value.remedy
    check_scheduler(address, allow_remote=True)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "localhost:8786", "tcp://[::1]:8786", "inproc://a/b"])
def test_a_scheduler_here_needs_none(address: str) -> None:
    """This computer's own addresses."""
    check_scheduler(address, allow_remote=False)


def test_boards_are_here_by_default() -> None:
    """A host does not look elsewhere, and a virtual board does not listen elsewhere, without the word for it."""
    with pytest.raises(DeviceError, match="not this machine") as host:
        open_transport("socket://192.0.2.1:7777")
    with pytest.raises(OperatorError) as board:
        TcpCarrier("0.0.0.0:0")
    assert "--allow-remote" in host.value.remedy
    assert "--allow-remote" in board.value.remedy


@pytest.mark.parametrize("command", [["record"], ["board"], ["batch"], ["optics", "sweep"]])
def test_the_word_is_an_option(command: list[str]) -> None:
    """Each command that can leave this computer has it."""
    from typer.testing import CliRunner

    from boat_daq.cli import app

    shown = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "200"})
    assert "--allow-remote" in shown.stdout


# ---- pictures --------------------------------------------------------------------------------------------------------


def png(width: int, height: int, data: bytes) -> bytes:
    """A PNG that says it is so large, of 8-bit grey."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", data) + chunk(b"IEND", b"")


PICTURES = {
    "bomb.png": png(60_000, 60_000, zlib.compress(bytes(60_000_000), 9)),
    "truncated.png": png(100, 100, zlib.compress(bytes(101 * 100)))[:60],
    "giant.png": png(2**31 - 1, 2**31 - 1, b""),
    "text.png": b"this is no picture",
    "empty.jpg": b"",
    "markup.png": b"<svg xmlns='http://www.w3.org/2000/svg'><image href='file:///etc/passwd'/></svg>",
    "jpeg.jpg": b"\xff\xd8\xff\xe0" + bytes(100),
}


@pytest.mark.parametrize("name", sorted(PICTURES))
def test_what_is_no_picture_of_the_grid_is_refused(tmp_path: Path, qtbot: object, name: str) -> None:
    """Bombs, torn files, other types: the photograph panel says so, and keeps the picture that it had."""
    from types import SimpleNamespace
    from typing import cast

    from PySide6.QtWidgets import QWidget

    from boat_daq.gui.photograph_panel import PhotographPanel
    from boat_daq.viewmodels.desk import Desk

    parent = QWidget()
    panel = PhotographPanel(parent, cast("Desk", SimpleNamespace()))
    before = panel.state
    (tmp_path / name).write_bytes(PICTURES[name])
    with pytest.raises(OperatorError, match="no picture"):
        panel.load(tmp_path / name)
    assert panel.state is before
    parent.deleteLater()


@pytest.mark.parametrize("name", ["closed", "unknown"])
def test_a_file_that_is_none_of_ours_says_so(tmp_path: Path, name: str) -> None:
    """A text with the right ending, a database of another program."""
    path = tmp_path / f"{name}.boat"
    if name == "closed":
        path.write_text("time,pressure\n1,2\n", encoding="utf-8")
    else:
        with closing(sqlite3.connect(path)) as db:
            db.execute("CREATE TABLE chunk (id INTEGER)")
    with pytest.raises((RecordingError, *REFUSALS)):
        load_recording(path)
