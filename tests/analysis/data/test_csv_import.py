"""CSV as it is found, in and out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis import AnalysisError, analyse, load_recording
from analysis.data.boat_writer import write_boat_file
from analysis.data.csv_columns import load_profile, map_columns, save_profile
from analysis.data.csv_import import import_csv, preview
from analysis.data.csv_table import read_table
from analysis.data.export import export, neutral
from analysis.data.import_check import first_difference
from tests.analysis.boat_builder import Plant, triangle, write_boat

ROWS = [(0.0, 1.5, 1650.25), (0.01, 1.75, 1651.5), (0.02, 2.0, 1652.75), (0.03, 2.5, 1653.0)]


def text(separator: str = ",", decimal: str = ".", header: str | None = "time_s,pressure_kpa,s1_mv") -> str:
    """The rows above in a dialect."""
    lines = [header.replace(",", separator)] if header else []
    lines += [separator.join(str(v).replace(".", decimal) for v in row) for row in ROWS]
    return "\n".join(lines) + "\n"


@pytest.mark.fault(47, how="each separator, decimal sign and encoding", times=24)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", ","), ("\t", ","), (";", "."), ("\t", "."), ("|", ".")]
)
def test_every_dialect_gives_the_same_run(tmp_path: Path, encoding: str, separator: str, decimal: str) -> None:
    """Fault 47: separators, decimal comma, BOM and UTF-16."""
    path = tmp_path / "a.csv"
    path.write_bytes(text(separator, decimal).encode(encoding))
    recording = import_csv(path)
    np.testing.assert_array_equal(recording.time_s, [row[0] for row in ROWS])
    np.testing.assert_array_equal(recording.signal_mv[:, 0], [row[2] for row in ROWS])


@pytest.mark.fault(47, how="units in names and in a row of their own", times=3)
@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("Time (ms);Pressure [bar];Sensor 1 (V)", (1e-3, 100.0, 1e3)),
        ("t;p;signal\nms;kPa;mV", (1e-3, 1.0, 1.0)),
        ('"time_us";"pressure_pa";"s1_mv"', (1e-6, 1e-3, 1.0)),
    ],
)
def test_units_in_names_and_unit_rows_are_used(tmp_path: Path, header: str, factor: tuple[float, ...]) -> None:
    """Units in brackets, in a row of their own, or at the end of the name are converted."""
    path = tmp_path / "a.csv"
    path.write_text(text(";", ",", header.replace(",", ".")))
    recording = import_csv(path)
    np.testing.assert_allclose(recording.time_s, [row[0] * factor[0] for row in ROWS])
    np.testing.assert_allclose(recording.pressure_kpa, [row[1] * factor[1] for row in ROWS])
    np.testing.assert_allclose(recording.signal_mv[:, 0], [row[2] * factor[2] for row in ROWS])


def test_without_a_header_columns_are_mapped_by_number_and_the_map_is_kept(tmp_path: Path) -> None:
    """A map by number is saved as a profile and gives the same run again; without it the refusal lists the columns."""
    path, profile = tmp_path / "a.csv", tmp_path / "lab.json"
    path.write_text(text(header=None))
    with pytest.raises(AnalysisError, match="no column was recognised as time_s") as refused:
        import_csv(path)
    assert "--map time_s=1:" in refused.value.remedy
    by_itself = import_csv(path, columns={"pressure_kpa": "2:bar", "s1_mv": "3:V"})
    assert any("taken as time" in note for note in by_itself.meta["import_notes"])
    columns = {"time_s": "1:ms", "pressure_kpa": "2:bar", "s1_mv": "3:V"}
    table = read_table(path)
    save_profile(profile, map_columns(table, columns), table)
    assert load_profile(profile) == columns
    np.testing.assert_array_equal(
        import_csv(path, profile=profile).signal_mv, import_csv(path, columns=columns).signal_mv
    )
    assert import_csv(path, columns=columns).pressure_kpa[0] == pytest.approx(150.0)


@pytest.mark.fault(47, how="a file without time", times=1)
def test_no_time_takes_a_rate(tmp_path: Path) -> None:
    """Time absent: refused without a rate, evenly spaced with one."""
    path = tmp_path / "a.csv"
    path.write_text("pressure_kpa,s1_mv\n1,2\n3,4\n5,6\n")
    with pytest.raises(AnalysisError, match="time_s") as refusal:
        import_csv(path)
    assert "--rate" in refusal.value.remedy
    np.testing.assert_allclose(import_csv(path, rate_hz=50).time_s, [0, 0.02, 0.04])


@pytest.mark.fault(47, how="time that falls, and time that repeats", times=2)
def test_falling_time_is_refused_with_its_line(tmp_path: Path) -> None:
    """The line is that of the file, comments and header counted; a repeated time is left out and counted."""
    path = tmp_path / "a.csv"
    path.write_text("# lab\ntime_s,pressure_kpa,s1_mv\n0,1,2\n1,1,2\n# pause\n0.5,1,2\n2,1,2\n")
    with pytest.raises(AnalysisError, match="line 6: time falls"):
        import_csv(path)
    path.write_text("time_s,pressure_kpa,s1_mv\n0,1,2\n1,1,2\n1,1,3\n2,1,2\n")
    recording = import_csv(path)
    assert recording.n == 3
    assert recording.meta["repeated_times"] == 1


@pytest.mark.fault(47, how="ragged rows, and words between numbers", times=1)
def test_broken_rows_are_named_by_line(tmp_path: Path) -> None:
    """Ragged rows are left out, words between numbers masked; both are named."""
    path = tmp_path / "a.csv"
    rows = [f"{i},{i},{i}" for i in range(100)]
    rows[10], rows[20] = "10,10", "20,error,20"
    path.write_text("time_s,pressure_kpa,s1_mv\n" + "\n".join(rows) + "\n")
    table = read_table(path)
    assert tuple(warning.text for warning in table.warnings) == ("line 12: 2 fields where the others have 3",
                            "line 22: 'error' in column 'pressure_kpa' is not a number")  # fmt: skip
    assert (table.rows, table.broken, table.masked) == (99, 1, 1)
    assert import_csv(path).masked["pressure_not_finite"] == 1


@pytest.mark.fault(52, how="endless lines, thousands of columns, binary files", times=5)
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\x00", "binary|no rows"),
        (b"just some words\nand more\n", "no rows of numbers"),
        (b"1," * 600_000, "a line longer than 1 MB"),
        (b"\n".join([b",".join([b"1"] * 1500)] * 5), "1500 columns"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    """Fault 52 and its neighbours: refused in words, in bounded memory."""
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(AnalysisError, match=said):
        read_table(path)


@pytest.mark.fault(47, how="a file as it is found, through the preview", times=1)
def test_preview_shows_what_would_be_taken(tmp_path: Path) -> None:
    """Columns, first values, what each is taken as, and what is missing; nothing is refused."""
    path = tmp_path / "a.csv"
    path.write_text("time (ms),druk (bar),licht\n0,1,2\n1,1,2\n")
    seen = preview(path)
    assert [c["taken_as"] for c in seen["columns"]] == ["time_s", "pressure_kpa", ""]
    assert seen["missing"] == ["s1_mv"]
    assert seen["columns"][1]["first"] == [1.0, 1.0]


def test_the_shared_import_case(shared_data: Path) -> None:
    """Semicolons, decimal commas, a spaced header: nine columns of the real file."""
    table = read_table(shared_data / "zillen_pneumatic" / "decimal_comma.csv")
    assert table.names[0] == "Tijd"
    assert table.units[0] == "s"
    assert len(table.columns) == 9
    assert table.columns[0][1] == pytest.approx(0.1)


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(-1e6, 1e6), min_size=5, max_size=20))
def test_numbers_survive_export_and_import(tmp_path_factory: pytest.TempPathFactory, values: list[float]) -> None:
    """Every exported number is read again to the last bit."""
    folder = tmp_path_factory.mktemp("round")
    recording = Plant().run(np.asarray(values), np.zeros(len(values), bool), np.zeros(len(values)))
    export(recording, folder / "a.csv", "csv")
    again = load_recording(folder / "a.csv")
    np.testing.assert_array_equal(again.pressure_kpa, recording.pressure_kpa)
    np.testing.assert_array_equal(again.signal_mv, recording.signal_mv)


@pytest.mark.fault(49, 54, how="a formula for a note, in a simulated run", times=1)
def test_export_says_simulated_and_neutralises_text(tmp_path: Path) -> None:
    """Faults 49 and 54: the note is one cell that no spreadsheet runs; SIMULATED stands in CSV, sidecar and Parquet."""
    meta = {"note": '=cmd|"/c calc",@x', "operator": "+1"}
    run = write_boat(tmp_path / "r.boat", Plant().run(*triangle(2, 5)), meta=meta)
    recording = load_recording(run)
    export(recording, tmp_path / "r.csv", "csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    assert lines[0].startswith("# SIMULATED")
    import csv

    for cells in csv.reader(lines):
        assert not any(cell.startswith(("=", "@", "\t")) for cell in cells)
    assert json.loads((tmp_path / "r.json").read_text())["SIMULATED"] is True
    assert load_recording(tmp_path / "r.csv").simulated
    export(recording, tmp_path / "r.parquet", "parquet")
    import pyarrow.parquet as pq

    assert b"SIMULATED" in pq.read_metadata(tmp_path / "r.parquet").metadata
    frame = pd.read_parquet(tmp_path / "r.parquet")
    np.testing.assert_array_equal(frame["s1_mv"], recording.signal_mv[:, 0])
    assert neutral("=1+1") == "'=1+1"


def test_an_import_becomes_a_recording_with_its_original_bytes(tmp_path: Path) -> None:
    """import -> .boat -> load gives the same run; the file's bytes are in it; nothing is overwritten."""
    import sqlite3

    path, run = tmp_path / "a.csv", tmp_path / "a.boat"
    path.write_text(text())
    recording = import_csv(path)
    write_boat_file(run, recording, original=path)
    again = load_recording(run)
    np.testing.assert_allclose(again.time_s, recording.time_s, atol=1e-9)
    np.testing.assert_array_equal(again.signal_mv, recording.signal_mv)
    with sqlite3.connect(run) as db:
        assert b"".join(r for (r,) in db.execute("SELECT raw FROM chunk ORDER BY id")) == path.read_bytes()
    with pytest.raises(AnalysisError, match="exists already"):
        write_boat_file(run, recording, original=path)


