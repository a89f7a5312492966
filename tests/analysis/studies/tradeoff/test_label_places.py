"""Labels of a chart: in sight, apart from each other, off the points."""

from __future__ import annotations

from itertools import combinations

from analysis.studies.tradeoff.label_places import Box, beside, best_place

VIEW = Box(0, 0, 400, 200)


def test_labels_of_a_crowd_neither_touch_nor_leave_the_view() -> None:
    """Twenty points in a corner: each label that is shown is whole, and covers no other."""
    taken: list[Box] = []
    for i in range(20):
        found = best_place(beside(395 - 4 * i, 5 + 3 * i, 60, 14, 6), VIEW, taken, [])
        if found is not None:
            taken.append(found)
    assert len(taken) >= 6
    assert all(VIEW.holds(box) for box in taken)
    assert not any(a.covers(b) for a, b in combinations(taken, 2))


def test_label_evades_a_point_and_stays_where_nothing_is_in_the_way() -> None:
    """Right above its point; elsewhere where another point is there."""
    free = best_place(beside(100, 100, 40, 14, 6), VIEW, [], [])
    assert free is not None
    assert free.left > 100
    assert free.top + free.height <= 100
    other = Box(free.left + 5, free.top + 2, 8, 8)
    moved = best_place(beside(100, 100, 40, 14, 6), VIEW, [], [other])
    assert moved is not None
    assert moved.covers(other) == 0


def test_label_without_a_place_is_left_out() -> None:
    """A label wider than the view has none."""
    assert best_place(beside(100, 100, 500, 14, 6), VIEW, [], []) is None
