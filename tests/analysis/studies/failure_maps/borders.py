"""A border of a map, tried on both of its sides."""

from __future__ import annotations

from analysis.studies.failure_maps.maps import STUDIES
from analysis.studies.failure_maps.sweep import Cell, CellOutcome

WORKS, WARNS, REFUSES = CellOutcome.WORKS, CellOutcome.WARNS, CellOutcome.REFUSES


def check_point(name: str, x: float, y: float, outcome: CellOutcome, message: str = "") -> Cell:
    """Run a study at one point and check its outcome and its message."""
    cell = STUDIES[name].at(x, y)
    assert cell.outcome is outcome, cell
    assert message in cell.message, cell
    if outcome is WORKS:
        assert cell.error <= STUDIES[name].tolerance
    return cell
