"""The list of recordings: entries, exports, comparison, what can be done with them."""

from __future__ import annotations

import dataclasses
import os
from unittest.mock import Mock

import numpy as np
import pytest

from analysis.fidelity import fidelity
from boat_daq.engine.settings import UnitLibrary
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.results import runs
from boat_daq.viewmodels.results.run_entry import NONE_CHOSEN, RunEntry, obstacle, read_run, selection_text
from boat_daq.viewmodels.results.run_result import compare_runs
from boat_daq.viewmodels.results.runs import RunsModel
from boat_daq.workflows.jobs import JobRunner
from boat_daq.workflows.run_files import report_runs
from protocol.base.errors import RequestError
from protocol.base.units import ShownUnits
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import connected, idle
from tests.boat_daq.viewmodels.helpers import until


def test_entries_show_what_each_recording_is(recording, tmp_path):
    """Unit, length, cycles and readings are in the list; a broken file is listed with its reason."""
    run = read_run(recording)
    assert run.cells[1].startswith("SA1")
    assert "SIMULATED" in run.cells[1]
    assert run.cells[4].startswith("2")
    assert run.cells[5] == "37"
    assert " long, 2 cycles" in run.tip  # also where the list has no room for the column
    assert len(run.outline) >= 2
    broken = tmp_path / "x.boat"
    broken.write_bytes(b"")
    assert read_run(broken).cells[6].startswith("\u25a0")


def test_list_arrives_by_polling(recording, tmp_path):
    """The folder is read in the background; a second reading without change is no change."""
    model = RunsModel(recording.parent, UnitLibrary(tmp_path), JobRunner(), Notices(), UndoHistory())
    assert model.nothing()[0].startswith("Loading")  # it was "No recording yet" with eight of them
    model.scan()
    until(lambda: (model.poll(), model.runs)[1])
    assert model.nothing()[0] == "No recording yet"
    revision = model.revision
    model.scan()
    until(lambda: (model.poll(), model._future is None)[1])
    assert model.revision == revision
    assert model.interrupted() == []
    with pytest.raises(RequestError, match="one recording"):
        model.export([], tmp_path / "x.csv")
    with pytest.raises(RequestError, match="no recording"):
        model.report([], tmp_path / "x.pdf")
    with pytest.raises(RequestError, match="chosen to compare"):
        model.compare([recording])
    model.close()


@pytest.mark.skipif(os.name != "posix", reason="a link without its file stands for a deleted one")
def test_offer_to_recover_leaves_once_it_is_taken_on_the_page(monkeypatch, tmp_path):
    """ "SA1.boat was not closed" stayed beside the recovered file."""
    notices, path = Notices(), tmp_path / "SA1.boat"
    model = RunsModel(tmp_path, UnitLibrary(tmp_path), JobRunner(), notices, UndoHistory())
    monkeypatch.setattr(model, "interrupted", lambda: [path])
    monkeypatch.setattr(model, "start", lambda *_: None)
    model.offer_recovery()
    assert notices.current().action_text == "Recover"
    model.recover(path)
    assert notices.current() is None
    model.close()


def test_file_deleted_during_a_scan_is_left_out(recording, tmp_path):
    """A recording that is gone between listing and reading ends neither scan nor choice; one not saved is marked."""
    (tmp_path / "whole.boat").symlink_to(recording)
    (tmp_path / "gone.boat").symlink_to(tmp_path / "nowhere")
    model = RunsModel(tmp_path, UnitLibrary(tmp_path), JobRunner(), Notices(), UndoHistory())
    assert model.newest() == tmp_path / "whole.boat"
    model.scan()
    until(lambda: (model.poll(), model.runs)[1])
    (run,) = model.runs
    assert model.cells(run) == run.cells
    model.follow(dataclasses.replace(connected(), recording=run.path, not_saving="the disk is full"))
    assert "\u25a0 NOT SAVING" in model.cells(run)  # as in the header
    model.close()


def test_units_are_those_of_the_board_in_use(tmp_path):
    """Both kinds are listed while no board is connected, the simulated ones marked."""
    model = RunsModel(tmp_path, UnitLibrary(tmp_path), JobRunner(), Notices(), UndoHistory())
    units = UnitLibrary(tmp_path)
    for simulated, mv in ((False, 40.0), (True, 50.0)):
        content = {"simulated": simulated, "sensors": [{"figures": {"sensitivity_mv_per_mm": mv}}]}
        units.of(simulated=simulated).add_calibration("SA1", content)

    def shown(snapshot):
        model.follow(snapshot)
        model.scan()
        until(lambda: (model.poll(), model._future is None)[1])
        return [(line[0], line[2]) for line in model.unit_lines]

    real, virtual = ("SA1", "40.0"), ("SA1  SIMULATED", "50.0")
    assert shown(idle()) == [real, virtual]
    assert shown(connected()) == [virtual]
    assert shown(dataclasses.replace(connected(), simulated=False)) == [real]
    model.shown_units = ShownUnits.of("V")
    assert shown(dataclasses.replace(connected(), simulated=False)) == [("SA1", "0.0400")]
    model.close()


def test_history_shows_the_name_of_a_renamed_recording(closed, tmp_path):
    """An accepted calibration keeps the recording's UUID; the name that it had then is shown only where it is gone."""
    units = UnitLibrary(tmp_path)
    model = RunsModel(tmp_path, units, JobRunner(), Notices(), UndoHistory())
    for uuid in (read_run(closed).summary.uuid, "gone"):
        units.add_calibration("SA1", {"recording_id": uuid}, recording="before.boat")
    model.scan()
    until(lambda: (model.poll(), model._future is None)[1])
    assert [line[3] for line in model.unit_lines] == ["before.boat", closed.name]
    model.close()


