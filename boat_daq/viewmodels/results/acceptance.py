"""What the calibration page says of a run: what its curve rests on, what is missing for one, what is poor about it.

Rules: one count of plateaus for the whole window, that of the plan: those that ask for a reading, of which some were
read, of which some are in the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.warning import WarningCode
from boat_daq.viewmodels.common.formatting import count, sensor_words
from boat_daq.viewmodels.results.analysis_view import PosteriorResult, RunResult

LEAST_ELONGATIONS = 4  # of a cubic
OF_A_READING = (WarningCode.OUTLIER, WarningCode.HIGH_LEVERAGE)


@dataclass(frozen=True, slots=True)
class Missing:
    """What stands in the place of a curve: title, words, and the next step by its button and its key, or none."""

    title: str
    words: str
    action: str = ""
    key: str = ""


def rests_on(result: RunResult) -> str:
    """Return how many plateaus there were, were read and are in the curve, in a sentence; empty without plateaus."""
    n, read = result.plateaus, result.read
    if not n:
        return ""
    words = f"all {count(n, 'plateau')} read" if read == n else f"{read or 'none'} of {count(n, 'plateau')} read"
    used = sorted({sensor.x.size for sensor in result.sensors if sensor.content is not None})
    if not used:
        return words
    if used == [read]:
        return words + ", all in the curve"
    return f"{words}, {' or '.join(map(str, used))} in the curve"


def missing(result: RunResult) -> Missing | None:
    """Return what is missing for a curve of any sensor, and the next step; None where there is one."""
    if any(sensor.content is not None for sensor in result.sensors):
        return None
    if not result.cycles:
        return Missing(
            "This run has no complete cycle",
            "A curve needs at least one whole cycle, from the highest pressure to the lowest and back. What was "
            "recorded is kept; run the plan to its end for a calibration.",
            "Show the plan", "plan",
        )  # fmt: skip
    if not result.plateaus:
        return Missing(
            "This run has no plateaus",
            "Its pressure never stands still, so no elongation can be read in it. Its loops and the figures over "
            "pressure are here; what changes from cycle to cycle is on the Repeat page.",
            "Show it on Repeat", "repeat",
        )  # fmt: skip
    least = f"A curve needs readings at {LEAST_ELONGATIONS} different elongations or more."
    if Path(result.path).suffix != ".boat":
        words = f"{least} For a CSV they are given in a second file: boat-daq analyze RUN --elongation FILE."
        return Missing(_read(result), words)
    words = f"{least} Type them from your notes or paste a column of a spreadsheet; then the curve is fitted anew."
    return Missing(_read(result), words, "Enter readings \u2026", "readings")


def _read(result: RunResult) -> str:
    read = f"Only {result.read}" if result.read else "None"
    return f"{read} of {count(result.plateaus, 'plateau')} {'has' if result.read <= 1 else 'have'} a reading"


def poor(result: RunResult, posterior: Sequence[PosteriorResult] = ()) -> tuple[str, ...]:
    """Return what is poor about the calibration, a sentence a sensor; empty where nothing is."""
    lines = []
    for number, sensor in enumerate(result.sensors, 1):
        said = [warning.text for warning in sensor.out_of_tolerance]
        if number <= len(posterior) and not posterior[number - 1].content.get("converged", True):
            said.append("uncertainty bands not converged")
        if said:
            lines.append(f"Sensor {number}: {', '.join(said)}")
    return tuple(lines)


def remarks(result: RunResult) -> tuple[str, ...]:
    """Return the run's warnings, those first that name a reading: it can be looked at and corrected."""
    ordered = sorted(result.warnings, key=lambda warning: warning.code not in OF_A_READING)
    return tuple(f"{sensor_words(w.subject)}: {w.text}" if w.subject else w.text for w in ordered)
