"""The trade-off page: time against error of each method on this computer, and the settings that the rule chooses.

Rules: methods are measured in a helper process. The last result is kept beside the window's preferences and shown at
the next start; methods that were not measured again keep theirs, with their own date.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from boat_daq.engine.toml_values import read_json
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.common.formatting import count
from boat_daq.viewmodels.common.jobs import Job, JobRunner
from boat_daq.viewmodels.common.measured_result import MAX_BYTES, MeasuredResult
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.models.tradeoff_jobs import measure_methods
from boat_daq.viewmodels.models.tradeoff_report import MethodChart, merged, read_report, report_columns

METHODS = {
    "tracer": "Ray tracer",
    "ranking": "Ranking of the designs",
    "full-fem": "Full model of actuator",
    "reduced-fem": "Fast model of actuator",
    "posterior": "Uncertainty (posterior)",
    "inverse": "Signal to elongation",
    "segmentation": "Plateaus and cycles",
    "bootstrap": "Intervals (bootstrap)",
    "decimation": "Live plot",
}
"""Every method that can be measured, by its name in the command; a test compares it with the command's list."""
MAPPED = {"fit": "Fit of the calibration", "figures": "SNR and hysteresis", "alarms": "Alarms of the shadow"}
"""Methods that have a map of where they fail, but no chart of time against error."""
ENTRIES = METHODS | MAPPED
Measurer = Callable[[Sequence[str], bool], dict[str, Any]]
FILE = "tradeoff.json"
CHOSEN, QUICK, SHOWN = "tradeoff_methods", "tradeoff_quick", "tradeoff_shown"


class TradeoffModel(MeasuredResult):
    """State of the page.

    Parameters
    ----------
    jobs : where methods are measured.
    folder : where the last result is kept.
    preferences : keep the choices.
    """

    name, noun, again = "tradeoff", "result", "measure again"

    def __init__(self, jobs: JobRunner, folder: Path, preferences: Preferences) -> None:
        self.preferences = preferences
        self.measurer: Measurer = measure_methods  # the window has one that paints, too
        self.charts: dict[str, MethodChart] = {}
        super().__init__(jobs, folder / FILE)

    # ---- what is chosen ------------------------------------------------------------------------------------------

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the methods that a measurement takes."""
        kept = self.preferences.get(CHOSEN, list(METHODS))
        return tuple(name for name in METHODS if name in kept)

    def choose(self, name: str, on: bool) -> None:
        """Include a method in the next measurement, or not."""
        self.preferences.set(CHOSEN, [n for n in METHODS if (on if n == name else n in self.chosen)])

    @property
    def quick(self) -> bool:
        """Whether the next measurement is the quick one."""
        return bool(self.preferences.get(QUICK, True))

    def set_quick(self, on: bool) -> None:
        """Choose the quick measurement or the full one."""
        self.preferences.set(QUICK, on)

    @property
    def shown(self) -> str:
        """Name of the method that is shown."""
        name = str(self.preferences.get(SHOWN, ""))
        return name if name in ENTRIES else next(iter(ENTRIES))

    def show(self, name: str) -> None:
        """Show a method."""
        self.preferences.set(SHOWN, name)
        self.revision += 1

    @property
    def chart(self) -> MethodChart | None:
        """The chart of the shown method, where it was measured."""
        return self.charts.get(self.shown)

    # ---- measuring -----------------------------------------------------------------------------------------------

    def toggle(self) -> None:
        """Start measuring the chosen methods, or stop.

        Raises
        ------
        OperatorError : no method is chosen.
        """
        if self.job is not None:
            self.jobs.cancel(self.name)
            return
        if not self.chosen:
            raise OperatorError("no method is chosen", "Tick one or more in the list of methods.")
        label = f"Measuring {count(len(self.chosen), 'method')}"
        self._start(Job(label, self.measurer, self.chosen, self.quick))

    def _read(self, content: Any) -> None:
        self.charts = read_report(content)

    def _joined(self, fresh: dict[str, Any]) -> dict[str, Any]:
        return merged(self.content, fresh)

    # ---- files ---------------------------------------------------------------------------------------------------

    def load(self, path: Path) -> None:
        """Show the result in a file, and keep it.

        Raises
        ------
        OperatorError : it cannot be read, or is no such result.
        """
        self.take(read_json(path, MAX_BYTES))
        self._store()

    def save(self, path: Path) -> None:
        """Write the result by the suffix of `path`: .json as the command, .csv with a row for each point.

        Raises
        ------
        OperatorError : nothing has been measured.
        OSError : the path cannot be written.
        """
        if self.content is None:
            raise OperatorError("nothing has been measured yet", "Press Measure, or open a result.")
        if path.suffix == ".csv":
            tables.save_csv(path, report_columns(self.charts))
        else:
            self._write_json(path)

    # ---- texts ---------------------------------------------------------------------------------------------------

    def entry(self, name: str) -> str:
        """Return the second line of a method in the list."""
        chart = self.charts.get(name)
        if name in MAPPED:
            return "map only"
        if chart is None:
            return "not measured yet"
        verdict = "default confirmed" if chart.default_is_chosen else "the rule chose another"
        return f"{chart.mark} {verdict}"

    def status(self) -> str:
        """Return the progress of the measurement, or what went wrong, in a line."""
        return self._progress_text()
