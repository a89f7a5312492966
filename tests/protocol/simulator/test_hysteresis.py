"""The play operators against their definition and the two properties that characterise them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.simulator.hysteresis import Hysteresis, PlaySum, compose_clamps

MODEL = PlaySum((0.0, 3.0, 9.0, 20.0), (1.0, 0.5, 0.25, 0.2), 0.001, 0.002)
INPUTS = st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=60).map(np.array)


def one_by_one(model: PlaySum, inputs: np.ndarray) -> np.ndarray:
    """The operator as its definition reads."""
    plays, outputs = [0.0] * len(model.radii), []
    for v in inputs:
        up, down = v + model.up_curvature * v * v, v + model.down_curvature * v * v
        plays = [max(up - r, min(down + r, w)) for r, w in zip(model.radii, plays, strict=True)]
        outputs.append(sum(k * w for k, w in zip(model.weights, plays, strict=True)))
    return np.array(outputs)


@given(INPUTS)
def test_scan_equals_the_definition(inputs):
    """A block through the prefix scan gives what the definition gives step by step."""
    np.testing.assert_allclose(Hysteresis(MODEL).advance(inputs), one_by_one(MODEL, inputs), rtol=0, atol=1e-12)


@given(INPUTS, st.lists(st.integers(0, 60), max_size=6))
def test_blocks_do_not_matter(inputs, cuts):
    """The same inputs in other blocks give the same outputs bit for bit."""
    whole, parts = Hysteresis(MODEL), Hysteresis(MODEL)
    pieces = np.split(inputs, sorted(cut % (inputs.size + 1) for cut in cuts))
    outputs = np.concatenate([parts.advance(piece) for piece in pieces])
    assert np.array_equal(outputs, whole.advance(inputs))
    assert np.array_equal(parts.plays, whole.plays)


@given(INPUTS, st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_closed_minor_loop_is_erased(inputs, first, second):
    """A minor loop that closes leaves no trace: the memory is what it was when it began (return-point memory)."""
    operator = Hysteresis(MODEL)
    operator.advance(inputs)
    operator.advance(np.array([first, second]))  # a turn at `first` on the way to `second`
    before = operator.plays
    operator.advance(np.array([first, second]))
    np.testing.assert_array_equal(operator.plays, before)


@given(INPUTS, INPUTS, st.floats(-40.0, 40.0), st.floats(1.0, 20.0))
def test_congruency(history, other, low, span):
    """Minor loops between the same two inputs have the same shape, whatever came before."""
    loop = np.concatenate([np.linspace(low, low + span, 20), np.linspace(low + span, low, 20)])
    shapes = []
    for past in (history, other):
        operator = Hysteresis(MODEL)
        operator.advance(past)
        operator.advance(loop)
        output = operator.advance(loop)
        shapes.append(output - output[0])
    np.testing.assert_allclose(shapes[0], shapes[1], rtol=0, atol=1e-9)


@given(INPUTS, st.integers(1, 5))
def test_rate_independence(inputs, repeats):
    """Dwelling at an input changes nothing: there is no time in the operator."""
    slow = Hysteresis(MODEL).advance(np.repeat(inputs, repeats))[repeats - 1 :: repeats]
    np.testing.assert_array_equal(slow, Hysteresis(MODEL).advance(inputs))


def test_loop_is_asymmetric():
    """Two envelopes give a loop that turning it round its middle does not map onto itself; one envelope does not."""
    way = np.concatenate([np.linspace(0, 50, 200), np.linspace(50, -50, 401), np.linspace(-50, 50, 401)])

    def asymmetry(model: PlaySum) -> float:
        output = Hysteresis(model).advance(way)
        falling, rising = output[200:601], output[601:]
        return float(np.abs((falling - falling.mean()) + (rising - rising.mean())).max())

    assert asymmetry(MODEL) > 1.0
    assert asymmetry(PlaySum(MODEL.radii, MODEL.weights)) < 1e-9


def test_compose_clamps_leaves_its_arguments_alone():
    """The bounds handed in are values."""
    low, high = np.array([[0.0], [2.0]]), np.array([[1.0], [3.0]])
    composed_low, composed_high = compose_clamps(low, high)
    assert (composed_low[1, 0], composed_high[1, 0]) == (2.0, 2.0)
    assert (low[1, 0], high[1, 0]) == (2.0, 3.0)


def test_empty_block():
    """No input, no output."""
    assert Hysteresis(MODEL).advance(np.empty(0)).size == 0


@pytest.mark.parametrize(
    "arguments",
    [((1.0,), (1.0, 2.0)), ((-1.0,), (1.0,)), ((1.0,), (1.0,), 0.2, 0.1)],
    ids=["lengths", "radius", "order"],
)
def test_impossible_models_are_refused(arguments):
    """Lengths that differ, a negative radius, a rising envelope above the falling one."""
    with pytest.raises(ValueError, match=r"radius|envelope"):
        PlaySum(*arguments)
