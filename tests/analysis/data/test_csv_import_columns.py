"""Columns and units: recognised by title, mapped by number, kept as a profile."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from analysis import BoatDaqError
from analysis.data.csv_import import import_csv, load_profile, map_columns, save_profile
from analysis.data.csv_table import read_table

ROWS = [(0.0, 1.5, 1650.25), (0.01, 1.75, 1651.5), (0.02, 2.0, 1652.75), (0.03, 2.5, 1653.0)]


def text(separator: str = ",", decimal: str = ".", header: str | None = "time_s,pressure_kpa,s1_mv") -> str:
    """The rows above in a dialect."""
    lines = [header.replace(",", separator)] if header else []
    lines += [separator.join(str(v).replace(".", decimal) for v in row) for row in ROWS]
    return "\n".join(lines) + "\n"


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
    with pytest.raises(BoatDaqError, match="no column was recognised as time_s") as refused:
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


def written(path: Path, head: str, row: Callable[[int], str], rows: int = 50) -> Path:
    path.write_text(head + "\n" + "\n".join(row(i) for i in range(rows)) + "\n", encoding="utf-8")
    return path


def test_a_name_with_a_comma_is_understood(tmp_path: Path) -> None:
    """`"time, ms"` is the time, in ms."""
    path = written(tmp_path / "a.csv", '"time, ms",pressure_kpa,s1_mv', lambda i: f'"{10 * i}","{i}.5","{1600 + i}"')
    assert import_csv(path).rate_hz == pytest.approx(100.0)


def test_a_column_of_text_is_named(tmp_path: Path) -> None:
    """3/4/2026 is the third of April or the fourth of March: the refusal shows the values of the column."""
    path = written(tmp_path / "a.csv", "time,pressure_kpa,s1_mv", lambda i: f"3/4/2026 10:{i:02d},{i}.5,{1600 + i}")
    with pytest.raises(BoatDaqError, match="column 'time' holds text like '3/4/2026 10:00'"):
        import_csv(path)
