"""Files made from recordings: they read back, and their progress rises."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

from analysis import load_recording
from boat_daq.workflows.run_files import export_calibration, export_run, report_runs
from tests.boat_daq.viewmodels.helpers import SAMPLE


def test_exports_read_back(tmp_path):
    """The exported CSV has every sample, and its elongation by the run's own calibration."""
    assert export_run(SAMPLE, tmp_path / "run.csv") == ""
    assert load_recording(tmp_path / "run.csv").n == load_recording(SAMPLE).n
    assert json.loads((tmp_path / "run.json").read_text())["calibration"]["unit"] == "SA1"


def test_calibration_is_exported_in_the_form_of_its_suffix(tmp_path):
    """A C header with the chosen curve, with what must be known of it."""
    notes = export_calibration(SAMPLE, tmp_path / "boat_calibration.h", curve="2")
    assert "not traceable" in notes
    assert "int pieces, degree;" in (tmp_path / "boat_calibration.h").read_text()


def test_report_progress_rises_through_its_parts(monkeypatch, tmp_path):
    """Each run's analysis, then the pages: the fraction rises from part to part and ends at one."""
    seen, levels = [], []

    def in_steps(result):
        def work(*_, progress, options=None, **__):
            levels.extend([options.fidelity] if options is not None else [])
            for step in (1, 2):
                progress(step, 2)
            return result

        return work

    monkeypatch.setattr("analysis.load_recording", lambda path: SimpleNamespace(unit="", simulated=True, identity="a"))
    monkeypatch.setattr("analysis.figures.pipeline.analyse", in_steps("analysed"))
    monkeypatch.setattr("analysis.write_report", in_steps(SimpleNamespace(verdict="PASSES")))
    runs, target = [Path("a.boat"), Path("b.boat")], tmp_path / "r.pdf"
    progress = lambda done, total: seen.append(done / total)  # noqa: E731
    assert report_runs(runs, target, level="draft", progress=progress) == "PASSES"
    assert seen == [0.125, 0.25, 0.375, 0.5, 0.75, 1.0]
    assert levels == ["draft", "draft"]
    written = Mock()  # one calibration run is compared with the shadow, as by the command
    monkeypatch.setattr("analysis.write_report", written)
    monkeypatch.setattr("analysis.figures.pipeline.analyse", in_steps(SimpleNamespace(kind="calibration")))
    monkeypatch.setattr("analysis.figures.against_shadow.against_shadow", lambda _: "shadow")
    report_runs(runs[:1], target, progress=progress)
    assert written.call_args.kwargs["shadow"] == "shadow"
