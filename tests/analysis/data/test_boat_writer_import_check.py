"""Imported recordings derived again from the bytes of their file."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from analysis.data.boat_writer import first_difference, write_boat_file
from analysis.data.csv_import import import_csv

ROWS = [(0.0, 1.5, 1650.25), (0.01, 1.75, 1651.5), (0.02, 2.0, 1652.75), (0.03, 2.5, 1653.0)]


def text(separator: str = ",", decimal: str = ".", header: str | None = "time_s,pressure_kpa,s1_mv") -> str:
    """The rows above in a dialect."""
    lines = [header.replace(",", separator)] if header else []
    lines += [separator.join(str(v).replace(".", decimal) for v in row) for row in ROWS]
    return "\n".join(lines) + "\n"


def test_an_import_is_derived_again_from_its_bytes(tmp_path: Path) -> None:
    """The kept bytes and map give the same samples; a changed byte is found."""
    import sqlite3

    path, run = tmp_path / "a.csv", tmp_path / "a.boat"
    path.write_text(text(";", ",", None))
    columns = {"time_s": "1:ms", "pressure_kpa": "2:bar", "s1_mv": "3:V"}
    write_boat_file(run, import_csv(path, columns=columns), original=path)
    assert first_difference(run) == ""
    with closing(sqlite3.connect(run)) as db, db:
        db.execute("UPDATE chunk SET raw = ?", (path.read_bytes().replace(b"1651,5", b"1651,6"),))
    assert "sample 1 differs" in first_difference(run)
