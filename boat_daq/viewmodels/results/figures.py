"""The figures of an analysis as a page shows them: name, decimals, value, interval, definition."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from boat_daq.viewmodels.common.formatting import NOTHING, number

# name in `analyze --json` -> words, unit, decimals; in the order of the table
FIGURES = {
    "sensitivity_mv_per_mm": ("Sensitivity", "mV/mm", 1),
    "slope_at_rest_mv_per_mm": ("Slope at rest", "mV/mm", 1),
    "least_squares_slope_mv_per_mm": ("Slope, best line", "mV/mm", 1),
    "fso_mv": ("Full-scale output", "mV", 1),
    "noise_mv": ("Noise, rms", "mV", 2),
    "snr_db": ("SNR", "dB", 1),
    "sensor_hysteresis_percent_fso": ("Hysteresis, sensor", "% FSO", 2),
    "system_hysteresis_percent_fso": ("Hysteresis, system", "% FSO", 2),
    "nonlinearity_percent_fso": ("Non-linearity", "% FSO", 2),
    "repeatability_percent_fso": ("Repeatability", "% FSO", 2),
    "repeatability_worst_percent_fso": ("Repeatability, worst", "% FSO", 2),
    "drift_percent_fso_per_100_cycles": ("Drift per 100 cycles", "% FSO", 2),
    "combined_error_percent_fso": ("Combined error", "% FSO", 2),
}


@dataclass(frozen=True, slots=True)
class FigureText:
    """One cell of the table of figures: its text, and what is said on hover."""

    text: str
    hover: str


@dataclass(frozen=True, slots=True)
class FigureRow:
    """One figure for every sensor."""

    name: str
    unit: str
    cells: tuple[FigureText, ...]


def figure_text(figure: Any, decimals: int) -> FigureText:
    """Return a figure of `analysis.statistics` as text; its interval, count and definition on hover."""
    if figure is None:
        return FigureText(NOTHING, "not computed for this run")
    lines = [figure.definition] if figure.definition else []
    if math.isfinite(figure.low) and math.isfinite(figure.high):
        lines.append(f"95 %: {number(figure.low, decimals)} to {number(figure.high, decimals)} {figure.unit}")
    if figure.n:
        lines.append(f"n = {figure.n}")
    lines += [part for part in (figure.void, figure.note) if part]
    return FigureText(number(figure.value, decimals), "\n".join(lines))


def figure_rows(sensors: list[Mapping[str, Any]]) -> tuple[FigureRow, ...]:
    """Return the table of figures of all sensors; a figure that none has is left out."""
    rows = []
    for key, (name, unit, decimals) in FIGURES.items():
        if any(key in figures for figures in sensors):
            cells = tuple(figure_text(figures.get(key), decimals) for figures in sensors)
            rows.append(FigureRow(name, unit, cells))
    return tuple(rows)
