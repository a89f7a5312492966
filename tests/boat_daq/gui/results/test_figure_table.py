"""The table of figures in the units that the operator chose."""

from __future__ import annotations

from dataclasses import replace

from boat_daq.gui import style
from boat_daq.gui.results.figure_table import FigureTable, shown_row
from protocol.base.units import Quantity, ShownUnits, UnitText

SHOWN = ShownUnits.of("V,%")
NOISE = (("Noise, rms\nmV, limit \u2264 2", "definition"), ("1\u2009501.50\n1.40 to 1.61", "n = 5"), ("\u2013", ""))
SHARE = (("Hysteresis\n% FSO", ""), ("4.95\n4.90 to 5.00", ""), ("\u2013", ""))


def test_a_row_is_converted_with_its_interval_and_limit():
    """Digits keep their significance; a share has no other unit, and a dash is a dash."""
    name, value, none = shown_row(NOISE, SHOWN)
    assert name == ("Noise, rms\nV, limit \u2264 0.002", "definition")
    assert (value, none) == (("1.50150\n0.00140 to 0.00161", "n = 5"), ("\u2013", ""))
    assert shown_row(SHARE, SHOWN) == SHARE
    half = UnitText("\u00b1", Quantity(150.0, "um", ".0f"))
    assert shown_row((("U", ""), (half, "k = 2")), SHOWN)[1] == ("\u00b10.200 %", "k = 2")


def test_another_choice_shows_the_same_figures(make):
    """The table follows the theme that carries the units, and returns to the stored ones."""
    table = FigureTable()
    table.paint_theme(style.LIGHT)
    table.show_rows([NOISE, SHARE], ["Sensor 1", "Sensor 2"])
    table.paint_theme(replace(style.LIGHT, units=SHOWN))
    assert table.item(0, 1).text().startswith("1.50150")
    table.paint_theme(style.LIGHT)
    assert table.item(0, 1).text().startswith("1\u2009501.50")
