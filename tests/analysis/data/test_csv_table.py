"""Tables as they are found: broken rows are named, other files refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from analysis import BoatDaqError
from analysis.data.csv_import import import_csv
from analysis.data.csv_table import read_table


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
    ("content", "cause"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\x00", "binary|no rows"),
        (b"just some words\nand more\n", "no rows of numbers"),
        (b"1," * 600_000, "a line longer than 1 MB"),
        (b"\n".join([b",".join([b"1"] * 1500)] * 5), "1500 columns"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, content: bytes, cause: str) -> None:
    """Fault 52 and its neighbours: refused with the cause, in bounded memory."""
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(BoatDaqError, match=cause):
        read_table(path)