def test_an_import_is_derived_again_from_its_bytes(tmp_path: Path) -> None:
    """The kept bytes and map give the same samples; a changed byte is found."""
    import sqlite3

    path, run = tmp_path / "a.csv", tmp_path / "a.boat"
    path.write_text(text(";", ",", None))
    columns = {"time_s": "1:ms", "pressure_kpa": "2:bar", "s1_mv": "3:V"}
    write_boat_file(run, import_csv(path, columns=columns), original=path)
    assert first_difference(run) == ""
    with sqlite3.connect(run) as db:
        db.execute("UPDATE chunk SET raw = ?", (path.read_bytes().replace(b"1651,5", b"1651,6"),))
    assert "sample 1 differs" in first_difference(run)


def test_exported_comments_begin_with_a_hash_and_hold_no_cell(tmp_path: Path) -> None:
    """A reader that skips lines beginning with # meets the header next; a formula in a note stays inside its line."""
    from analysis.data.export import _comment

    line = _comment('note: "a,=1+1\\n"')
    assert line.startswith("# note")
    assert "," not in line
    assert line.count("\n") == 1


def written(path: Path, head: str, row: Callable[[int], str], rows: int = 50) -> Path:
    path.write_text(head + "\n" + "\n".join(row(i) for i in range(rows)) + "\n", encoding="utf-8")
    return path


