"""Files of other programs that are no CSV: Excel, MATLAB, HDF5, Parquet, LabVIEW, captured serial text, own exports."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from analysis import load_recording
from analysis.data.boat_writer import first_difference, write_boat_file
from analysis.data.csv_import import import_csv
from analysis.data.export import export
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.results import csv_import
from boat_daq.viewmodels.results.csv_import import CsvImport
from boat_daq.workflows.jobs import JobRunner
from boat_daq.workflows.run_files import import_capture
from protocol.base.errors import BoatDaqError
from protocol.text.proposal import propose
from tests.boat_daq.viewmodels.helpers import DirectJob
from tests.field.truth import Run, are_the_truth, holds, is_the_truth, put

NOON = datetime(2024, 5, 26, 12)
HEAD = ("Time (s)", "Pressure (kPa)", "S1 (mV)")


@pytest.fixture
def window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CsvImport:
    """Return what the window shows of an import, with jobs done at once."""
    monkeypatch.setattr(csv_import, "Job", DirectJob)
    return CsvImport(tmp_path, JobRunner(), Preferences(tmp_path), lambda path, noted: None)


def opened(window: CsvImport, path: Path) -> None:
    """Open a file and wait until it is read."""
    window.open(path)
    while window.reading:
        window._jobs.poll()


def arrays(run: Run) -> dict[str, np.ndarray]:
    """Return the columns by variable."""
    return {"time_s": run.time_s, "pressure_kpa": run.pressure_kpa, "s1_mv": run.signal_mv}


def workbook(path: Path, run: Run) -> None:
    """Write a workbook with a sheet of notes, titles in the third row, stamps of Excel."""
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    book.create_sheet("Notes").append(["bench 3"])
    sheet = book.create_sheet("Data")
    sheet.append(["Bench 3", 7])
    sheet.append([])
    sheet.append(["Time", *HEAD[1:]])
    for t, p, s in zip(run.time_s, run.pressure_kpa, run.signal_mv, strict=True):
        sheet.append([NOON + timedelta(seconds=float(t)), float(p), float(s)])
    book.save(path)


def mat(path: Path, run: Run) -> None:
    """Write vectors in a MAT file of version 5."""
    from scipy.io import savemat

    savemat(path, arrays(run) | {"note": "bench 3", "gain": 2.0})


def simulink(path: Path, run: Run) -> None:
    """Write a structure with time."""
    from scipy.io import savemat

    signals = np.empty(2, object)
    for k, (label, values) in enumerate((("Pressure (kPa)", run.pressure_kpa), ("S1 (mV)", run.signal_mv))):
        signals[k] = {"values": values, "label": label, "dimensions": 1.0}
    savemat(path, {"out": {"time": run.time_s, "signals": signals, "blockName": "bench"}})


def mat73(path: Path, run: Run) -> None:
    """Write vectors as MATLAB 7.3 does: rows, behind a head of 512 bytes."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays(run).items():
            file.create_dataset(name, data=values[None, :])
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + b" " * 8 + b"\x00\x02IM")


def hdf5(path: Path, run: Run) -> None:
    """Write datasets in a group, with units, and a matrix."""
    import h5py

    with h5py.File(path, "w") as file:
        group = file.create_group("measurement")
        for name, unit, values in (("time", "ms", 1e3 * run.time_s), ("pressure", "bar", run.pressure_kpa / 100)):
            group.create_dataset(name, data=values).attrs["units"] = unit
        group.create_dataset("S1 (mV)", data=np.column_stack([run.signal_mv]))


def parquet(path: Path, run: Run) -> None:
    """Write a frame with stamps."""
    import pandas as pd

    stamps = pd.to_datetime(NOON) + pd.to_timedelta(np.round(run.time_s * 1e6), unit="us")
    pd.DataFrame({"Timestamp": stamps, HEAD[1]: run.pressure_kpa, HEAD[2]: run.signal_mv}).to_parquet(path)


