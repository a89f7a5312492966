"""One line of the list of recordings, and which actions are possible with the chosen lines.

Rules: a line is read from heads and overviews, never from samples. A damaged file is listed with its reason.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from boat_daq.engine.recording.summary import Summary, pressure_outline, summarise
from boat_daq.formatting import count, duration
from protocol.base.errors import BoatDaqError, DamagedRecordingError
from protocol.base.units import NOTHING
from protocol.recording import RunEnd

RUN_HEADINGS = ("", "Unit", "Recorded (UTC)", "Length", "Cycles", "Readings", "State", "File")
_POINTS = 160  # of a thumbnail
MOST_COMPARED = 4
_STATES = {
    "closed": "\u25cf finished", "recovered": "\u25cf recovered", "recording": "\u25b6 recording",
    "interrupted": "\u25b2 interrupted",
}  # fmt: skip
CHOOSE_ONE, CHOOSE_SOME = "Choose a recording in the list.", "Choose one or more recordings in the list."
_CHANGES = ("readings", "rename", "note", "marker", "metadata")  # of a recording
NONE_CHOSEN = "Choose a recording to open it, or two to four to compare them."


@dataclass(frozen=True, slots=True)
class RunEntry:
    """One line of the list; `outline` is the pressure's (time, low, high) in the unit square."""

    path: Path
    summary: Summary | None
    problem: str = ""
    damaged: bool = False  # whether it may be recovered, where it cannot be read
    outline: tuple[tuple[float, float, float], ...] = ()

    @property
    def recoverable(self) -> bool:
        """Whether a killed session left it open, or it is damaged."""
        return self.damaged or (self.summary is not None and self.summary.status == "interrupted")

    @property
    def closed(self) -> bool:
        """Whether the file is closed, so that readings may be added."""
        return self.summary is not None and self.summary.status in ("closed", "recovered")

    @property
    def resumable(self) -> bool:
        """Whether its run ended early and can be resumed."""
        s = self.summary
        return s is not None and s.status != "recording" and s.run_end is not RunEnd.FINISHED and s.steps > 0

    @property
    def note(self) -> str:
        return (self.summary.note if self.summary is not None else None) or ""

    def matches(self, words: str) -> bool:
        """Whether every word is in its line or its tooltip, whatever its case."""
        text = " ".join((*self.cells, self.tip)).casefold()
        return all(word in text for word in words.casefold().split())

    @property
    def tip(self) -> str:
        s = self.summary
        if s is None:
            return self.problem
        breaks = [
            f"interrupted after {count(b.complete_cycles, 'cycle')}: {b.cause}"
            + (f", for {duration(b.break_s)}" if b.break_s is not None else "")
            for b in s.breaks
        ]
        operator, lost = f"operator {s.operator}" if s.operator else "", f"{count(s.lost_samples, 'sample')} lost"
        lost = lost if s.missing.exact else f"at least {lost}"
        cycles = count(s.cycles.complete, "cycle") + (f" + {s.cycles.partial} partial" if s.cycles.partial else "")
        length = f"{duration(s.duration_s)} long, {cycles}, {count(s.readings, 'reading')}"
        parts = (self.path.name, length, *breaks, s.note, operator, s.stop_reason, lost, *s.missing.lines())
        return "\n".join(filter(None, parts))

    @property
    def cells(self) -> tuple[str, ...]:
        """The line as texts, in the order of `RUN_HEADINGS`."""
        s = self.summary
        if s is None:
            return ("", *(NOTHING,) * 5, "\u25a0 cannot be read", self.path.name)
        simulated = "  SIMULATED" if s.simulated else ""
        cycles = str(s.cycles.complete) + (f" + {s.cycles.partial} partial" if s.cycles.partial else "")
        state = _state(s) + (f", {count(len(s.breaks), 'interruption')}" if s.breaks else "")
        unit, started = f"{s.unit or NOTHING}{simulated}", s.started_utc[:16].replace("T", "  ")
        return ("", unit, started, duration(s.duration_s), cycles, str(s.readings), state, self.path.name)


def _state(s: Summary) -> str:
    """Return the state of a recording: a closed file may hold a run that did not reach its end."""
    if s.status == "closed" and s.run_end in (RunEnd.ABORTED, RunEnd.FAULT):
        return "\u25b2 aborted"
    if s.status == "closed" and s.run_end is RunEnd.STOPPED:
        return "\u25a0 stopped early"
    return _STATES.get(s.status, s.status)


def read_run(path: Path) -> RunEntry:
    """Return one line of the list; a file that cannot be read is a line with its problem."""
    try:
        return RunEntry(path, summarise(path), outline=pressure_outline(path, _POINTS))
    except BoatDaqError as error:
        return RunEntry(path, None, error.cause, isinstance(error, DamagedRecordingError))
    except (OSError, sqlite3.Error, KeyError, ValueError) as error:
        return RunEntry(path, None, f"cannot be read: {error}", isinstance(error, sqlite3.Error))


def sort_key(run: RunEntry) -> tuple[str, str]:
    """Return start and name: the place of a line in the list does not change while its file is written."""
    return (run.summary.started_utc if run.summary is not None else "", run.path.name)


def selection_text(chosen: Sequence[RunEntry]) -> str:
    """Return the line under the list: what to choose, or the details of what is chosen."""
    if not chosen:
        return NONE_CHOSEN
    if len(chosen) > 1:
        return f"{count(len(chosen), 'recording')} are chosen, for a report or to be compared."
    return " \u00b7 ".join(chosen[0].tip.splitlines())


def obstacle(button: str, chosen: Sequence[RunEntry]) -> str:
    """Return why a button (its key) cannot be used with the chosen recordings; empty where it can."""
    if button == "compare" and not 2 <= len(chosen) <= MOST_COMPARED:
        now = f"{count(len(chosen), 'recording')} {'is' if len(chosen) == 1 else 'are'} chosen" if chosen else "none is"
        return f"Choose two to four recordings (Ctrl and click, or Shift and an arrow); {now}."
    if not chosen:
        return CHOOSE_SOME if button == "report" else CHOOSE_ONE
    if len(chosen) > 1 and button not in ("report", "compare"):
        return f"{count(len(chosen), 'recording')} are chosen; choose only one."
    if (
        button in ("report", "compare")
        and len({run.summary.simulated for run in chosen if run.summary is not None}) > 1
    ):
        return "Simulated and real recordings are chosen; they are not compared."
    if button in _CHANGES and chosen[0].summary is not None and not chosen[0].closed:
        later = "It can be changed once the recording is closed or recovered."
        return f"{later} While it is recorded: Session, Metadata." if button == "metadata" else later
    return next((f"{run.path.name}: {run.problem}." for run in chosen if run.summary is None), "")
