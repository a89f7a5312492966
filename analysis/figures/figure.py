"""A figure: value, unit, count, interval, or why there is none; and the one table of all figures.

Names, labels, units and decimals of a window, a report, a CSV and a command line come from `SENSOR_FIGURES` and
`SYSTEM_FIGURES`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from html import escape
from typing import TYPE_CHECKING, Any, Protocol

from analysis.json_object import json_object
from analysis.numbers import rounded
from protocol.base.units import NOTHING, in_signal_unit

if TYPE_CHECKING:  # the window imports the table of figures, and not pandas with it
    import pandas as pd

    from analysis.segmentation.losses import Losses
    from analysis.warning import Warning


@dataclass(frozen=True, slots=True)
class FigureDefinition:
    """A figure's key in JSON, label, unit, decimals where no uncertainty gives them, and the source of its term."""

    key: str
    label: str
    unit: str
    decimals: int
    source: str

    @property
    def label_with_unit(self) -> str:
        """The label as the head of a row or an axis, e.g. `Noise, rms, mV`."""
        return f"{self.label}, {self.unit}"

    @property
    def phrase(self) -> str:
        """The label inside a sentence, e.g. `noise, rms`."""
        return self.label[0].lower() + self.label[1:]


def _by_key(*definitions: FigureDefinition) -> dict[str, FigureDefinition]:
    return {definition.key: definition for definition in definitions}


_ISA, _ISO = "ISA-S37.1", "ISO 5725-2"
SENSOR_FIGURES = _by_key(
    FigureDefinition("sensitivity_mv_per_mm", "Sensitivity, end points", "mV/mm", 1, _ISA),
    FigureDefinition("fso_mv", "Full-scale output", "mV", 1, _ISA),
    FigureDefinition("system_hysteresis_percent_fso", "Hysteresis, system", "% FSO", 2, _ISA),
    FigureDefinition("sensor_hysteresis_percent_fso", "Hysteresis, sensor", "% FSO", 2, _ISA),
    FigureDefinition("nonlinearity_percent_fso", "Non-linearity", "% FSO", 2, _ISA),
    FigureDefinition("lack_of_fit_percent_fso", "Lack of fit", "% FSO", 2, "Draper and Smith 1998"),
    FigureDefinition("repeatability_percent_fso", "Repeatability, pooled", "% FSO", 2, _ISO),
    FigureDefinition("repeatability_worst_percent_fso", "Repeatability, worst level", "% FSO", 2, _ISO),
    FigureDefinition("combined_error_percent_fso", "Combined error", "% FSO", 2, _ISA),
    FigureDefinition("drift_percent_fso_per_100_cycles", "Drift", "% FSO/100 cycles", 2, "Sen 1968"),
    FigureDefinition("noise_mv", "Noise, rms", "mV", 2, _ISA),
    FigureDefinition("snr_db", "Signal-to-noise ratio", "dB", 1, "20 log10(FSO / noise)"),
    FigureDefinition("slope_at_rest_mv_per_mm", "Slope at rest", "mV/mm", 1, "dy/dx at x = 0"),
    FigureDefinition("least_squares_slope_mv_per_mm", "Slope, least squares", "mV/mm", 1, _ISA),
)
KEY_FIGURES = (  # those that a reader looks for first, in window and report
    "sensitivity_mv_per_mm",
    "system_hysteresis_percent_fso",
    "sensor_hysteresis_percent_fso",
    "repeatability_percent_fso",
    "drift_percent_fso_per_100_cycles",
    "snr_db",
)
SYSTEM_FIGURES = _by_key(
    FigureDefinition("system_sensitivity_mv_per_mm", "Sensitivity, system", "mV/mm", 1, "mean over the sensors"),
    FigureDefinition("actuator_hysteresis_percent", "Hysteresis, actuator", "% of span", 2, _ISA),
)


def sensor_text(name: str) -> str:
    """Return the name of a sensor inside a sentence: s1 is sensor 1."""
    number = name.removeprefix("s")
    return f"sensor {number}" if number.isdigit() else name


WIDEST_LOOP_PERCENT = 100.0  # of full-scale output: no wider loop belongs to a signal that spans it


