"""CSV as it is found, in and out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from analysis import BoatDaqError, analyse
from analysis.data.csv_import import import_csv, preview
from analysis.data.csv_table import read_table

ROWS = [(0.0, 1.5, 1650.25), (0.01, 1.75, 1651.5), (0.02, 2.0, 1652.75), (0.03, 2.5, 1653.0)]


def text(separator: str = ",", decimal: str = ".", header: str | None = "time_s,pressure_kpa,s1_mv") -> str:
    """The rows above in a dialect."""
    lines = [header.replace(",", separator)] if header else []
    lines += [separator.join(str(v).replace(".", decimal) for v in row) for row in ROWS]
    return "\n".join(lines) + "\n"


@pytest.mark.fault(47, how="each separator, decimal sign and encoding", times=24)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252", "cp932", "gb18030", "cp1251"])
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


@pytest.mark.fault(47, how="a file without time", times=1)
def test_no_time_takes_a_rate(tmp_path: Path) -> None:
    """Time absent: refused without a rate, evenly spaced with one."""
    path = tmp_path / "a.csv"
    path.write_text("pressure_kpa,s1_mv\n1,2\n3,4\n5,6\n")
    with pytest.raises(BoatDaqError, match="time_s") as refusal:
        import_csv(path)
    assert "--rate" in refusal.value.remedy
    np.testing.assert_allclose(import_csv(path, rate_hz=50).time_s, [0, 0.02, 0.04])


@pytest.mark.fault(47, how="time that falls, and time that repeats", times=2)
def test_falling_time_is_refused_with_its_line(tmp_path: Path) -> None:
    """The line is that of the file, comments and header counted; a repeated time is left out and counted."""
    path = tmp_path / "a.csv"
    path.write_text("# lab\ntime_s,pressure_kpa,s1_mv\n0,1,2\n1,1,2\n# pause\n0.5,1,2\n2,1,2\n")
    with pytest.raises(BoatDaqError, match="line 6: time falls"):
        import_csv(path)
    path.write_text("time_s,pressure_kpa,s1_mv\n0,1,2\n1,1,2\n1,1,3\n2,1,2\n")
    recording = import_csv(path)
    assert recording.n == 3
    assert recording.meta["repeated_times"] == 1


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


def written(path: Path, head: str, row: Callable[[int], str], rows: int = 50) -> Path:
    path.write_text(head + "\n" + "\n".join(row(i) for i in range(rows)) + "\n", encoding="utf-8")
    return path


def test_what_an_import_left_out_is_a_warning_of_the_figures(tmp_path: Path) -> None:
    """An analysis of a CSV repeats the import's messages: seven ragged rows, five listed and the rest counted."""
    path = written(tmp_path / "a.csv", "time_s,pressure_kpa,s1_mv", lambda i: f"{i},{i % 7}.5,{1600 + i}")
    lines = path.read_text().splitlines()
    lines[10:17] = ["9,9"] * 7
    path.write_text("\n".join(lines) + "\n" + "".join(f"{i},{i % 7}.5,{1600 + i}\n" for i in range(1000, 1900)))
    texts = [w.sentence for w in analyse(path, mcmc=False).warnings if w.code == "import"]
    assert texts[0] == "line 11: 2 fields where the others have 3"
    assert len(texts) == 6
    assert texts[-1].startswith("and 2 more")


def test_repeated_times_are_reported(tmp_path: Path) -> None:
    """A row that repeats a time is left out and reported."""
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
    with pytest.raises(BoatDaqError, match="vref_mv"):
        import_csv(path)
