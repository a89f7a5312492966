"""Charts of time against error: numbered ticks on short axes, a front without settings that do not exist."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from analysis import figure_style as style
from analysis.studies.tradeoff.charts import method_chart
from analysis.studies.tradeoff.jobs import METHODS
from analysis.studies.tradeoff.measure import CostPoint, Measured


def chart(decades: float):  # type: ignore[no-untyped-def]
    """Return the axes of a chart whose settings span so many decades of time and error."""
    times = 0.05 * np.logspace(0, decades, 4)
    points = [CostPoint(f"setting {i}", t, 0.3 * 0.05 / t, 0, t, 0, 3) for i, t in enumerate(times.tolist())]
    measured = Measured.of(METHODS["segmentation"], points)
    with mpl.rc_context(style.RC):
        figure = method_chart(measured, "here")
        FigureCanvasAgg(figure).draw()
    return figure.axes[0]


@pytest.mark.parametrize("decades", [0.2, 4.0])
def test_each_axis_has_at_least_two_numbered_ticks(decades: float) -> None:
    """A fifth of a decade to four: two numbers within the axis, or no distance can be read off."""
    axes = chart(decades)
    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        labels = [*axis.get_majorticklabels(), *axis.get_minorticklabels()]
        places = [*axis.get_majorticklocs(), *axis.get_minorticklocs()]
        shown = [text for text, at in zip(labels, places, strict=True) if text.get_text() and low <= at <= high]
        assert len(shown) >= 2


def test_front_promises_no_setting_between_two() -> None:
    """The line of the front is in steps: at a time between two settings it is at the error of the cheaper one."""
    front = next(line for line in chart(1.0).lines if line.get_label().startswith("front"))
    assert front.get_drawstyle() == "steps-post"


def test_settings_are_numbered_and_listed_with_their_levels() -> None:
    """A number at each point; beside the chart its name, and the level that uses it where it is not the default."""
    axes = chart(1.0)
    *numbers, names = axes.texts
    assert [text.get_text() for text in numbers] == ["1", "2", "3", "4"]
    assert names.get_text().splitlines()[0] == "1  setting 0"
    assert len(names.get_text().splitlines()) == 4
