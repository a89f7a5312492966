"""The import of a CSV: what is proposed, what the operator changes, what is written and remembered."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import load_recording
from analysis.data.boat_writer import first_difference
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.results import csv_import
from boat_daq.viewmodels.results.csv_import import CsvImport, Source
from boat_daq.workflows.jobs import JobRunner
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.helpers import DirectJob


@pytest.fixture
def table(tmp_path):
    """Twenty rows: milliseconds, bar, an unknown unit, two voltages with titles that say nothing."""
    rows = [f"{10 * i};{0.01 * i:.2f};{i};{1.5 + 0.01 * i:.3f};{1.4 + 0.01 * i:.3f}" for i in range(20)]
    file = tmp_path / "lab.csv"
    file.write_text("\n".join(["Time (ms);Pressure (bar);Target (furlong);left (V);right (V)", *rows, ""]))
    return file


@pytest.fixture
def model(tmp_path, monkeypatch):
    """The import into a folder, with jobs done at once."""
    monkeypatch.setattr(csv_import, "Job", DirectJob)
    made = CsvImport(tmp_path / "runs", JobRunner(), Preferences(tmp_path), lambda path, noted: done.append(path))
    done: list = []
    made.done = done
    return made


def opened(model, file):
    """Open a file and let the job end."""
    model.open(file)
    while model.reading:
        model._jobs.poll()
    return model


def test_columns_are_proposed_from_titles_and_units(model, table):
    """Time and pressure are recognised; an unknown unit is a warning, not a refusal; the signals are to be chosen."""
    opened(model, table)
    assert (model.sources["time_s"], model.sources["pressure_kpa"]) == (Source(1, "ms"), Source(2, "bar"))
    assert model.sources["target_kpa"] == model.sources["s1_mv"] == Source(0, "")
    assert any("furlong" in warning for warning in model.warnings())
    assert model.obstacle() == "Choose the column of at least one sensor."
    assert "20 rows, 5 columns; separator semicolon, decimal point" in model.summary()
    assert model.columns[3].first[0] == "1.5"
    with pytest.raises(RequestError):
        model.start("lab")


def test_chosen_columns_are_imported_and_can_be_verified(model, table):
    """What is chosen is what the recording holds, in our units; the import can be repeated from its own bytes."""
    opened(model, table)
    model.choose("s1_mv", Source(4, "v"))
    model.choose("s2_mv", Source(4, "v"))  # one column is one quantity
    assert model.sources["s1_mv"].column == 0
    model.choose("s1_mv", Source(5, ""))
    assert model.units("s1_mv")[0] == model.sources["s1_mv"].unit == "mv"
    model.choose("s1_mv", Source(5, "v"))
    assert model.obstacle() == ""
    model.start(model.name)
    model._jobs.poll()
    (path,) = model.done
    recording = load_recording(path)
    assert np.allclose(recording.signal_mv[0], [1400.0, 1500.0])
    assert np.allclose(recording.pressure_kpa, np.arange(20.0))
    assert recording.duration_s == pytest.approx(0.19)
    assert first_difference(path) == ""
    opened(model, table)
    with pytest.raises(RequestError, match="exists already"):
        model.start(path.name)


def test_choices_are_kept_for_files_with_the_same_columns(model, table, tmp_path):
    """The next file of the same kind needs no choice; its free name is proposed; another kind begins anew."""
    opened(model, table)
    model.choose("s1_mv", Source(4, "v"))
    model.start("lab")
    model._jobs.poll()
    opened(model, table)
    assert (model.sources["s1_mv"], model.name) == (Source(4, "v"), "lab-2")
    other = tmp_path / "other.csv"
    other.write_text("time_s,pressure_kpa,s1_mv\n0,1,2\n1,2,3\n2,3,4\n")
    opened(model, other)
    assert (model.sources["s1_mv"], model.obstacle()) == (Source(3, "mv"), "")


def test_rate_replaces_a_missing_time(model, tmp_path):
    """Without a column of time the rate is required, and used."""
    file = tmp_path / "untimed.csv"
    file.write_text("pressure_kpa,s1_mv\n" + "".join(f"{i % 3},{1600 + i % 4}\n" for i in range(9)))
    opened(model, file)
    assert "rate" in model.obstacle()
    model.rate = "fast"
    assert "rate" in model.obstacle()
    model.rate = "10"
    assert model.obstacle() == ""
    model.start("untimed")
    model._jobs.poll()
    assert load_recording(model.done[0]).duration_s == pytest.approx(0.8)


def test_separator_can_be_given(model, tmp_path):
    """A file that two separators explain is read by the one that is chosen, and verified by it."""
    file = tmp_path / "comma.csv"
    file.write_text("time_s;pressure_kpa;s1_mv\n" + "\n".join(f"{i},5;{i},0;16{i},5" for i in range(9)))
    opened(model, file)
    model.separate(",")
    while model.reading:
        model._jobs.poll()
    assert model.summary() != ""
    model.separate(";")
    while model.reading:
        model._jobs.poll()
    assert model.sources["s1_mv"].column == 3
    model.start("comma")
    model._jobs.poll()
    assert load_recording(model.done[0]).meta["import_separator"] == ";"
    assert first_difference(model.done[0]) == ""


def test_what_is_no_table_is_refused_with_its_cause(model, tmp_path):
    """A text without numbers: the cause is shown, and nothing can be imported."""
    file = tmp_path / "letter.csv"
    file.write_text("Dear all,\nno numbers here.\n")
    opened(model, file)
    assert "no rows of numbers" in model.summary()
    assert model.obstacle() != ""