def test_newest_recording_is_of_the_kind_of_the_board(closed, tmp_path):
    """A file that cannot be read is neither a simulated nor a real recording."""
    (tmp_path / "z.boat").write_bytes(b"")
    model = RunsModel(tmp_path, UnitLibrary(tmp_path), JobRunner(), Notices(), UndoHistory())
    assert model.newest(simulated=True) == closed
    assert model.newest(simulated=False) is None
    model.close()


def test_run_compared_with_itself_has_no_difference(recording, tmp_path):
    """The difference of two equal runs is zero over the range."""
    model = RunsModel(recording.parent, UnitLibrary(tmp_path), JobRunner(), Notices(), UndoHistory())
    model.comparison = compare_runs([recording, recording])
    lines, words = model.comparison_lines()
    assert len(lines) == 2
    assert np.abs(lines[0][1][1]).max() < 1e-6
    assert words == "1: SA1   2: SA1"
    first, second = model.comparison
    bare = Mock(path="/x/bare.boat", calibrated=False)
    notices = Mock()
    model._notices = notices
    model.take_comparison((first, second, bare))
    assert model.comparison == (first, second, bare)
    notices.inform.assert_called_once_with("left out: bare.boat has no calibration curve")
    model.take_comparison((first, bare))  # it ended without a word
    assert model.comparison == ()
    assert notices.add.call_args.args[1] == "nothing to compare: bare.boat has no calibration curve"
    model.close()


def test_runs_that_did_not_finish_are_resumable(closed):
    """A finished run cannot; one that was stopped, or killed, can; one that is recorded now cannot."""
    run = read_run(closed)
    assert (run.closed, run.resumable) == (True, False)

    def as_if(**changed: object) -> RunEntry:
        return dataclasses.replace(run, summary=dataclasses.replace(run.summary, **changed))

    assert as_if(run_end=RunEnd.FAULT).resumable
    assert as_if(status="interrupted", run_end=None).resumable
    assert not as_if(status="recording", run_end=None).resumable
    assert not as_if(run_end=RunEnd.STOPPED, steps=0).resumable
    assert not dataclasses.replace(run, summary=None).resumable


def test_obstacle_names_why_an_action_is_refused(closed):
    """Before, grey buttons had no reason; both sides of each border."""
    good = read_run(closed)
    damaged = dataclasses.replace(good, summary=None, problem="it is no recording")
    written = dataclasses.replace(good, summary=dataclasses.replace(good.summary, status="recording"))
    actions = ("open", "repeat", "export", "readings", "report", "compare")

    def refused(*chosen: RunEntry) -> set[str]:
        return {action for action in actions if obstacle(action, chosen)}

    assert refused() == set(actions)
    assert refused(good) == {"compare"}
    assert refused(written) == {"compare", "readings"}
    assert refused(good, good) == refused(*[good] * 4) == set(actions) - {"report", "compare"}
    assert refused(*[good] * 5) == set(actions) - {"report"}
    assert refused(damaged) == refused(good, damaged) == set(actions)
    real = dataclasses.replace(good, summary=dataclasses.replace(good.summary, simulated=False))
    assert refused(good, real) == set(actions)
    assert "not compared" in obstacle("report", [good, real])
    assert obstacle("report", [good, damaged]) == "older.boat: it is no recording."
    assert "2 recordings are chosen" in obstacle("open", [good, good])
    assert (selection_text([]), selection_text([damaged])) == (NONE_CHOSEN, damaged.problem)
    assert "37 readings" in selection_text([good])


def test_report_has_the_precision_and_units_of_the_program(monkeypatch, tmp_path):
    """The report of the window was made at normal fidelity, whatever was chosen."""
    ordered = []
    monkeypatch.setattr(runs, "Job", lambda *args, **kwargs: ordered.append((args, kwargs)) or Mock())
    model = RunsModel(tmp_path, UnitLibrary(tmp_path), Mock(), Notices(), UndoHistory())
    model.fidelity = fidelity("reference")
    model.report([tmp_path / "a.boat"], tmp_path / "a.pdf", curve="2")
    ((_, *args), kwargs) = ordered[0]
    assert args == [report_runs, [tmp_path / "a.boat"], tmp_path / "a.pdf"]
    how = {"level": "reference", "units": model.shown_units}
    assert kwargs == {"curve": "2", **how}
    model.close()


def test_jobs_of_other_files_run_beside_each_other(monkeypatch, tmp_path):
    """A PDF and an HTML report were requested, and two recoveries: the second of each cancelled the first unsaid."""
    made = []
    monkeypatch.setattr(runs, "Job", lambda *args, **kwargs: made.append(Mock()) or made[-1])
    model = RunsModel(tmp_path, UnitLibrary(tmp_path), JobRunner(), Notices(), UndoHistory())
    recording = tmp_path / "a.boat"
    model.report([recording], tmp_path / "a.pdf")
    model.report([recording], tmp_path / "a.html")
    model.export([recording], tmp_path / "a.csv")
    model.export([recording], tmp_path / "a.parquet")
    model.recover(recording)
    model.recover(tmp_path / "b.boat")
    assert model.jobs.running() == made
    assert not any(job.cancel.called for job in made)
    model.report([recording], tmp_path / "a.pdf")  # the same file again
    assert [job.cancel.called for job in made] == [True, *[False] * 6]
    model.close()