class Reason(StrEnum):
    """Why a figure is void, has no interval, or is not what its name promises."""

    NONE = ""
    NOT_DRIVEN = "not_driven"
    NO_CYCLE = "no_cycle"
    ONE_CYCLE = "one_cycle"
    FEW_CYCLES = "few_cycles"
    NO_COMMON_LEVEL = "no_common_level"
    NO_SAMPLES = "no_samples"
    LOSSES = "losses"
    NO_ELONGATION = "no_elongation"
    NOT_CALIBRATED = "not_calibrated"
    REST_OUTSIDE_RANGE = "rest_outside_range"
    NO_OVERLAP = "no_overlap"
    ONE_BRANCH = "one_branch"
    NO_FULL_SCALE = "no_full_scale"
    FULL_SCALE_IS_NOISE = "full_scale_is_noise"
    NO_NOISE = "no_noise"
    NO_INTERVAL = "no_interval"
    UPPER_BOUND = "upper_bound"
    PART_OF_RANGE = "part_of_range"
    WIDER_THAN_FULL_SCALE = "wider_than_full_scale"
    FEW_POSITIONS = "few_positions"
    NOT_SETTLED = "not_settled"
    DEPENDENT = "dependent"
    DOUBTFUL = "doubtful"
    INADEQUATE = "inadequate"


