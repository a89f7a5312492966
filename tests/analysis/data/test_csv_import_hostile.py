"""Files as laboratories have them, each made from known numbers: those are read, or an error names the cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.data.csv_import import import_csv, load_profile, map_columns, preview, save_profile
from analysis.data.csv_table import read_table
from analysis.data.recording import Recording
from protocol.base.errors import BoatDaqError, DataError

N = 60
TIME = np.round(np.arange(N) * 0.01, 3)
PRESSURE = np.round(50.0 * np.cos(np.arange(N) / 7.0), 3)
SIGNAL = np.round(1650.0 + 46.0 * np.sin(np.arange(N) / 9.0), 3)
PLAIN = [f"{t:.10g},{p:.10g},{s:.10g}" for t, p, s in zip(TIME, PRESSURE, SIGNAL, strict=True)]
HEAD = "time_s,pressure_kpa,s1_mv"


def put(folder: Path, text: str | bytes) -> Path:
    path = folder / "malformed.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def lines(*head: str, rows: list[str] = PLAIN, end: str = "\n") -> str:
    return end.join([*head, *rows]) + end


def is_the_truth(run: Recording, keep: slice = slice(None)) -> None:
    np.testing.assert_allclose(run.time_s, TIME[keep] - TIME[keep][0], atol=1e-6)
    np.testing.assert_allclose(run.pressure_kpa, PRESSURE[keep], atol=1e-9)
    np.testing.assert_allclose(run.signal_mv[:, 0], SIGNAL[keep], atol=1e-9)


def comma(text: str, separator: str = ";") -> str:
    return text.replace(",", separator).replace(".", ",")


def clock(seconds: float, start: int = 86_399) -> str:
    """Time of day, from a second before midnight on unless given."""
    whole = start + int(seconds + 1e-9)
    return f"{whole // 3600 % 24:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}.{round(seconds % 1 * 1000):03d}"


def timed(shown: list[str]) -> list[str]:
    return [f"{t},{p:.10g},{s:.10g}" for t, p, s in zip(shown, PRESSURE, SIGNAL, strict=True)]


THOUSANDS = [f'{t:.10g};{p:.10g};"{s:,.3f}"' for t, p, s in zip(TIME, PRESSURE, SIGNAL, strict=True)]
CONTINENTAL = [
    f"{t:.10g};{p:.10g};{s:,.3f}".replace(",", "_").replace(".", ",").replace("_", ".")
    for t, p, s in zip(TIME, PRESSURE, SIGNAL, strict=True)
]
NOTED = [row + ',"{}"'.format("first\nsecond" if k % 7 == 0 else "x") for k, row in enumerate(PLAIN)]
IN_VOLTS = [f"{t:.3f};{p:.3f};{s / 1000:.6f}".replace(".", ",") for t, p, s in zip(TIME, PRESSURE, SIGNAL, strict=True)]


def written(how: str) -> list[str]:
    return [how.format(t, p, s) for t, p, s in zip(TIME, PRESSURE, SIGNAL, strict=True)]


GOOD = {
    "decimal comma with tabs": comma(lines("time_s,pressure_kpa,s1_mv"), "\t"),
    "utf-16 le without a mark": lines(HEAD).encode("utf-16-le"),
    "unit row in brackets": lines("Time,Pressure,Sensor 1", "[s],[kPa],[mV]"),
    "two header rows": lines("Bench,Actuator,Actuator", "Time (s),Pressure (kPa),Sensor 1 (mV)"),
    "a newline in a quoted name": lines('"time\n(s)","pressure\n(kPa)","sensor 1\n(mV)"'),
    "a newline in a quoted note": lines(f"{HEAD},note", rows=NOTED),
    "a separator at the end": lines(f"{HEAD},", rows=[f"{row}," for row in PLAIN]),
    "a separator at the end of the rows alone": lines(HEAD, rows=[f"{row}," for row in PLAIN]),
    "milliseconds": lines("time (ms),pressure_kpa,s1_mv", rows=timed([f"{1000 * t:.10g}" for t in TIME])),
    "microseconds": lines("time [µs],pressure_kpa,s1_mv", rows=timed([f"{1e6 * t:.0f}" for t in TIME])),
    "seconds since 1970": lines(HEAD, rows=timed([f"{1.7e9 + t:.3f}" for t in TIME])),
    "time of day": lines("time,pressure_kpa,s1_mv", rows=timed([clock(t, 43_200) for t in TIME])),
    "time of day over midnight": lines(
        "time,pressure_kpa,s1_mv", rows=timed([clock(t + 0.75) for t in TIME])
    ),
    "date and time": lines(
        "timestamp,pressure_kpa,s1_mv", rows=timed([f"2026-03-01T12:00:{t:06.3f}" for t in TIME])
    ),
    "excel's own first line": "sep=;\r\n" + lines(HEAD, end="\r\n").replace(",", ";"),
    "excel's first line and a decimal comma": "sep=;\n" + comma(lines(HEAD)),
    "thousands in quotes": lines(HEAD.replace(",", ";"), rows=THOUSANDS),
    "thousands by points": lines(HEAD.replace(",", ";"), rows=CONTINENTAL),
    "the true minus sign": lines(HEAD).replace("-", "\u2212"),
    "mixed ends of lines": "\n".join(["\r\n".join([HEAD, *PLAIN[:20]]), *PLAIN[20:40], "\r".join([*PLAIN[40:], ""])]),
    "comments before the header": lines("# bench 3", "", "# made: today", HEAD),
    "words before the header": lines("Bench 3, Monday", "Operator: A", "", HEAD),
    "blank lines and blanks": "\n\n" + "\n\n".join([HEAD, *(f"  {row.replace(',', ' , ')} " for row in PLAIN), ""]),
    "exponents": lines(HEAD, rows=written("{:.6e},{:.6E},{:.9e}")),
    "plus signs": lines(HEAD, rows=written("{:+.10g},{:+.10g},{:+.10g}")),
    "every number below a thousand with a comma": lines("time_s;pressure_kpa;s1 [V]", rows=IN_VOLTS),
    "rows' names without a title": lines(HEAD, rows=[f"r{k},{row}" for k, row in enumerate(PLAIN)]),
    "a lone inch mark above the header": lines('# 3/4" tube', 'bench 3" left', HEAD),
    "a note that holds a number sign": lines(f"{HEAD},note", rows=[f"{row},no #{k}" for k, row in enumerate(PLAIN)]),
    "a comment in the middle": lines(HEAD, rows=[*PLAIN[:9], "# pause", *PLAIN[9:]]),
    "date by points": lines(
        "timestamp,pressure_kpa,s1_mv", rows=timed([f"1.3.2026 9:00:{t:06.3f}" for t in TIME])
    ),
    "units in the cells' names": lines("Zeit in s;Druck in kPa;Sensor 1 in mV").replace(",", ";"),
    "every cell in quotes": lines(HEAD, rows=['"' + row.replace(",", '","') + '"' for row in PLAIN]),
}  # fmt: skip


@pytest.mark.parametrize("name", GOOD)
def test_a_malformed_file_gives_its_numbers(tmp_path: Path, name: str) -> None:
    """Fault 47: the numbers that the file was made of, in kPa, mV and s."""
    is_the_truth(import_csv(put(tmp_path, GOOD[name])))


@pytest.mark.parametrize(
    "word",
    ["NaN", "nan", "-nan", "#N/A", "NULL", "n/a", "1.#QNAN", "1.#IND", "inf", "-Infinity", "#DIV/0!", "--", "OVER"],
)
def test_what_is_no_number_is_masked_and_counted(tmp_path: Path, word: str) -> None:
    """Fault 37: the cell is left out, its neighbours stay, and it is reported."""
    rows = [*PLAIN]
    rows[7] = f"{TIME[7]:.10g},{PRESSURE[7]:.10g},{word}"
    path = put(tmp_path, lines(HEAD, rows=rows))
    run = import_csv(path)
    assert not np.isfinite(run.signal_mv[7, 0])
    np.testing.assert_allclose(np.delete(run.signal_mv[:, 0], 7), np.delete(SIGNAL, 7))
    assert preview(path)["masked_cells"] == 1


def test_repeated_and_falling_times(tmp_path: Path) -> None:
    """A repeated time is left out and counted; a falling one is refused by its line, blank lines counted."""
    repeated = [*PLAIN[:10], *PLAIN[9:]]
    run = import_csv(put(tmp_path, lines(HEAD, rows=repeated)))
    is_the_truth(run)
    assert run.meta["repeated_times"] == 1
    falling = ["", *PLAIN[:30], *PLAIN[10:]]
    with pytest.raises(DataError, match=r"line 33: time falls from 0\.29 to 0\.1 s"):
        import_csv(put(tmp_path, lines(HEAD, rows=falling)))


def test_without_time_a_rate_is_required(tmp_path: Path) -> None:
    """Its value is used."""
    path = put(tmp_path, lines("pressure_kpa,s1_mv", rows=[row.partition(",")[2] for row in PLAIN]))
    with pytest.raises(BoatDaqError) as refused:
        import_csv(path)
    assert "--rate" in refused.value.remedy
    is_the_truth(import_csv(path, rate_hz=100.0))


def test_a_profile_is_used_again_for_the_next_file(tmp_path: Path) -> None:
    """Columns with unknown names, in another order and another unit: mapped once, kept, and read again the same."""
    rows = [f"{s / 1000:.6f};{t * 1000:.10g};x;{p / 100:.5f}" for t, p, s in zip(TIME, PRESSURE, SIGNAL, strict=True)]
    path = put(tmp_path, lines("Kanal A;Uhr: Pult;was;Manometer", rows=rows))
    table = read_table(path)
    by_hand = {"s1_mv": "Kanal A:V", "time_s": "2:ms", "pressure_kpa": "Manometer:bar"}
    save_profile(tmp_path / "profile.json", map_columns(table, by_hand), table)
    kept = load_profile(tmp_path / "profile.json")
    assert kept["pressure_kpa"] == "Manometer:bar"
    is_the_truth(import_csv(path, profile=tmp_path / "profile.json"))


@pytest.mark.nightly
def test_a_million_rows(tmp_path: Path) -> None:
    """With a word in one cell of the last thousand, so that the whole file is parsed cell by cell."""
    n = 1_000_000
    rows = [f"{k / 1000:.10g},{k % 91 - 40},{1650 + k % 7}" for k in range(n)]
    rows[-500] = rows[-500].rpartition(",")[0] + ",OVER"
    run = import_csv(put(tmp_path, lines(HEAD, rows=rows)))
    assert run.n == n
    assert np.flatnonzero(~np.isfinite(run.signal_mv[:, 0])).tolist() == [n - 500]
    np.testing.assert_allclose(run.pressure_kpa, np.arange(n) % 91 - 40)