def lvm(path: Path, run: Run) -> None:
    """Write a LabVIEW measurement: two heads, units in the second, a column of comments."""
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tOne",
            "***End_of_Header***\t", "", "Channels\t2\t\t", f"Samples\t{run.time_s.size}\t{run.time_s.size}",
            "Y_Unit_Label\tkPa\tmV", "X_Dimension\tTime\tTime", "Delta_X\t0.02\t0.02", "***End_of_Header***\t\t\t",
            "X_Value\tPressure\tSignal\tComment"]  # fmt: skip
    path.write_text("\n".join(run.lines("{:.6f}\t{:.6f}\t{:.6f}", "\n".join(head))) + "\n", encoding="utf-8")


def parquet_text(path: Path, run: Run) -> None:
    """Write a frame with stamps as text."""
    import pandas as pd

    stamps = [(NOON + timedelta(seconds=float(t))).isoformat(" ", "milliseconds") for t in run.time_s]
    pd.DataFrame({"Time": stamps, HEAD[1]: run.pressure_kpa, HEAD[2]: run.signal_mv}).to_parquet(path)


def parquet_zone(path: Path, run: Run) -> None:
    """Write a frame with stamps that name their zone."""
    import pandas as pd

    stamps = pd.to_datetime(NOON).tz_localize("Europe/Amsterdam") + pd.to_timedelta(np.round(run.time_s, 3), unit="s")
    pd.DataFrame({"Time": stamps, HEAD[1]: run.pressure_kpa, HEAD[2]: run.signal_mv}).to_parquet(path)


def hdf5_groups(path: Path, run: Run) -> None:
    """Write groups of pressure and sensor, each with a clock of its own."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, column, values in (("pressure", HEAD[1], run.pressure_kpa), ("sensor", HEAD[2], run.signal_mv)):
            group = file.create_group(f"run 1/{name}")
            group["time"], group[column] = run.time_s, values


def lvm_segments(path: Path, run: Run) -> None:
    """Write a LabVIEW measurement whose every 500 rows have a head of their own."""
    lvm(path, run)
    lines = path.read_text(encoding="utf-8").splitlines()
    own, rows = lines[7:14], lines[14:]
    parts = [line for k in range(0, len(rows), 500) for line in (*own, *rows[k : k + 500])]
    path.write_text("\n".join([*lines[:7], *parts]) + "\n", encoding="utf-8")


def scope(path: Path, run: Run) -> None:
    """Write what a scope of Simulink saves: a matrix of signals with an empty label."""
    from scipy.io import savemat

    signals = {"values": np.column_stack([run.pressure_kpa, run.signal_mv]), "label": "", "dimensions": 2.0}
    savemat(path, {"ScopeData": {"time": run.time_s, "signals": signals, "blockName": "bench/Scope"}})


def test_a_scope_is_mapped_by_number(tmp_path: Path, run: Run) -> None:
    """Its signals have no names: the columns are listed, and read once they are mapped."""
    scope(tmp_path / "scope.mat", run)
    with pytest.raises(BoatDaqError, match="no column was recognised as pressure_kpa, s1_mv"):
        import_csv(tmp_path / "scope.mat")
    is_the_truth(tmp_path / "scope.mat", columns={"pressure_kpa": "2:kPa", "s1_mv": "3:mV"})


def lvm_without_times(path: Path, run: Run) -> None:
    """Write a LabVIEW measurement without X columns, a comment in the first row."""
    lvm(path, run)
    lines = path.read_text(encoding="utf-8").replace("X_Columns\tOne", "X_Columns\tNo").splitlines()
    rows = ["\t" + line.partition("\t")[2] for line in lines[14:]]
    path.write_text("\n".join([*lines[:14], rows[0] + "\tbegin", *rows[1:]]) + "\n", encoding="utf-8")


def hdf5_labels(path: Path, run: Run) -> None:
    """Write a matrix with the titles of its columns, and their units."""
    import h5py

    with h5py.File(path, "w") as file:
        data = file.create_dataset(
            "run/data", data=np.vstack([1e3 * run.time_s, run.pressure_kpa / 100, run.signal_mv])
        )
        data.attrs["columns"] = ["time", "pressure", "signal"]
        data.attrs["units"] = np.array([b"ms", b"bar", b"mV"])


def hdf5_frame(path: Path, run: Run) -> None:
    """Write what pandas keeps of a frame with an index of stamps."""
    import h5py

    with h5py.File(path, "w") as file:
        group = file.create_group("df")
        group["axis0"] = group["block0_items"] = np.array([b"Pressure (kPa)", b"S1 (mV)"])
        group["block0_values"] = np.column_stack([run.pressure_kpa, run.signal_mv])
        noon = np.datetime64(NOON, "ns").astype(np.int64)
        group.create_dataset("axis1", data=noon + np.round(1e9 * run.time_s).astype(np.int64)).attrs["kind"] = (
            b"datetime64"
        )


def netcdf(path: Path, run: Run) -> None:
    """Write times by the CF conventions, and values named by their groups."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, unit, values in (("pressure", "kPa", run.pressure_kpa), ("signal", "mV", run.signal_mv)):
            group = file.create_group(f"entry/{name}")
            group.create_dataset("time", data=1e3 * run.time_s).attrs["units"] = (
                "milliseconds since 2024-05-26 11:59:30"
            )
            group.create_dataset("value", data=values).attrs["units"] = unit


