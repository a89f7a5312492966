"""The layout of the live plots: places, axes, what is kept for each unit."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.live.layout import ELONGATION, PRESSURE, Axes, Layout, Layouts, layout_of, titles
from protocol.base.errors import RequestError

S1, S2, S3 = "s1_mv", "s2_mv", "s3_mv"
ALL = [S1, S2, ELONGATION, PRESSURE]


@pytest.fixture
def layouts(tmp_path) -> Layouts:
    unit = ["SA1"]
    made = Layouts(Preferences(tmp_path), UndoHistory(), lambda: unit[0])
    made.bench = unit
    return made


def shown(layout: Layout, quantities: list[str] = ALL) -> list[tuple[str, ...]]:
    return [plot.all for plot in layout.plots(quantities)]


def test_quantities_without_a_place_have_their_usual_one():
    """Signals, elongation, pressure; a third sensor goes behind the second one, wherever that is."""
    assert shown(Layout()) == [(S1,), (S2,), (ELONGATION,), (PRESSURE,)]
    moved = Layout(rows=((PRESSURE,), (S1, S2)))
    assert shown(moved, [*ALL, S3]) == [(S3,), (ELONGATION,), (PRESSURE,), (S1, S2)]
    assert shown(moved, [S1, PRESSURE]) == [(PRESSURE,), (S1,)]


def test_plots_are_hidden_and_overlaid():
    """Each step by itself; a quantity of another unit goes on the right axis."""
    layout = Layout().complete(ALL).without(S2)
    assert shown(layout) == [(S1,), (ELONGATION,), (PRESSURE,)]
    layout = layout.placed(S1, PRESSURE)
    assert layout.plots(ALL) == (Axes((ELONGATION,)), Axes((PRESSURE,), (S1,)))
    assert shown(layout.placed(S2)) == [(ELONGATION,), (PRESSURE, S1), (S2,)]


def test_signals_share_one_axis_or_have_two():
    """One axis for all and back; or the second on an axis at the right."""
    joined = Layout().complete(ALL).placed(S2, S1)
    assert joined.plots(ALL)[0] == Axes((S1, S2))
    assert shown(joined.placed(S2)) == shown(Layout())
    two = joined.with_axis(S2, right=True)
    assert two.plots(ALL)[0] == Axes((S1,), (S2,))
    assert two.with_axis(S2, right=False).plots(ALL)[0] == Axes((S1, S2))
    assert titles((S1, S2)) == "Sensors 1, 2"


def test_third_unit_in_a_plot_is_refused(layouts):
    """A plot has a left and a right axis; the layout in use is not changed."""
    layout = Layout().complete(ALL).placed(PRESSURE, S1)
    layouts.change(layout)
    with pytest.raises(RequestError, match="third axis"):
        layouts.change(layout.placed(ELONGATION, S1))
    assert layouts.current == layout


def test_layout_is_kept_for_each_unit(layouts, tmp_path):
    """Another unit has its own; both are there at the next start; a change is undone."""
    layouts.change(Layout().complete(ALL).without(S2))
    layouts.bench[0] = "SA2"
    assert layouts.current == Layout()
    layouts.change(Layout(hidden=(PRESSURE,)))
    layouts._undo.undo()
    assert layouts.current == Layout()
    again = Layouts(Preferences(tmp_path), UndoHistory(), lambda: "SA1")
    assert shown(again.current) == [(S1,), (ELONGATION,), (PRESSURE,)]


@pytest.mark.parametrize(
    "broken",
    [
        3,
        {},
        {**asdict(Layout()), "rows": 4},
        {**asdict(Layout()), "rows": [["nothing_known", "s1_mv", "pressure_kpa"]]},
        {**asdict(Layout()), "rows": [["s1_mv"], ["s1_mv"]]},
        {**asdict(Layout()), "rows": [["s1_mv", "pressure_kpa", "elongation_mm"]]},
    ],
)
def test_broken_stored_layout_is_ignored(broken):
    """A file that somebody edited gives the usual layout."""
    assert layout_of(broken) is None


def test_layout_survives_its_file():
    """Written as JSON and read again it is the same; what an older version stored beside it is left out."""
    layout = Layout(((S1, PRESSURE), (S2,)), (ELONGATION,), (PRESSURE,))
    stored = asdict(layout) | {"heights": {}, "against": []}  # of an older version
    assert layout_of(json.loads(json.dumps(stored))) == layout
