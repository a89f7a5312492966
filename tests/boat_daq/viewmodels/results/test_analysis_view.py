"""Figures of an analysis as text."""

from __future__ import annotations

from boat_daq.viewmodels.results.analysis_view import figure_text


def test_figure_text_has_definition_and_interval():
    """A figure's cell is its value; definition, interval, count and reason are on hover."""
    from analysis.figures.figure import Figure, Reason

    cell = figure_text(Figure(39.31, "mV/mm", 5, 39.0, 39.6, definition="end to end"), 1)
    assert (cell.text, cell.tip) == ("39.3", "end to end\n95 %: 39.0 to 39.6 mV/mm\nn = 5")
    assert figure_text(Figure.nothing("dB", Reason.NO_FULL_SCALE, "no span"), 1).text == "\u2013"
    assert figure_text(None, 1).text == "\u2013"