def mat_labels(path: Path, run: Run) -> None:
    """Write a matrix, and the titles of its columns in a cell array."""
    from scipy.io import savemat

    data = np.column_stack([run.time_s, run.pressure_kpa, run.signal_mv])
    savemat(path, {"data": data, "columns": np.array(HEAD, dtype=object)})


def workbook_of_text(path: Path, run: Run) -> None:
    """Write numbers as text with decimal commas, below a merged title."""
    from openpyxl import Workbook

    book = Workbook()
    for row in (["Bench 3"], ["Zeit", "Druck", "Signal"], ["s", "kPa", "mV"]):
        book.active.append(row)
    book.active.merge_cells("A1:C1")
    for row in zip(run.time_s, run.pressure_kpa, run.signal_mv, strict=True):
        book.active.append([f"{value:.4f}".replace(".", ",") for value in row])
    book.save(path)


def parquet_index(path: Path, run: Run) -> None:
    """Write a frame whose index of stamps has no name."""
    import pandas as pd

    index = pd.to_datetime(NOON) + pd.to_timedelta(np.round(run.time_s * 1e6), unit="us")
    pd.DataFrame({HEAD[1]: run.pressure_kpa, HEAD[2]: run.signal_mv}, index=index).to_parquet(path)


OTHERS = {"none.lvm": lvm_without_times, "labels.h5": hdf5_labels, "frame.h5": hdf5_frame, "cf.nc": netcdf,
          "labels.mat": mat_labels, "text.xlsx": workbook_of_text, "index.parquet": parquet_index}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_titles_and_times_of_other_files(tmp_path: Path, run: Run, name: str) -> None:
    """Titles in attributes, cells or groups, and times in an index or a head: the samples are those of the run."""
    OTHERS[name](tmp_path / name, run)
    recording = import_csv(tmp_path / name)
    holds(recording, run)
    write_boat_file(tmp_path / "a.boat", recording, original=tmp_path / name)
    assert first_difference(tmp_path / "a.boat") == ""


def test_the_window_needs_no_rate_that_the_file_states(tmp_path: Path, run: Run, window: CsvImport) -> None:
    """A measurement without X columns is imported as it is; also where a cell of the first row is no number."""
    lvm_without_times(tmp_path / "a.lvm", run)
    text = (tmp_path / "a.lvm").read_text(encoding="utf-8")
    opened(window, put(tmp_path, [text.replace(f"{run.signal_mv[0]:.6f}", "OVLD").rstrip()], "a.lvm"))
    assert window.obstacle() == ""
    window.start("a")
    window._jobs.poll()
    assert first_difference(tmp_path / "a.boat") == ""
    assert load_recording(tmp_path / "a.boat").rate_hz == pytest.approx(50.0)


