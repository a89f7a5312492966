"""Derived channels: values against Python's own arithmetic, units, and hostile expressions at bounded cost."""

from __future__ import annotations

import math
import random
import time
import tracemalloc

import numpy as np
import pytest

from protocol.recording.channels import ExtraChannel
from protocol.recording.derived import (
    MAX_LETTERS,
    DerivedChannel,
    DerivedColumns,
    Expression,
    ExpressionError,
    are_derived,
    channel_units,
    parse_definition,
)

UNITS = channel_units(2, "counts", [ExtraChannel("T1", "degC"), ExtraChannel("flow rate", "l/min")])
FLOW = list(UNITS)[-1]
COLUMNS = {name: np.linspace(1.5, 9.25, 7) + 0.37 * i for i, name in enumerate(UNITS)}


def values(text: str) -> np.ndarray:
    return Expression.read(text).evaluate(COLUMNS)


def unit(text: str) -> str:
    return Expression.read(text).unit(UNITS)


@pytest.mark.parametrize(
    "text",
    [
        "s1_mv - s2_mv / 2", "-s1_mv ** 2", "2 - 3 - 4 + s1_mv", "s1_mv / s2_mv / 2", "(s1_mv + s2_mv) * -0.5e1",
        "s1_mv ** -1.5", "(s1_mv < s2_mv) * (s1_mv >= 3)", "+s1_lit - -s1_dark", "s1_mv == s1_mv", "s1_mv != 3.25",
        "2 * pi * s1_mv <= 20",
    ],
)  # fmt: skip
def test_precedence_is_that_of_python(text: str) -> None:
    expected = [
        float(eval(text, {"pi": math.pi}, {name: float(column[i]) for name, column in COLUMNS.items()}))
        for i in range(7)
    ]
    np.testing.assert_allclose(values(text), expected, rtol=1e-15)


def test_functions_are_those_of_mathematics() -> None:
    x, y = COLUMNS["s1_mv"], COLUMNS["s2_mv"]
    expected = {
        "log(s1_mv)": [math.log(v) for v in x],
        "atan2(s1_mv, s2_mv)": [math.atan2(a, b) for a, b in zip(x, y, strict=True)],
        "hypot(s1_mv, s2_mv)": [math.hypot(a, b) for a, b in zip(x, y, strict=True)],
        "where(s1_mv > 5, s1_mv, 0)": [v if v > 5 else 0.0 for v in x],
        "max(min(s1_mv, 4), 2)": [max(min(v, 4.0), 2.0) for v in x],
        "round(s1_mv) + floor(s2_mv) - ceil(s2_mv)": [round(a) - 1.0 for a in x],
        f"{FLOW} * 2": (2 * COLUMNS[FLOW]).tolist(),
    }
    for text, found in expected.items():
        np.testing.assert_allclose(values(text), found, rtol=2e-16 * 8, err_msg=text)


def test_undefined_values_are_not_a_number_without_a_warning() -> None:
    assert np.isnan(values("sqrt(0 - s1_mv)")).all()
    assert np.isinf(values("1 / (s1_mv - s1_mv)")).all()


def test_units_follow_the_expression() -> None:
    assert unit("s1_mv / s2_mv") == "1"
    assert unit("s1_mv / pressure_kpa") == "mV/kPa"
    assert unit("(s1_mv - 1650) ** 2") == "mV^2"
    assert unit("sqrt(s1_mv * s1_mv)") == "mV"
    assert unit("1 / pressure_kpa") == "1/kPa"
    assert unit("where(s1_mv > 2, t1_degc, 0)") == "degC"
    with pytest.raises(ExpressionError, match="mV and kPa are combined"):
        unit("s1_mv + pressure_kpa")
    stated = DerivedColumns.of([parse_definition("mix [V] = s1_mv + pressure_kpa")], UNITS)
    assert stated.channels[0].unit == "V"


def test_a_channel_may_use_those_before_it() -> None:
    definitions = [parse_definition("ratio = s1_mv / s2_mv"), parse_definition("twice [%] = 200 * ratio")]
    derived = DerivedColumns.of(definitions, UNITS)
    assert [channel.unit for channel in derived.channels] == ["1", "%"]
    found = derived.evaluate(COLUMNS)
    np.testing.assert_array_equal(found["twice"], 200 * (COLUMNS["s1_mv"] / COLUMNS["s2_mv"]))
    with pytest.raises(ExpressionError, match="no channel 'ratio'"):
        DerivedColumns.of(definitions[1:], UNITS)


@pytest.mark.parametrize("name", ["s1_mv", "time_s", "log", "pi", "t1_degc", "elongation_mm", "s9"])
def test_a_name_that_is_taken_is_refused(name: str) -> None:
    with pytest.raises(ExpressionError, match="is taken"):
        DerivedColumns.of([DerivedChannel(name, "", "s1_mv")], UNITS)


def test_values_do_not_depend_on_the_blocks_they_came_in() -> None:
    """Live in reads of any length, offline in one piece: the same bits."""
    rng = np.random.default_rng(20)
    columns = {name: rng.normal(1600.0, 300.0, 70_001) for name in UNITS}
    text = "log(abs(s1_mv) / s2_lit) + sin(s2_mv) * exp(s1_mv / 4000) ** 1.7 + atan2(t1_degc, s1_dark) + tan(s1_dark)"
    expression = Expression.read(text)
    whole = expression.evaluate(columns)
    cuts = np.sort(rng.integers(0, 70_001, 400))
    parts = [
        expression.evaluate({name: column[a:b] for name, column in columns.items()})
        for a, b in zip([0, *cuts], [*cuts, 70_001], strict=True)
    ]
    assert np.concatenate(parts).tobytes() == whole.tobytes()
    strided = expression.evaluate({name: np.stack([column, column], axis=1)[:, 1] for name, column in columns.items()})
    assert strided.tobytes() == whole.tobytes()


