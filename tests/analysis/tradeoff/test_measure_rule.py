"""The rule on made fronts whose answer is known: margins, ties, levels, and where nothing is good enough."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.errors import RequestError
from analysis.fidelity import LEVELS, MARGINS, fidelity
from analysis.tradeoff.measure import TIE, Measured, Method, Point, choose, choose_levels, front_of


def point(name: str, cost: float, error: float) -> Point:
    """A point without spread."""
    return Point(name, cost, error, 0.0, cost, 0.0, 1)


def method(in_code: str = "none") -> Method:
    """A method whose consumer notices 1 mm."""
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


def test_a_default_just_beyond_the_tie_is_said_not_to_be_the_choice() -> None:
    """Both sides of the tie, in the verdict that a user reads."""
    for factor, kept in ((0.999, True), (1.001, False)):
        found = Measured.of(method("mine"), [point("other", 1.0, 0.1), point("mine", factor * TIE, 0.1)])
        assert found.default_is_chosen is kept
        assert ("is the cheapest" in found.verdict) is kept


def test_levels_by_name() -> None:
    """Three levels, each knows its name; another one is refused with what there is."""
    assert [fidelity(level).level for level in LEVELS] == list(LEVELS)
    assert fidelity() == fidelity("normal")
    with pytest.raises(RequestError, match="no fidelity 'best'"):
        fidelity("best")


def test_finer_levels_are_nowhere_coarser() -> None:
    """Every number of a level grows, or stays, from draft to reference."""
    draft, normal, reference = (fidelity(level) for level in LEVELS)
    for name in ("rays", "ranking_rays", "posterior_steps", "resamples", "points_a_column", "mesh", "table"):
        values = np.array([np.prod(getattr(level, name)) for level in (draft, normal, reference)])
        assert (np.diff(values) >= 0).all(), name


def test_the_normal_level_is_what_the_program_does_unasked() -> None:
    """Defaults written elsewhere (sampler, bootstrap, shadow, live plot) are normal's."""
    from analysis.calibration.posterior import MAX_STEPS
    from analysis.optics.scene.parameters import Light
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.fidelity import actuator, table_settings
    from analysis.shadow.model.reduced import TableSettings
    from analysis.statistics import RESAMPLES
    from boat_daq.viewmodels.live.live_model import LiveModel

    normal = fidelity("normal")
    assert Light().rays == normal.rays
    assert normal.posterior_steps == MAX_STEPS
    assert normal.resamples == RESAMPLES
    assert LiveModel(lambda: None).points_a_column == normal.points_a_column
    assert actuator(normal) == ActuatorParameters()
    assert table_settings(normal) == TableSettings()


def test_a_mesh_of_ones_own_keeps_ones_own_material() -> None:
    """The level's fitted numbers belong to the default actuator only."""
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.fidelity import actuator

    mine = replace(ActuatorParameters(), wall_modulus_kpa=900.0)
    assert actuator(fidelity("reference"), mine).wall_modulus_kpa == 900.0
    assert actuator(fidelity("reference"), mine).axial_elements == fidelity("reference").mesh[0]


@pytest.mark.parametrize(
    ("typed", "level", "released"),
    [
        ((None, None), None, (250, 100)),
        ((None, None), "reference", (1_000, 400)),
        ((600, None), "reference", (600, 240)),
        ((600, None), None, (600, 100)),
        ((600, 7), "draft", (600, 7)),
    ],
)
def test_what_is_typed_goes_before_the_level_and_the_level_before_the_paper(
    typed: tuple[int | None, int | None], level: str | None, released: tuple[int, int]
) -> None:
    """Rays and secondaries of `optics trace`, with and without --fidelity: the surface's 250 and 100 stay."""
    from boat_daq.commands.optics import Released

    found = Released.chosen(*typed, level, lambda chosen: chosen.rays)
    assert (found.rays, found.secondary) == released


def test_an_unknown_fidelity_is_a_usage_error() -> None:
    """Exit code 2, with the levels."""
    from typer.testing import CliRunner

    from boat_daq.cli import app

    result = CliRunner().invoke(app, ["optics", "trace", "--fidelity", "finest"])
    assert result.exit_code == 2
    assert "draft, normal, reference" in " ".join(result.output.split())
