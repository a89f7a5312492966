"""The texts of a figure in a table."""

from __future__ import annotations

from types import SimpleNamespace

from analysis.figures.acceptance import against_published
from analysis.figures.figure import Figure, Reason
from boat_daq.viewmodels.results.figure_tables import figure_text


def test_figure_text_has_value_interval_and_conformity():
    """A figure's cell is its value, marked by its conformity, over its interval; definition, count, reason on hover."""
    figure = Figure(39.31, "mV/mm", 5, 39.0, 39.6, definition="end to end")
    text, tip = figure_text(figure, 1)
    assert text == "39.3\n39.0 to 39.6"
    assert tip == "end to end\n95 % confidence interval: 39.0 to 39.6 mV/mm\nn = 5"
    assert figure_text(figure, 1, brief=True) == ("39.3", tip)
    bound = Figure(0.0, "% FSO", 5, 0.0, 4.15)  # the value alone would claim that there is none
    assert figure_text(bound, 2, brief=True)[0] == "0.00\n0.00 to 4.15"
    assert figure_text(Figure(44.7, "dB", 5, 44.69, 44.71), 1, brief=True)[0] == "44.7"
    noise = Figure(44.0, "dB", 5, 43.5, 44.5)
    sensor = SimpleNamespace(calibration=object(), name="s1", figures={"snr_db": noise})
    (stated,) = against_published(sensor)
    text, tip = figure_text(noise, 1, stated)
    assert (text, tip.splitlines()[0][:5]) == ("\u25cf 44.0\n43.5 to 44.5", "pass:")
    assert figure_text(Figure.nothing("dB", Reason.NO_FULL_SCALE, "no span"), 1)[0] == "\u2013"
    assert figure_text(None, 1)[0] == "\u2013"
