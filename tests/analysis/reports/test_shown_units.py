"""A report in other units: what is stated with its unit is converted, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas

from analysis.reports.document import Report, ReportDrawing, ReportTable, Section
from analysis.reports.drawings import finished
from analysis.reports.shown_units import in_units
from protocol.base.units import STORED_UNITS, ShownUnits

SHOWN = ShownUnits.of("bar, V, %")  # 1 mm of 75 mm is 1.333 %


def report_of(*parts: object, verdict: str = "") -> Report:
    return Report("t", "s", False, verdict, (("Note", "tube of 4 mm"),), (Section("A", parts),), "f")  # type: ignore[arg-type]


def test_numbers_are_converted_by_row_column_and_text() -> None:
    """Values, intervals and pairs keep their significant digits; shares, counts, names and the head stay."""
    figures = ReportTable(("Figure", "Sensor 1", "share"), (("Noise, rms, mV", "1.50 [1.40 … 1.61]", "12 %"),))
    table = ReportTable(
        ("no.", "kPa", "s1, mV", "share", "n"),
        (("SA1", "+49.98", "1769.789 ± 0.088", "5 %", "275"),),
        "Range 1.5 to -0.75 mm at +50 kPa, 3 cycles of 44.2 dB.",
        halved=True,
    )
    coefficients = ReportTable(("", "value", "unit"), (("b2", "-2.742 ± 0.030", "mV/mm²"), ("R2", "0.99996", "")))
    shown = in_units(report_of(figures, table, coefficients, "-40 to +50 kPa", verdict="from -2.70 to +3.80 mm"), SHOWN)
    named, first, second, text = shown.sections[0].parts
    assert isinstance(named, ReportTable) and isinstance(first, ReportTable) and isinstance(second, ReportTable)
    assert named.rows == (("Noise, rms, V", "0.00150 [0.00140 … 0.00161]", "12 %"),)
    assert first.header == ("no.", "bar", "s1, V", "share", "n")
    assert first.halved
    assert first.rows[0] == ("SA1", "+0.4998", "1.769789 ± 0.000088", "5 %", "275")
    assert first.caption == "Range 2.0 to -1.00 % at +0.50 bar, 3 cycles of 44.2 dB."
    assert second.rows == (("b2", "-0.001542 ± 0.000017", "V/%²"), ("R2", "0.99996", ""))
    assert (text, shown.verdict) == ("-0.40 to +0.50 bar", "from -3.60 to +5.07 %")
    assert shown.facts == (("Note", "tube of 4 mm"),)


def test_stored_units_are_the_report_itself() -> None:
    """Without a choice nothing is read or changed."""
    report = report_of("1 mm")
    assert in_units(report, STORED_UNITS) is report


def test_axes_have_round_ticks_in_the_chosen_unit() -> None:
    """The curve is where it was; labels and title are of the unit."""

    def draw(ax: Axes) -> None:
        ax.plot([-40.0, 50.0], [1500.0, 1700.0])
        ax.set(xlabel="pressure, kPa", ylabel="signal, mV")

    drawing = in_units(report_of(ReportDrawing((draw,), "c")), SHOWN).sections[0].parts[0]
    assert isinstance(drawing, ReportDrawing)
    canvas = Canvas()
    FigureCanvasAgg(canvas)
    ax = canvas.add_subplot()
    drawing.draw[0](ax)
    finished(ax)
    canvas.draw_without_rendering()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("pressure, bar", "signal, V")
    low, high = ax.get_xlim()
    shown = {round(at, 6): text.get_text() for at, text in zip(ax.get_xticks(), ax.get_xticklabels(), strict=True)}
    assert {at: text for at, text in shown.items() if low <= at <= high} == {
        -40.0: "\u22120.4", -20.0: "\u22120.2", 0.0: "0", 20.0: "0.2", 40.0: "0.4",
    }  # fmt: skip
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), [-40.0, 50.0])


@pytest.mark.parametrize("text", ["furlong", "bar,foo", "dB"])
def test_an_unknown_unit_is_refused_with_those_there_are(text: str) -> None:
    """The message lists the choice."""
    with pytest.raises(ValueError, match="none of the units kPa, bar"):
        ShownUnits.of(text)