def hostile() -> list[str]:
    """Return 200 expressions that are none, or that would run away in a language with loops, names or big numbers."""
    rng = random.Random(20)
    fixed = [
        "",
        " ",
        "()",
        "s1_mv +",
        "* s1_mv",
        "1 2",
        "s1_mv s2_mv",
        "log",
        "log(",
        "log()",
        "log(s1_mv, 2)",
        "max(s1_mv)",
        "__import__('os').system('id')",
        "s1_mv.__class__",
        "().__class__.__bases__[0]",
        "open('/etc/passwd')",
        "lambda: 1",
        "[x for x in s1_mv]",
        "{1: 2}",
        "s1_mv[0]",
        "s1_mv if s2_mv else 1",
        "exec('1')",
        "eval(s1_mv)",
        "getattr(s1_mv, 'data')",
        "f'{s1_mv}'",
        "'a' * 9",
        '"a"',
        "b'a'",
        "...",
        "s1_mv; s2_mv",
        "s1_mv = 2",
        "s1_mv := 2",
        "9 ** 9 ** 9 ** 9",
        "s1_mv ** s2_mv",
        "s1_mv ** (2)",
        "1e999",
        "9" * 390,
        "0x10",
        "1_000",
        "1j",
        "5 % 2",
        "7 // 2",
        "1 << 99",
        "~s1_mv",
        "s1_mv & 1",
        "s1_mv and 1",
        "not s1_mv",
        "1 < 2 < 3",
        "s1_mv < s2_mv == 1",
        "`",
        "`a",
        "``",
        "`s1\x00`",
        "\x00",
        "s1_mv\x00",
        "s1_mv\u200b + 1",
        "ſ1_mv",
        "s１_mv",
        "s1_mv＋1",
        "1,2",
        "(1,2)",
        "*s1_mv",
        "**s1_mv",
        "max(*s1_mv)",
        "log(x=s1_mv)",
        "@s1_mv",
        "$s1_mv",
        "s1_mv!",
        "#",
        "s1_mv # note",
        "s1_mv \\\n + 1",
        "yield",
        "await 1",
        "import os",
        "True()",
        "globals()",
        "None.x",
        "np.log(s1_mv)",
        "log.log(s1_mv)",
        "log(log)",
        "s1_mv(",
        "s1_mv()",
        "1()",
        "(" * 399,
        ")" * 399,
        "-" * 399 + "1",
        "(" * 100 + "s1_mv" + ")" * 100,
        "log(" * 60 + "s1_mv" + ")" * 60,
        "1+" * 199 + "1",
        "s1_mv*" * 66 + "1",
        "a" * 100_000,
        "1" * 1_000_000,
        "(" * 1_000_000,
        "-" * 1_000_000,
        " " * 1_000_000 + "1",
    ]
    letters = "()[]{}+-*/%<>=!,.;:'\"`@#$^&|~\\ 0123456789eEs1_mvlog\n\t\x00é"
    while len(fixed) < 200:
        text = "".join(rng.choice(letters) for _ in range(rng.randint(1, 60)))
        fixed.append(text + rng.choice((" +", "(", "'", "[", " 1 1")))
    return fixed


def test_200_hostile_expressions_are_refused_in_bounded_time_and_memory() -> None:
    """Each names its cause; none takes more than a moment or a megabyte, whatever its length."""
    texts = hostile()
    assert len(texts) == 200
    accepted, began = [], time.process_time()
    tracemalloc.start()
    for text in texts:
        try:
            definition = parse_definition(f"x = {text}")
            DerivedColumns.of([definition], UNITS)
        except ExpressionError as error:
            assert error.cause
            assert error.remedy
        else:
            accepted.append(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert accepted == []
    assert peak < 8e6  # the texts of a megabyte among them
    assert time.process_time() - began < 10.0


def test_the_largest_expressions_take_memory_by_rows_alone() -> None:
    """As many operations as are accepted, as deep as is accepted, on a million rows: a few columns at once."""
    text = "(" * 20 + "s1_mv" + " + s2_mv)" * 20 + "+ s1_mv * s2_mv" * 10
    assert len(text) < MAX_LETTERS
    columns = {name: np.ones(1_000_000) for name in ("s1_mv", "s2_mv")}
    tracemalloc.start()
    found = Expression.read(text).evaluate(columns)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found[0] == 31.0
    assert peak < 8 * 1_000_000 + 40 * 8 * 65_536


@pytest.mark.parametrize(
    "value",
    [
        None, "x", [["x"]], [["x", "", "s1_mv", 1]], [["x", "", 1]], [[1, "", "s1_mv"]], [["x", "", "open(1)"]],
        [["x", "a]b", "s1_mv"]], [["x", "", "s1_mv"]] * 17, [["x = 1", "", "s1_mv"]], {"x": "s1_mv"},
    ],
)  # fmt: skip
def test_definitions_of_a_foreign_file_are_refused(value: object) -> None:
    assert not are_derived(value)


def test_a_definition_is_read_as_it_is_stored() -> None:
    definition = parse_definition("  ratio [%]=100*s1_mv/s2_mv ")
    assert definition == ("ratio", "%", "100*s1_mv/s2_mv")
    assert are_derived([list(definition)])
    assert are_derived([])
