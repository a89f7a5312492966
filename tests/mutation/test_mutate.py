"""The mutation tester itself: what it replaces, which tests it chooses, and its reasons."""

from __future__ import annotations

import ast
import csv
import sys
import types
from pathlib import Path

import pytest

from tests.mutation.mutate import MODULES, ROOT, lines_of_interest, replace_code
from tests.mutation.scores import SCORES, Reason, reasons, score

SOURCE = """from dataclasses import dataclass

LIMIT = 3


def below(x, most=LIMIT):
    if x < most:
        return True
    return False


@dataclass(frozen=True)
class Reading:
    value: float = 1.0

    @property
    def twice(self):
        return 2 * self.value
"""


@pytest.mark.parametrize(
    ("old", "new", "shown"),
    [
        ("LIMIT = 3", "LIMIT = 4", lambda m, other: (other.LIMIT, m.below(3))),
        ("x < most", "x <= most", lambda m, other: (other.below(3), m.LIMIT + 1 - 3)),
        ("2 * self", "3 * self", lambda m, _: (m.Reading().twice == 3, True)),
        ("float = 1.0", "float = 2.0", lambda m, _: (m.Reading().value == 2, m.Reading().twice == 4)),
    ],
)
def test_mutant_replaces_what_others_have_imported(
    old: str, new: str, shown: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Functions, defaults, methods, properties and constants, also under the name that another module imported."""
    module = types.ModuleType("mutated_example")
    module.__file__ = "mutated_example.py"
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(SOURCE, vars(module))
    other = types.ModuleType("importing_example")
    other.LIMIT, other.below = module.LIMIT, module.below
    monkeypatch.setitem(sys.modules, other.__name__, other)
    before = shown(module, other)
    replace_code(module, SOURCE.replace(old, new))
    assert shown(module, other) != before
    assert all(shown(module, other))


@pytest.mark.parametrize(
    ("line", "lines"), [(7, {7}), (8, {8}), (6, {7, 8, 9}), (3, {7, 8, 9}), (14, None), (18, {18})]
)
def test_tests_are_chosen_by_the_lines_that_show_a_mutant(line: int, lines: set[int] | None) -> None:
    """A statement's own; a default's are its function's; a constant's those of its uses; None is every test."""
    assert lines_of_interest(ast.parse(SOURCE), line) == lines


@pytest.mark.parametrize("reason", reasons(), ids=lambda r: r.before[:40])
def test_reason_is_of_a_line_of_its_module(reason: Reason) -> None:
    """A reason for a line that is no longer there explains nothing."""
    lines = (ROOT / reason.module).read_text(encoding="utf-8").splitlines()
    assert reason.before in [line.strip() for line in lines]
    assert reason.why
    assert reason.module in MODULES


def test_every_named_file_exists() -> None:
    """Modules and their tests."""
    assert [
        name for module, tests in MODULES.items() for name in (module, *tests) if not Path(ROOT / name).exists()
    ] == []


def test_every_score_is_of_a_module_and_follows_from_its_counts() -> None:
    with SCORES.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["module"] for row in rows} <= set(MODULES)
    for row in rows:
        counts = (int(row[name]) for name in ("tried", "killed", "equivalent"))
        again = score(row["module"], row["date"], *counts, whole=row["all"] == "True")
        assert {name: str(value) for name, value in again.items()} == row