@pytest.mark.parametrize("kind", ["groups", "rates", "lvm"])
def test_channels_of_different_rates(tmp_path: Path, run: Run, kind: str) -> None:
    """They are brought onto one clock with all that was measured beside them; without times both rates are named."""
    import h5py

    if kind == "lvm":
        lvm_without_times(tmp_path / "a.lvm", run)
        text = (tmp_path / "a.lvm").read_text(encoding="utf-8").replace("Delta_X\t0.02\t0.02", "Delta_X\t0.1\t0.02")
        with pytest.raises(BoatDaqError, match=r"different intervals \(0.02 s, 0.1 s\)"):
            import_csv(put(tmp_path, [text], "a.lvm"))
        return
    slow = {"pressure": ("kPa", run.pressure_kpa[::5]), "laser": ("mm", run.pressure_kpa[::5] * 0.08)}
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, (unit, values) in (slow | {"signal": ("mV", run.signal_mv)}).items():
            data = file.create_dataset(f"{'s' if name == 'signal' else 'p'}/{name}", data=values)
            data.attrs["units"] = unit
            if kind == "rates":
                data.attrs["sample_rate"] = 50.0 if name == "signal" else 10.0
        if kind == "groups":
            file["p/time"], file["s/time"] = run.time_s[::5], run.time_s
    found = import_csv(tmp_path / "a.h5")
    assert "pressure_kpa interpolated at the times of the first" in "; ".join(found.meta["import_notes"])
    np.testing.assert_allclose(found.channel[:, 0], 0.08 * found.pressure_kpa, atol=1e-9)
    np.testing.assert_allclose(found.signal_mv[:, 0], run.signal_mv[: found.n])


def test_arrays_of_another_rate_without_times_are_named(tmp_path: Path, run: Run) -> None:
    """In the refusal, with their lengths."""
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["signal"], file["pressure"] = run.time_s, run.signal_mv, run.pressure_kpa[::5]
    with pytest.raises(BoatDaqError, match=r"without times of their own, left out: pressure \(1020\)"):
        import_csv(tmp_path / "a.h5")


WRITERS = {"lab.xlsx": workbook, "v5.mat": mat, "simulink.mat": simulink, "v73.mat": mat73, "lab.h5": hdf5,
           "lab.parquet": parquet, "lab.lvm": lvm, "segments.lvm": lvm_segments, "groups.h5": hdf5_groups,
           "text.parquet": parquet_text,
           "zone.parquet": parquet_zone}  # fmt: skip


@pytest.mark.parametrize("name", WRITERS)
def test_files_of_other_programs(tmp_path: Path, run: Run, window: CsvImport, name: str) -> None:
    """Each gives the known figures; the window shows its columns, and its import can be repeated from its bytes."""
    path = tmp_path / name
    WRITERS[name](path, run)
    is_the_truth(path)
    opened(window, path)
    assert window.obstacle() == ""
    assert {window.heading(i) for i in range(1, 1 + len(window.columns))} >= {"Time", "Pressure", "Sensor 1"}
    window.start("a")
    window._jobs.poll()
    assert first_difference(tmp_path / "a.boat") == ""
    assert load_recording(tmp_path / "a.boat").n == run.time_s.size


def test_the_window_joins_two_files(tmp_path: Path, run: Run, window: CsvImport) -> None:
    """The pressure's file alone is no run; with the file of the signals it is, whatever each has."""
    first = put(tmp_path, [line.rpartition(",")[0] for line in run.lines()], "a.csv")
    second = put(tmp_path, [f"{line.partition(',')[0]},{line.rpartition(',')[2]}" for line in run.lines()], "b.csv")
    opened(window, first)
    assert "sensor" in window.obstacle()
    with pytest.raises(BoatDaqError, match="is the first file"):
        window.join(first)
    window.join(second)
    assert window.obstacle() == ""
    assert "joined with b.csv" in window.summary()
    window.start("both")
    window._jobs.poll()
    are_the_truth(load_recording(tmp_path / "both.boat"), "b.csv begins")


