"""An analysis with what the lab's plugins add: their figures, and a warning for each plugin that failed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from boat_daq.engine.plugins import FIGURES, HOOKS, installed, lab_figures, run_hooks

if TYPE_CHECKING:
    from analysis.figures.pipeline import Analysis


def with_plugins(analysis: Analysis, run: str) -> Analysis:
    """Return an analysis with the figures of the lab, after the hooks were told of it."""
    from analysis.figures.figure import LabFigure
    from analysis.numbers import finite
    from analysis.warning import Warning, WarningCode

    failures: list[Warning] = []

    def warn(cause: str, remedy: str) -> None:
        failures.append(Warning(WarningCode.PLUGIN, "", f"{cause}; {remedy}"))

    if installed(FIGURES):
        found = lab_figures(run, finite(analysis.to_json()), warn)
        figures = tuple(LabFigure(f["label"], f["unit"], tuple(f["values"]), f["plugin"]) for f in found)
        analysis = replace(analysis, lab_figures=figures)
    if installed(HOOKS):
        run_hooks("analysis_done", {"run": run, "analysis": finite(analysis.to_json())}, warn)
    return replace(analysis, warnings=(*analysis.warnings, *failures)) if failures else analysis
