"""Exports, reports and comparisons of recordings, made in a helper process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from boat_daq.viewmodels.results.analysis_view import RunResult
from boat_daq.viewmodels.results.calibration_jobs import analyse_run

Progress = Callable[[float, float], None]


def export_run(
    path: Path, target: Path, kind: Literal["csv", "parquet"], *, progress: Progress | None = None
) -> list[Path]:
    """Write the samples of a recording; returns the files written.

    Parameters
    ----------
    path : of the recording.
    target : where the samples are written.
    kind : of file.
    progress : is called with what is done and the total.

    Raises
    ------
    AnalysisError : it cannot be read, or the target cannot be written.
    """
    from analysis.data.export import export
    from analysis.data.load import load_recording

    return export(load_recording(path), target, kind, progress=progress)


def report_runs(paths: list[Path], target: Path, *, progress: Progress | None = None) -> str:
    """Write the report of one or several recordings; returns its verdict.

    Parameters
    ----------
    paths : of the recordings.
    target : .html or .pdf.
    progress : is called with the recordings done and their number.

    Raises
    ------
    AnalysisError : one of them cannot be read, or the target cannot be written.
    """
    from analysis import write_report
    from analysis.figures.pipeline import analyse

    analyses = []
    for done, path in enumerate(paths):
        if progress is not None:
            progress(done, len(paths) + 1)
        analyses.append(analyse(path))
    return write_report(analyses, target).verdict


def compare_runs(paths: list[Path], *, progress: Progress | None = None) -> tuple[RunResult, ...]:
    """Return the analyses of several recordings.

    Raises
    ------
    AnalysisError : one of them cannot be read.
    """
    results = []
    for done, path in enumerate(paths):
        results.append(analyse_run(str(path)))
        if progress is not None:
            progress(done + 1, len(paths))
    return tuple(results)