@dataclass(frozen=True, slots=True, repr=False)
class Figure:
    """One figure of a report: value, unit, number of independent items, 95 % interval, or why there is none."""

    value: float  # this and the limits are NaN or infinite where `void` gives the reason
    unit: str
    n: int  # number of cycles, plateaus or points, see `definition`
    low: float = float("nan")  # NaN where no limit can be given
    high: float = float("nan")
    void: str = ""  # why the figure is not to be used
    note: str = ""  # why the interval is missing or wide
    definition: str = ""
    window: Losses | None = None  # what was lost or left out of its samples; None where it rests on none directly
    reason: Reason = Reason.NONE  # the code of `void` or `note`; programs decide by it

    def __float__(self) -> float:
        return self.value

    def __format__(self, spec: str) -> str:
        return format(self.value, spec) if spec else repr(self)

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty: a quarter of the width of the 95 % interval; NaN without one."""
        return (self.high - self.low) / 4

    def __repr__(self) -> str:
        return with_interval(self) if not self.void else f"void: {self.void}"

    @classmethod
    def nothing(cls, unit: str, reason: Reason, void: str, definition: str = "") -> Figure:
        """Return a figure that cannot be given, with the reason as code and text."""
        return cls(float("nan"), unit, 0, void=void, definition=definition, reason=reason)

    def as_json(self) -> dict[str, Any]:
        """Return the figure as a dictionary; NaN and infinity are left for the writer to turn into null."""
        value = json_object(self, "value", "unit", "n") | {"interval_95": [self.low, self.high]}
        return value | json_object(self, "void", "note", "definition", "window", "reason")


class Figures(dict[str, Figure]):
    """Figures by key; a key that is none is refused with those that are."""

    def __missing__(self, key: str) -> Figure:
        raise KeyError(f"there is no figure {key!r}; choose one of {', '.join(self)}")


def not_driven(figures: Mapping[str, Figure], why: str) -> dict[str, Figure]:
    """Return the figures, every one of them void with `why` where that is not empty."""
    if not why:
        return dict(figures)
    return {k: Figure.nothing(f.unit, Reason.NOT_DRIVEN, why, f.definition) for k, f in figures.items()}


def marked_implausible(figures: Mapping[str, Figure]) -> dict[str, Figure]:
    """Return the figures; a loop wider than the full-scale output is marked: that output is then no span."""
    return {key: _marked(figure) if "hysteresis" in key else figure for key, figure in figures.items()}


def _marked(hysteresis: Figure) -> Figure:
    if not hysteresis.value > WIDEST_LOOP_PERCENT:
        return hysteresis
    times = f"{hysteresis.value / 100.0:.3g} times"
    note = f"the loop is {times} as wide as the full-scale output, which is therefore no span"
    note = f"{note}; {hysteresis.note}" if hysteresis.note else note
    return replace(hysteresis, note=note, reason=Reason.WIDER_THAN_FULL_SCALE)


def void_sentences(sensors: Sequence[tuple[str, Mapping[str, Figure]]]) -> list[str]:
    """Return a sentence for each reason why figures are void, of each sensor by name, and of "system"."""
    by_reason: dict[str, dict[str, list[str]]] = {}
    for name, figures in sensors:
        for key, definition in (SENSOR_FIGURES | SYSTEM_FIGURES).items():
            if key in figures and figures[key].void:
                by_reason.setdefault(figures[key].void, {}).setdefault(definition.phrase, []).append(name)
    found = []
    for reason, names_of in by_reason.items():
        alike: dict[tuple[str, ...], list[str]] = {}
        for label, names in names_of.items():
            alike.setdefault(tuple(names), []).append(label)
        found += [f"Undefined for {_listed(who)}: {reason} ({'; '.join(what)})." for who, what in alike.items()]
    return found


def _listed(names: tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def with_interval(figure: Figure) -> str:
    """Return "44.62 [44.45, 44.76] dB"."""
    if math.isnan(figure.value):
        return NOTHING
    half = figure.uncertainty
    text = rounded(figure.value, half)
    if math.isfinite(figure.low) and math.isfinite(figure.high):
        text += f" [{rounded(figure.low, half)}, {rounded(figure.high, half)}]"
    return f"{text} {figure.unit}"


class SensorFigures(Protocol):
    """The figures of one sensor, by key."""

    @property
    def name(self) -> str:
        """Name of the sensor."""

    @property
    def figures(self) -> Mapping[str, Figure]:
        """Its figures."""


_LARGEST = 3  # warnings in full


def figure_frame(sensors: Sequence[SensorFigures], system: Mapping[str, Figure]) -> pd.DataFrame:
    """Return a row for each figure of each sensor, and of the whole unit."""
    import pandas as pd

    groups = [*((sensor.name, sensor.figures) for sensor in sensors), ("", system)]
    rows = [(name, key, f.value, f.low, f.high, f.unit, f.n, f.void) for name, of in groups for key, f in of.items()]
    return pd.DataFrame(rows, columns=["sensor", "figure", "value", "low", "high", "unit", "n", "void"])


def _rows(
    sensors: Sequence[SensorFigures], system: Mapping[str, Figure], keys: Sequence[str]
) -> list[tuple[str, list[str]]]:
    """Return label and a text for each sensor; figures of the whole unit have one text."""
    known = [key for key in keys if sensors and key in sensors[0].figures]
    unit = sensors[0].figures["fso_mv"].unit if known else "mV"
    rows = [(SENSOR_FIGURES[key].label_with_unit, [_text(sensor.figures[key]) for sensor in sensors]) for key in known]
    rows += [(SYSTEM_FIGURES[key].label_with_unit, [_text(figure)]) for key, figure in system.items()]
    return [(in_signal_unit(label, unit), texts) for label, texts in rows]


def _text(figure: Figure) -> str:
    return with_interval(figure).removesuffix(f" {figure.unit}")


def summary_text(
    heading: str, sensors: Sequence[SensorFigures], system: Mapping[str, Figure], warnings: Sequence[Warning]
) -> str:
    """Return heading, key figures with 95 % intervals, and the number of warnings, as lines."""
    rows = _rows(sensors, system, KEY_FIGURES)
    head = ("95 % interval", [sensor.name for sensor in sensors])
    width = max(len(label) for label, _ in rows)
    columns = max((len(text) for _, texts in rows for text in texts), default=0)
    lines = [
        "  " + f"{label:<{width}}  " + "  ".join(f"{text:<{columns}}" for text in texts)
        for label, texts in (head, *rows)
    ]
    more = [f"  warnings: {len(warnings)}, in .warnings; all figures: .to_frame()"]
    return "\n".join([heading, *(line.rstrip() for line in lines), *more])


def summary_html(
    heading: str, sensors: Sequence[SensorFigures], system: Mapping[str, Figure], warnings: Sequence[Warning]
) -> str:
    """Return all figures with 95 % intervals as an HTML table, and the first warnings."""
    names = "".join(f"<th>{escape(sensor.name)}</th>" for sensor in sensors)
    body = "".join(
        f"<tr><th style='text-align:left'>{escape(label)}</th>"
        + "".join(f"<td>{escape(text)}</td>" for text in texts)
        + "</tr>"
        for label, texts in _rows(sensors, system, list(SENSOR_FIGURES))
    )
    items = "".join(f"<li>{escape(warning.text)}</li>" for warning in warnings[:_LARGEST])
    left = len(warnings) - _LARGEST
    more = f"<li>and {left} more: <code>.warnings</code></li>" if left > 0 else ""
    table = f"<table><tr><th>95 % interval</th>{names}</tr>{body}</table>"
    return f"<b>{escape(heading)}</b>{table}<ul>{items}{more}</ul>"