def test_a_name_with_a_comma_is_understood(tmp_path: Path) -> None:
    """`"time, ms"` is the time, in ms."""
    path = written(tmp_path / "a.csv", '"time, ms",pressure_kpa,s1_mv', lambda i: f'"{10 * i}","{i}.5","{1600 + i}"')
    assert import_csv(path).rate_hz == pytest.approx(100.0)


def test_a_column_of_text_is_named(tmp_path: Path) -> None:
    """3/4/2026 is the third of April or the fourth of March: the refusal shows what stands in the column."""
    path = written(tmp_path / "a.csv", "time,pressure_kpa,s1_mv", lambda i: f"3/4/2026 10:{i:02d},{i}.5,{1600 + i}")
    with pytest.raises(AnalysisError, match="column 'time' holds text like '3/4/2026 10:00'"):
        import_csv(path)


def test_what_an_import_left_out_is_a_flag_of_the_figures(tmp_path: Path) -> None:
    """Who analyses a CSV never sees the import's own messages: seven ragged rows, five said and the rest counted."""
    path = written(tmp_path / "a.csv", "time_s,pressure_kpa,s1_mv", lambda i: f"{i},{i % 7}.5,{1600 + i}")
    lines = path.read_text().splitlines()
    lines[10:17] = ["9,9"] * 7
    path.write_text("\n".join(lines) + "\n" + "\n".join(f"{i},{i % 7}.5,{1600 + i}" for i in range(1000, 1900)))
    texts = [w.sentence for w in analyse(path, mcmc=False).warnings if w.code == "import"]
    assert texts[0] == "line 11: 2 fields where the others have 3"
    assert len(texts) == 6
    assert texts[-1].startswith("and 2 more")


def test_repeated_times_are_told(tmp_path: Path) -> None:
    """A row whose time stands twice is left out, and said."""
    path = written(tmp_path / "a.csv", "time_s,pressure_kpa,s1_mv", lambda i: f"{max(i, 1)},{i}.5,{1600 + i}")
    assert any("1 rows left out" in note for note in import_csv(path).meta["import_notes"])


@pytest.mark.parametrize("lit", ["-5", "70000", "1e30"])
def test_counts_that_are_none_are_masked(tmp_path: Path, lit: str) -> None:
    """A count beyond 16 bits does not wrap round into one that looks right."""
    head = "# vref_mv: 3300\n# adc_bits: 12\ntime_s,pressure_kpa,s1_lit,s1_dark"
    path = written(tmp_path / "a.csv", head, lambda i: f"{i},{i}.5,{lit if i == 7 else 2000 + i},100")
    found = import_csv(path)
    assert not found.usable[7].any()
    assert found.usable.all(axis=1).sum() == 49


def test_a_reference_voltage_that_is_a_word_is_refused(tmp_path: Path) -> None:
    """`# vref_mv: full` is no number: refused by name."""
    head = "# vref_mv: full\n# adc_bits: 12\ntime_s,pressure_kpa,s1_lit,s1_dark"
    path = written(tmp_path / "a.csv", head, lambda i: f"{i},{i}.5,{2000 + i},100")
    with pytest.raises(AnalysisError, match="vref_mv"):
        import_csv(path)
