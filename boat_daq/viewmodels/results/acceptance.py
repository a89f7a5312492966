"""Whether a calibration can be accepted: what its curve rests on, what is missing, what is out of tolerance.

Rules: plateaus are counted once for the whole window, those of the plan: the ones to be read, of which some were read,
of which some are in the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from analysis.warning import WarningCode
from boat_daq.viewmodels.common.formatting import count, sensor_words
from boat_daq.viewmodels.results.analysis_jobs import CurveBands, RunResult

LEAST_ELONGATIONS = 4  # of a cubic
OF_A_READING = (WarningCode.OUTLIER, WarningCode.HIGH_LEVERAGE)
TWO_ELONGATIONS = "one signal would stand for two elongations"


class NextStep(Enum):
    """What the operator can do about a missing curve: the text of its button."""

    NONE = ""
    SHOW_PLAN = "Show the plan"
    SHOW_REPEATABILITY = "Show it on Repeat"
    ENTER_READINGS = "Enter readings \u2026"


@dataclass(frozen=True, slots=True)
class Missing:
    """What is shown in place of a curve: title, text and the next step."""

    title: str
    text: str
    step: NextStep = NextStep.NONE


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Why a calibration cannot be accepted, with its consequence where it needs one."""

    cause: str
    consequence: str = ""

    def __str__(self) -> str:
        """Return both as a sentence."""
        return f"{self.cause}{f': {self.consequence}' if self.consequence else ''}."


def obstacle(result: RunResult | None) -> Obstacle | None:
    """Return why the calibration of a run cannot be accepted; None when it can."""
    if result is None:
        return Obstacle("Nothing is analysed yet")
    lacking = missing(result)
    for sensor in result.sensors:
        if sensor.fit is None:
            return Obstacle(lacking.title if lacking is not None else f"{sensor.label}: {sensor.void}")
        if not sensor.fit.content["fit"]["monotone"]:
            return Obstacle(f"{sensor.label}: the curve turns inside its range", TWO_ELONGATIONS)
    return None if result.sensors else Obstacle("The run has no sensor")


def readings_text(result: RunResult) -> str:
    """Return how many plateaus were read and are in the curve; empty without plateaus."""
    n, read = result.plateaus, result.read
    if not n:
        return ""
    text = f"{read or 'none'} of {count(n, 'plateau')} read"
    used = sorted({sensor.x.size for sensor in result.sensors if sensor.fit is not None})
    if not used:
        return text
    return f"{text}, {'all' if used == [read] else ' or '.join(map(str, used))} in the curve"


def missing(result: RunResult) -> Missing | None:
    """Return what is missing for a curve of any sensor, and the next step; None where there is one."""
    if any(sensor.fit is not None for sensor in result.sensors):
        return None
    if not result.cycles:
        return Missing(
            "This run has no complete cycle",
            "A curve needs at least one complete cycle, from the highest pressure to the lowest and back. Run the plan "
            "to its end for a calibration; this recording is kept.",
            NextStep.SHOW_PLAN,
        )
    if not result.plateaus:
        return Missing(
            "This run has no plateaus",
            "Its pressure is never constant, so that no elongation can be read in it. Its loops and the figures over "
            "pressure are shown here; the changes from cycle to cycle are on the Repeat page.",
            NextStep.SHOW_REPEATABILITY,
        )
    read = f"Only {result.read}" if result.read else "None"
    title = f"{read} of {count(result.plateaus, 'plateau')} {'has' if result.read <= 1 else 'have'} a reading"
    least = f"A curve needs readings at {LEAST_ELONGATIONS} or more different elongations."
    if Path(result.path).suffix != ".boat":
        text = f"{least} For a CSV file they are given in a second file: boat-daq analyze RUN --elongation FILE."
        return Missing(title, text)
    text = f"{least} Type them from your notes or paste a column of a spreadsheet; the curve is then fitted again."
    return Missing(title, text, NextStep.ENTER_READINGS)


def out_of_tolerance(result: RunResult, posterior: Sequence[CurveBands] = ()) -> tuple[str, ...]:
    """Return which figures are out of tolerance, a sentence for each sensor that has one."""
    lines = []
    for i, sensor in enumerate(result.sensors):
        parts = [warning.text for warning in sensor.out_of_tolerance]
        if i < len(posterior) and not posterior[i].content.get("converged", True):
            parts.append("uncertainty bands not converged")
        if parts:
            lines.append(f"{sensor.label}: {', '.join(parts)}")
    return tuple(lines)


def warnings(result: RunResult) -> tuple[str, ...]:
    """Return the warnings of a run as texts, first those of a reading, which can be corrected."""
    ordered = sorted(result.warnings, key=lambda warning: warning.code not in OF_A_READING)
    return tuple(f"{sensor_words(w.subject)}: {w.text}" if w.subject else w.text for w in ordered)
