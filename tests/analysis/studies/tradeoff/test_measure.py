"""The rule of choice, the front and the harness, on made points whose answer is known."""

from __future__ import annotations

import math
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.fidelity import LEVELS, MARGINS
from analysis.studies.tradeoff.measure import (
    MARGIN,
    TIE,
    CostPoint,
    Measured,
    Method,
    Setting,
    choose,
    choose_levels,
    front_of,
    measure,
    measure_setting,
)


def point(name: str, cost: float, error: float) -> CostPoint:
    """A point without spread."""
    return CostPoint(name, cost, error, 0.0, cost, 0.0, 1)


POINTS = (point("coarse", 1.0, 0.6), point("middle", 2.0, 0.4), point("fine", 5.0, 0.01), point("waste", 6.0, 0.3))


def test_the_cheapest_below_the_tolerance_is_chosen() -> None:
    """Of two that are good enough the cheaper one is chosen; one that misses by the margin is not."""
    assert choose(POINTS, 0.4 * MARGIN) == "middle"
    assert choose(POINTS, 0.4 * MARGIN * 0.999) == "fine"


def test_nothing_is_chosen_where_nothing_is_good_enough() -> None:
    """Below the best error there is no choice, and infinite errors are never chosen."""
    assert choose(POINTS, 0.001) is None
    assert choose([point("failed", 0.1, math.inf)], 1e300) is None


def test_a_default_of_equal_cost_is_kept() -> None:
    """Within the tie of the cheapest the default stays; beyond it, it does not."""
    pair = [point("other", 1.0, 0.1), point("mine", TIE, 0.1)]
    assert choose(pair, 1.0, "mine") == "mine"
    assert choose([pair[0], point("mine", 1.01 * TIE, 0.1)], 1.0, "mine") == "other"


def test_the_front_leaves_out_what_another_beats() -> None:
    """A point that costs more and errs more than another is not on the front; the front falls."""
    assert front_of(POINTS) == ("coarse", "middle", "fine")


def test_the_error_is_the_root_mean_square_of_the_repeats() -> None:
    """Errors 3 and 4 give sqrt(12.5), spread 1."""
    found = measure_setting(Setting("s", lambda repeat: (3.0, 4.0)[repeat], lambda x: x), 2)
    assert found.error == pytest.approx(math.sqrt(12.5))
    assert found.error_spread == 1.0


def test_a_result_that_is_no_number_is_an_infinite_error() -> None:
    """NaN never counts as a good result."""
    assert measure_setting(Setting("s", lambda _: math.nan, lambda x: x), 2).error == math.inf


def test_cancel_from_progress() -> None:
    """Raising from progress ends the measurement at once."""
    ran: list[int] = []
    settings = [Setting(str(i), partial(lambda i, _: ran.append(i), i), lambda _: 0.0) for i in range(3)]
    method = Method("m", "M", "r", True, "c", 1.0, "mm", "a call", lambda _: "0", lambda _: settings)

    def stop(done: float, _total: float) -> None:
        if done > 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(method, quick=True, progress=stop)
    assert set(ran) == {0}


def method(in_code: str = "none") -> Method:
    """A method whose tolerance is 1 mm."""
    return Method("m", "M", "r", True, "c", 1.0, "mm", "a call", lambda _: in_code, lambda _: [])


FRONT = [point(f"{n}", float(n), 4.0 / n) for n in (1, 2, 4, 8, 16, 32, 64)]


def test_each_level_is_the_cheapest_below_its_own_margin() -> None:
    """Error 4 / n against 1 mm: a draft may err by 2 mm (n = 2), normal by 0.5 (8), reference by 0.1 (64)."""
    assert MARGINS == {"draft": 0.5, "normal": 2.0, "reference": 10.0}
    assert choose_levels(FRONT, method()) == {"draft": "2", "normal": "8", "reference": "64"}


def test_where_nothing_is_good_enough_the_level_takes_the_cheapest_as_exact_as_the_best() -> None:
    """Errors 1.0 and 1.2 are the same within the tie, 1.4 is not; there is no choice, but there is a level."""
    points = [point("a", 1.0, 1.4), point("b", 2.0, 1.2), point("c", 9.0, 1.0)]
    assert choose(points, 1.0) is None
    assert choose_levels(points, method())["reference"] == "b"


def test_failures_only_leave_the_level_as_it_is() -> None:
    """A method that answers nowhere keeps what is in the code, and has no front."""
    points = [point("a", 1.0, math.inf), point("b", 2.0, math.inf)]
    assert set(choose_levels(points, method("mine")).values()) <= {"a", "b", "mine"}
    assert front_of(points) == ()


@given(st.lists(st.tuples(st.floats(1e-6, 1e3), st.floats(0.0, 1e3)), min_size=1, max_size=12), st.floats(1e-3, 1e3))
def test_the_choice_is_good_enough_and_nothing_good_enough_is_cheaper(
    rows: list[tuple[float, float]], tolerance: float
) -> None:
    """Against the definition, word for word; the front is what no other point beats."""
    points = [point(str(i), cost, error) for i, (cost, error) in enumerate(rows)]
    chosen = choose(points, tolerance)
    good = {p.setting: p for p in points if 2.0 * p.error <= tolerance}
    if chosen is None:
        assert not good
    else:
        assert good[chosen].cpu_seconds == min(p.cpu_seconds for p in good.values())
    place = {p.setting: (p.cpu_seconds, p.error) for p in points}
    unbeaten = {a for a in place.values() if not any(b[0] <= a[0] and b[1] <= a[1] and a != b for b in place.values())}
    assert {place[name] for name in front_of(points)} == unbeaten


def test_a_stricter_margin_never_chooses_a_cheaper_setting() -> None:
    """The levels climb the front."""
    cost = {p.setting: p.cpu_seconds for p in FRONT}
    costs = [cost[choose(FRONT, 1.0, margin=MARGINS[level]) or ""] for level in LEVELS]
    assert costs == sorted(costs)


def test_a_default_just_beyond_the_tie_is_not_the_choice() -> None:
    """Both sides of the tie, in the verdict that a user reads."""
    for factor, kept in ((0.999, True), (1.001, False)):
        found = Measured.of(method("mine"), [point("other", 1.0, 0.1), point("mine", factor * TIE, 0.1)])
        assert found.default_is_chosen is kept
        assert ("is the cheapest" in found.verdict) is kept