def test_the_window_reads_a_capture_through_a_profile(tmp_path: Path, run: Run, window: CsvImport) -> None:
    """Lines with words are no table; the text profile of the board reads them."""
    form, lines = CAPTURES["JSON"]
    (tmp_path / "m.toml").write_text(profile_of(lines))
    opened(window, put(tmp_path, ["Ready.", *run.lines(form, "")], "capture.txt"))
    assert window.obstacle() != ""
    window.read_through(tmp_path / "m.toml")
    assert (window.obstacle(), window.failure) == ("", None)
    window.start("capture")
    window._jobs.poll()
    are_the_truth(load_recording(tmp_path / "capture.boat"))


@pytest.mark.parametrize("format", ["csv", "mat", "hdf5", "parquet"])
def test_own_exports_are_read(tmp_path: Path, run: Run, format: str) -> None:
    """Samples, unit and the mark SIMULATED come back."""
    first = import_csv(put(tmp_path, run.lines()))
    marked = replace(first, meta={**first.meta, "unit": "SA1", "simulated": True})
    path = tmp_path / f"out.{ {'hdf5': 'h5'}.get(format, format) }"
    export(marked, path, format)
    again = import_csv(path)
    np.testing.assert_allclose(again.signal_mv, first.signal_mv)
    assert (again.unit, again.simulated) == ("SA1", True)
    is_the_truth(path)


BROKEN = {
    "a.xlsx": b"PK\x03\x04broken", "a.mat": b"MATLAB 5.0 MAT-file broken", "a.h5": b"\x89HDF\r\n\x1a\nbroken",
    "a.parquet": b"PAR1broken",
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_refused(tmp_path: Path, name: str) -> None:
    """By its name."""
    (tmp_path / name).write_bytes(BROKEN[name])
    with pytest.raises(BoatDaqError, match=name):
        import_csv(tmp_path / name)


def test_a_capture_is_read_through_its_profile(cases: Path, tmp_path: Path) -> None:
    """The profile that is proposed from the capture reads it."""
    import tomli_w

    path = cases / "m18_serial_capture.txt"
    profile = tomli_w.dumps(propose(path.read_bytes()).content("monitor"))
    recording = import_capture(path, profile)
    are_the_truth(recording)
    write_boat_file(tmp_path / "a.boat", recording, original=path)
    assert first_difference(tmp_path / "a.boat", import_capture) == ""


CAPTURES = {
    "stamps of a monitor": ("12:00:00.125 -> {:.2f},{:.3f},{:.2f}", 'fields = [{ name = "time", unit = "s" }, '
                            '{ name = "pressure", unit = "kPa" }, { name = "s1_signal", unit = "mV" }]'),
    "JSON": ('{{"t": {:.2f}, "p": {:.3f}, "s": {:.2f}}}', 'style = "json"\nfields = [{ name = "time", unit = "s", '
             'label = "t" }, { name = "pressure", unit = "kPa", label = "p" }, { name = "s1_signal", unit = "mV", '
             'label = "s" }]'),
}  # fmt: skip


def profile_of(lines: str) -> str:
    """Return a text profile with these lines."""
    return f'name = "m"\nkind = "lines"\n[device]\nn_sensors = 1\nrate_hz = 50\n[lines]\n{lines}\n'


@pytest.mark.parametrize("name", CAPTURES)
def test_other_captures(tmp_path: Path, run: Run, name: str) -> None:
    """Text before the lines, and a torn last line, are left out and named."""
    form, lines = CAPTURES[name]
    profile = profile_of(lines)
    path = put(tmp_path, ["Ready.", *run.lines(form, "")], "capture.txt")
    path.write_bytes(path.read_bytes()[:-5])
    recording = import_capture(path, profile)
    are_the_truth(recording)
    last = f"line {1 + run.time_s.size}, the last one, has no line end"
    assert any(text.startswith(last) for text in recording.meta["import_notes"])
