"""Two files of one run: joined by their dates, or where they follow each other; the offset is stated."""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from analysis import analyse
from analysis.data.boat_writer import first_difference
from analysis.data.csv_import import import_two
from boat_daq.workflows.run_files import import_files
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError
from tests.field.truth import FSO_MV, HYSTERESIS, Run, put

NOON = datetime(2024, 5, 26, 12)


def pressures(run: Run, form: str, begins_s: float = 0.0) -> list[str]:
    """Return the file of a pressure logger; {} of `form` is a time or a stamp."""
    rows = zip(run.time_s, run.pressure_kpa, strict=True)
    return [f"{form}", *(f"{_time(form, t - begins_s)},{p:.4f}" for t, p in rows)]


def signals(run: Run, form: str, begins_s: float, step: int = 1, sign: float = 1.0) -> list[str]:
    """Return the file of a signal logger that begins later."""
    rows = [(t, s) for t, s in zip(run.time_s, run.signal_mv, strict=True) if t >= begins_s][::step]
    first = 0.0 if "Timestamp" in form else begins_s
    return [f"{form}", *(f"{_time(form, t - first)},{sign * s:.4f}" for t, s in rows)]


def _time(form: str, seconds: float) -> str:
    shown = NOON + timedelta(seconds=float(seconds))
    return shown.isoformat(" ", "milliseconds") if "Timestamp" in form else f"{seconds:.3f}"


def test_the_uncertainty_of_joined_dates_is_that_of_their_stamps(tmp_path: Path, run: Run) -> None:
    """Stamps of 10 ms and of 1 s, each a rectangle: what is not assessed is said, and nothing is zero."""
    files = [put(tmp_path, pressures(run, "Timestamp,Pressure (kPa)"), "a.csv"),
             put(tmp_path, signals(run, "Timestamp,S1 (mV)", 3.36), "b.csv")]  # fmt: skip
    assert import_two(*files).meta["import_offset_u_s"] == pytest.approx(0.01 / 6**0.5, rel=1e-6)
    text = re.sub(r"(:\d\d)\.\d{3}", r"\1", files[1].read_text())
    files[1].write_text(text)
    meta = import_two(*files).meta
    assert meta["import_offset_u_s"] == pytest.approx(1 / 12**0.5, rel=1e-3)
    assert "not how far the two clocks differ, standard uncertainty 0.29 s" in meta["import_notes"][0]


CASES = {
    "dates": ("Timestamp,Pressure (kPa)", "Timestamp,S1 (mV)", 3.36, 1, 1.0, 1e-6),
    "no common clock": ("Time (s),Pressure (kPa)", "Time (s),S1 (mV)", 3.36, 1, 1.0, 0.02),
    "another rate": ("Time (s),Pressure (kPa)", "Time (s),S1 (mV)", 1.74, 2, 1.0, 0.02),
    "a signal that falls": ("Time (s),Pressure (kPa)", "Time (s),S1 (mV)", 1.74, 1, -1.0, 0.02),
}


@pytest.mark.parametrize("name", CASES)
def test_two_files_are_one_run(tmp_path: Path, run: Run, name: str) -> None:
    """The offset is found, stated with its uncertainty, and the import can be repeated."""
    first, second, begins_s, step, sign, within_s = CASES[name]
    files = [put(tmp_path, pressures(run, first), "a.csv"),
             put(tmp_path, signals(run, second, begins_s, step, sign), "b.csv")]  # fmt: skip
    recording = import_files(files, tmp_path / "a.boat", {}, {})
    assert recording.meta["import_offset_s"] == pytest.approx(begins_s, abs=within_s)
    assert "b.csv begins +" in recording.meta["import_notes"][0]
    figures = analyse(recording, mcmc=False).sensors[0].figures
    assert figures["fso_mv"].value == pytest.approx(FSO_MV, abs=0.5)
    assert figures["system_hysteresis_percent_fso"].value == pytest.approx(HYSTERESIS, abs=0.05)
    assert first_difference(tmp_path / "a.boat") == ""


def test_files_of_other_runs_are_refused(tmp_path: Path, run: Run) -> None:
    """What does not follow the pressure has no place; what has no signal has none either."""
    other = ["Time (s),S1 (mV)", *(f"{k / 50:.2f},{(k * 7919) % 101}" for k in range(2000))]
    files = [put(tmp_path, pressures(run, "Time (s),Pressure (kPa)"), "a.csv"), put(tmp_path, other, "b.csv")]
    with pytest.raises(BoatDaqError, match="do not show one run"):
        import_files(files, tmp_path / "a.boat", {}, {})
    with pytest.raises(BoatDaqError, match="not both a pressure and a signal"):
        import_files([files[0], files[0]], tmp_path / "a.boat", {}, {})


def test_two_files_that_lack_something_are_both_named(tmp_path: Path, run: Run) -> None:
    """No clock in either, arrays of another rate than the clock, nothing but a clock: each with its true cause."""
    import h5py

    def written(name: str, **columns: tuple[FloatArray, str]) -> Path:
        with h5py.File(tmp_path / name, "w") as file:
            for title, (values, unit) in columns.items():
                file.create_dataset(title, data=values).attrs["units"] = unit
        return tmp_path / name

    pressure, signal = (run.pressure_kpa[::5], "kPa"), (run.signal_mv, "mV")
    files = written("a.h5", pressure=pressure), written("b.h5", signal=signal)
    with pytest.raises(BoatDaqError, match=r"a\.h5: no column was recognised as time_s; b\.h5: no column") as refused:
        import_two(*files)
    assert "--rate" not in refused.value.remedy
    files = written("a.h5", pressure=pressure, time=(run.time_s, "s")), written("b.h5", time=(run.time_s[::3], "s"))
    with pytest.raises(BoatDaqError, match=r"a.h5 and b.h5 have not both .* left out: pressure \(1020\)"):
        import_two(*files)
