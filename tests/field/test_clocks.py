"""Clocks of other programs: read, unwrapped, spread, joined, or refused by name."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from analysis.data.boat_writer import first_difference, write_boat_file
from analysis.data.csv_import import import_csv
from protocol.base.errors import BoatDaqError
from tests.field.truth import HEAD, Lines, Run, are_the_truth, holds, is_the_truth, put

NOON = datetime(2024, 5, 26, 11, 59, 30)
_COMMAS = str.maketrans("._", ",,")

FOLDER = {
    "m00_reference": "",
    "m04_two_clocks": "two clocks",
    "m10_second_stamps": "spread evenly",
    "m11_empty_first_rows": "",
    "m13_minute_wrap": "begins again at 60 s: unwrapped, 2 times",
    "m13_micros_wrap": "begins again at 4294.967296 s: unwrapped",
    "m15_pause_in_hold": "1500 lost",
    "m15_pause_in_ramp": "1500 samples lost",
    "m16_ampm": "",
    "m16_ymd_slash": "",
    "m16_matlab": "",
    "m16_labview_two_spaces": "",
    "m16_colon_ms": "",
    "m16_brackets": "",
    "m17_pressure_every_10th": "one row of 10 only: interpolated",
    "m21_segment_restart": "laid end to end",
}


@pytest.mark.parametrize("name", FOLDER)
def test_the_cases_of_the_folder(cases: Path, name: str) -> None:
    """Each gives the figures of the reference, and what was done is said."""
    is_the_truth(cases / f"{name}.csv", FOLDER[name])


def stamped(form: str, run: Run, head: str = "Time,Pressure (kPa),S1 (mV)") -> list[str]:
    """Return a table with stamps; {ms} is the milliseconds."""
    shown = [NOON + timedelta(seconds=float(t)) for t in run.time_s]
    stamps = [t.strftime(form).replace("{ms}", f"{t.microsecond // 1000:03d}") for t in shown]
    return [head, *(f"{t},{p:.4f},{s:.4f}" for t, p, s in zip(stamps, run.pressure_kpa, run.signal_mv, strict=True))]


def timed(form: str, scale: float, offset: float, wrap: float = 0.0, title: str = "time_s") -> Lines:
    """Return what writes a table with times in other numbers."""

    def write(run: Run) -> list[str]:
        time = np.round(run.time_s * scale + offset, 9)
        time = time % wrap if wrap else time
        rows = zip(time, run.pressure_kpa, run.signal_mv, strict=True)
        return [HEAD.replace("time_s", title), *((form + ",{:.4f},{:.4f}").format(*row) for row in rows)]

    return write


def test_a_rate_replaces_the_column_of_the_time(tmp_path: Path, run: Run) -> None:
    """Whole-second stamps are then not used; a mapped time beside it is refused."""
    path = put(tmp_path, stamped("%Y-%m-%d %H:%M:%S", run))
    recording = import_csv(path, rate_hz=50.0)
    np.testing.assert_allclose(recording.time_s, np.arange(run.time_s.size) / 50.0)
    with pytest.raises(BoatDaqError, match="both a rate and a column"):
        import_csv(path, rate_hz=50.0, columns={"time_s": "Time"})


def german(run: Run) -> list[str]:
    """Return months in German, a decimal comma in the stamps, semicolons."""
    lines = [line.replace(",", ";") for line in stamped("%d-%b-%Y %H:%M:%S_{ms}", run)]
    return [line.replace("May", "Mai").replace("_", ",") for line in lines]


def two_loggers(run: Run) -> list[str]:
    """Return pressure and signal with stamps of their own, 0.7 s apart and the second at half the rate."""
    first = [NOON + timedelta(seconds=float(t)) for t in run.time_s]
    shown = [t.isoformat(" ", "milliseconds") for t in first]
    rows = [f"{shown[i]},{run.pressure_kpa[i]:.4f}" for i in range(len(shown))]
    later = [f"{shown[i]},{run.signal_mv[i]:.4f}" for i in range(35, len(shown), 2)]
    later += [","] * (len(rows) - len(later))
    return ["Time,Pressure (kPa),Timestamp,Signal (mV)", *(f"{a},{b}" for a, b in zip(rows, later, strict=True))]


def beside(run: Run) -> list[str]:
    """Return a column of dates and one of times of the day, decimal commas."""
    lines = stamped("%d.%m.%Y;%H:%M:%S_{ms}", run, "")[1:]
    return ["Datum;Uhrzeit;Druck (kPa);Signal (mV)", *(line.replace(",", ";").translate(_COMMAS) for line in lines)]


def terminal(run: Run) -> list[str]:
    """Return lines of a board without a clock behind the stamps of a terminal program."""
    lines = stamped("%Y-%m-%d %H:%M:%S.{ms}", run, "")[1:]
    return [f"{lines[0][:23]} -> p_kpa,s1_mv", *(line.replace(",", " -> ", 1) for line in lines)]


def summer(run: Run, hours: float) -> list[str]:
    """Return local stamps that jump after 30 s, at a full hour."""
    jumped = Run(run.time_s + 3600 * hours * (run.time_s >= 30), run.pressure_kpa, run.signal_mv)
    return stamped("%Y-%m-%d %H:%M:%S.{ms}", jumped)


def fractions(run: Run) -> list[str]:
    """Return stamps of whole seconds, the milliseconds in a column behind them, units beside other words."""
    lines = stamped("%Y-%m-%d %H:%M:%S,{ms}", run, "")[1:]
    rows = [f"{k},{line},LLLL" for k, line in enumerate(lines, 1)]
    return ['Vendor,"bench"', "Number,Date&Time,ms,CH1,CH2,AlarmOut", 'NO.,Time,ms,"kPa","mV","AO1234"', *rows]


OWN: dict[str, tuple[Lines, str]] = {
    "days of Excel": (timed("{:.9f}", 1 / 86400, 45_000.5, title="Time"), "taken as d"),
    "days of MATLAB": (timed("{:.10f}", 1 / 86400, 739_000.25, title="datenum"), ""),
    "nanoseconds": (timed("{:.0f}", 1e9, 5e9, title="time (ns)"), ""),
    "seconds since 1904": (timed("{:.3f}", 1, 3.8e9), ""),
    "an hour": (timed("{:.3f}", 1, 3570, 3600), "begins again at 3600 s"),
    "2^16 ms": (timed("{:.0f}", 1e3, 60_000, 2**16, "time (ms)"), "begins again at 65.536 s"),
    "minutes and seconds": (lambda run: stamped("%M:%S.{ms}", run), "begins again at 3600 s"),
    "asctime": (lambda run: stamped("%a %b %d %H:%M:%S %Y", run), "spread evenly"),
    "dashes and underscore": (lambda run: stamped("%Y-%m-%d_%H-%M-%S.{ms}", run), ""),
    "packed ISO 8601": (lambda run: stamped("%Y%m%dT%H%M%S.{ms}", run), ""),
    "Chinese": (lambda run: stamped("%Y年%m月%d日 %H:%M:%S.{ms}", run), ""),
    "a title Date of numbers": (timed("{:.9f}", 1 / 86400, 43_976.5, title="Date"), ""),
    "letters": (lambda run: [line.replace("Timestamp", "Time B") for line in two_loggers(run)], "two clocks"),
    "a zone": (lambda run: stamped("%Y-%m-%dT%H:%M:%S.{ms}+02:00", run), ""),
    "German months": (german, ""),
    "milliseconds beside the stamps": (fractions, "the only one in a unit of pressure"),
    "two loggers": (two_loggers, "two clocks"),
    "no title": (lambda run: stamped("%Y-%m-%d %H:%M:%S.{ms}", run, ",Pressure (kPa),S1 (mV)"), "taken as time"),
    "a date beside the time": (beside, ""),
    "durations with their unit": (timed("{:.6g} sec", 1, 0, title="Time"), ""),
    "a stamp of the terminal program": (terminal, "dates and times"),
    "summer time begins": (lambda run: summer(run, 1.0), "jumps by an hour"),
    "summer time ends": (lambda run: summer(run, -1.0), "begins again at 3600 s"),
}  # fmt: skip


@pytest.mark.parametrize("name", OWN)
def test_other_clocks(tmp_path: Path, run: Run, name: str) -> None:
    """Each has the samples of the run, or of other times its figures; what was done is said."""
    write, said = OWN[name]
    path = put(tmp_path, write(run))
    recording = import_csv(path)
    if said in ("two clocks", "spread evenly"):
        are_the_truth(recording, said)
    else:
        holds(recording, run, said)
    write_boat_file(tmp_path / "a.boat", recording, original=path)
    assert first_difference(tmp_path / "a.boat") == ""


def test_a_date_that_may_be_two_needs_its_order(tmp_path: Path, run: Run) -> None:
    """3/4/2024 is refused, and read once the order is stated."""
    path = put(tmp_path, [line.replace("26/05", "03/04") for line in stamped("%d/%m/%Y %H:%M:%S.{ms}", run)])
    with pytest.raises(BoatDaqError, match="03/04/2024") as refused:
        import_csv(path)
    assert "time_s=1:dmy" in refused.value.remedy
    is_the_truth(path, columns={"time_s": "1:dmy"})


@pytest.mark.parametrize(
    ("write", "cause"),
    [
        (timed("{:.0f}", 1e3, 0, title="time (us)"), ""),
        (timed("{:.0f}", 1e3, 0, title="time (ns)"), "MHz"),
        (timed("{:.3f}", 1, 0, title="time (h)"), ""),
        (timed("{:.3f}", 1e6, 0, title="time (s)"), "days"),
        (timed("{:.3f}", 1, 0, 33.7), "time falls"),
    ],
)
def test_a_clock_without_sense_is_refused(tmp_path: Path, run: Run, write: Lines, cause: str) -> None:
    """Above 1 MHz, above a year, or beginning again at an unusual value: refused by name."""
    path = put(tmp_path, write(run))
    if not cause:
        assert import_csv(path).n == run.time_s.size
        return
    with pytest.raises(BoatDaqError, match=cause):
        import_csv(path)


def test_clocks_of_different_kinds_are_refused(tmp_path: Path, run: Run) -> None:
    """Stamps and numbers cannot be compared: both columns are named."""
    lines = stamped("%H:%M:%S.{ms}", run)
    rows = [
        f"{a.rpartition(',')[0]},{t:.2f},{a.rpartition(',')[2]}" for a, t in zip(lines[1:], run.time_s, strict=True)
    ]
    path = put(tmp_path, ["Time,Pressure (kPa),Time,S1 (mV)", *rows])
    with pytest.raises(BoatDaqError, match=r"columns 3 \(Time\) and 1 \(Time\) of different kinds") as refused:
        import_csv(path)
    assert "--map time_s=3" in refused.value.remedy
    holds(import_csv(path, columns={"time_s": "3"}), run)


def test_a_kept_map_of_two_clocks_reads_them_alike(tmp_path: Path, run: Run) -> None:
    """The map that a preview shows gives the same samples; the other clock, mapped, is that of all columns."""
    path = put(tmp_path, two_loggers(run))
    first = import_csv(path)
    again = import_csv(path, columns=first.meta["import_map"])
    np.testing.assert_array_equal(again.pressure_kpa, first.pressure_kpa)
    assert "interpolated" not in str(import_csv(path, columns={"time_s": "1"}).meta.get("import_notes"))


def paused(run: Run, *at: int, pause_s: float) -> list[str]:
    """Return a table that pauses before these rows."""
    late = sum(pause_s * (np.arange(run.time_s.size) >= row) for row in at)
    return Run(run.time_s + late, run.pressure_kpa, run.signal_mv).lines()


def in_segments(run: Run, *at: int) -> list[str]:
    """Return a table with a column of segments, whose clock begins again at these rows."""
    number = np.searchsorted(at, np.arange(run.time_s.size), side="right")
    begins = np.append(0, at)[number]
    rows = run.lines(head="")
    times = (run.time_s - run.time_s[begins]).tolist()
    return ["segment," + HEAD, *(f"{n + 1},{t:.3f},{row.partition(',')[2]}" for n, t, row in zip(number, times, rows))]  # noqa: B905


def slower(run: Run, every: int) -> list[str]:
    """Return a table whose pressure has a value in some rows only."""
    rows = zip(run.time_s, run.pressure_kpa, run.signal_mv, strict=True)
    return [HEAD, *(f"{t:.3f},{'' if k % every else f'{p:.4f}'},{s:.4f}" for k, (t, p, s) in enumerate(rows))]


ALIKE: dict[str, tuple[Lines, str]] = {
    "two pauses in holds": (lambda run: paused(run, 1340, 2660, pause_s=12.0), "lost"),
    "a pause of five minutes": (lambda run: paused(run, 2660, pause_s=300.0), "lost"),
    "three segments": (lambda run: in_segments(run, 1300, 3000), "laid end to end"),
    "five segments": (lambda run: in_segments(run, 700, 1500, 2600, 4000), "laid end to end"),
    "every 5th row": (lambda run: slower(run, 5), "one row of 5 only"),
    "every 2nd row": (lambda run: slower(run, 2), "one row of 2 only"),
}


@pytest.mark.parametrize("name", ALIKE)
def test_other_pauses_segments_and_slow_columns(tmp_path: Path, run: Run, name: str) -> None:
    """The figures are those of the run, and what was done is said."""
    write, said = ALIKE[name]
    is_the_truth(put(tmp_path, write(run)), said)
