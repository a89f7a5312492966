"""How a figure, a date, a power is written in a cell of a report."""

from __future__ import annotations

import datetime

import numpy as np

from analysis.figures.figure import Figure
from analysis.numbers import NOTHING, rounded


def cells(figure: Figure | None) -> tuple[str, str]:
    """Value and interval, rounded alike."""
    if figure is None or np.isnan(figure.value):
        return NOTHING, ""
    half = (figure.high - figure.low) / 4
    known = np.isfinite(figure.low) and np.isfinite(figure.high)
    return rounded(figure.value, half), f"{rounded(figure.low, half)} … {rounded(figure.high, half)}" if known else ""


def cell(figure: Figure | None) -> str:
    """Return value and interval in one cell."""
    value, interval = cells(figure)
    return f"{value} [{interval}]" if interval else value


def p_value(p: float) -> str:
    """Return a p-value with its relation, e.g. `= 0.012`."""
    return "< 0.001" if p < 0.001 else f"= {p:.3f}"


def power(k: int) -> str:
    """Return an exponent as its superscript."""
    return {1: "", 2: "²", 3: "³"}.get(k, f"^{k}")


def date_of(text: object) -> str:
    """Return an ISO time as date, time and offset; any other text as it is."""
    try:
        return datetime.datetime.fromisoformat(str(text)).strftime("%Y-%m-%d %H:%M:%S %z")
    except ValueError:
        return str(text or "")
