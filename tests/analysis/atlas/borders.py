"""A border of a map, tried on both of its sides."""

from __future__ import annotations

from analysis.atlas.methods import STUDIES
from analysis.atlas.sweep import Cell, Outcome

WORKS, DEGRADED, REFUSED = Outcome.WORKS, Outcome.DEGRADED, Outcome.REFUSED


def place(name: str, x: float, y: float, outcome: Outcome, said: str = "") -> Cell:
    """Ask a study in one place and hold it to an outcome and to what is said there."""
    cell = STUDIES[name].at(x, y)
    assert cell.outcome is outcome, cell
    assert said in cell.said, cell
    if outcome is WORKS:
        assert cell.error <= STUDIES[name].tolerance
    return cell
