"""The rule of choice, the front and the harness, on made points whose answer is known."""

from __future__ import annotations

import math
from functools import partial

import pytest

from analysis.tradeoff.measure import MARGIN, TIE, Method, Point, Setting, choose, front_of, measure, measure_setting


def point(name: str, cost: float, error: float) -> Point:
    """A point without spread."""
    return Point(name, cost, error, 0.0, cost, 0.0, 1)


POINTS = (point("coarse", 1.0, 0.6), point("middle", 2.0, 0.4), point("fine", 5.0, 0.01), point("waste", 6.0, 0.3))


def test_the_cheapest_below_the_tolerance_is_chosen() -> None:
    """Of two that are good enough the cheaper one is chosen; one that misses by the margin is not."""
    assert choose(POINTS, 0.4 * MARGIN) == "middle"
    assert choose(POINTS, 0.4 * MARGIN * 0.999) == "fine"


def test_nothing_is_chosen_where_nothing_is_good_enough() -> None:
    """Below the best error there is no choice, and infinite errors never win."""
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
    """NaN never looks like a good result."""
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
