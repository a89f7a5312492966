"""Why something cannot be done with the chosen recordings, in a sentence; empty where it can."""

from __future__ import annotations

from collections.abc import Sequence

from boat_daq.viewmodels.common.formatting import count
from boat_daq.viewmodels.results.runs import MOST_COMPARED, Run

ONE, SOME, TWO = (
    "Choose a recording in the list.",
    "Choose one or more recordings in the list.",
    "two to four recordings",
)
NONE_CHOSEN = "Choose a recording to calibrate, replay or export it, or two to four to compare them."


def told(chosen: Sequence[Run]) -> str:
    """Return what stands under the list: what to choose, or what is to be known of what is chosen."""
    if not chosen:
        return NONE_CHOSEN
    if len(chosen) > 1:
        return f"{count(len(chosen), 'recording')} are chosen: for a report, or to be compared."
    return " \u00b7 ".join(chosen[0].hover.splitlines())


def obstacle(deed: str, chosen: Sequence[Run]) -> str:
    """Return why `deed` (a button's key) cannot be done with `chosen`."""
    if deed == "report":
        return _readable(chosen) if chosen else SOME
    if deed == "compare":
        return _comparable(chosen)
    if not chosen:
        return ONE
    if len(chosen) > 1:
        return f"{count(len(chosen), 'recording')} are chosen; choose only one."
    if deed == "readings" and chosen[0].summary is not None and not chosen[0].closed:
        return "Its readings can be corrected once the recording is closed or recovered."
    return _readable(chosen)


def _readable(chosen: Sequence[Run]) -> str:
    return next((f"{run.path.name}: {run.problem}." for run in chosen if run.summary is None), "")


def _comparable(chosen: Sequence[Run]) -> str:
    if not 2 <= len(chosen) <= MOST_COMPARED:
        now = f"{count(len(chosen), 'recording')} {'is' if len(chosen) == 1 else 'are'} chosen" if chosen else "none is"
        return f"Choose two to four recordings (Ctrl and click, or Shift and an arrow); {now}."
    return _readable(chosen)
