"""The table of faults, from the tests' own marks: `make faults` writes it to out/FAULTS.md.

A test declares what it injects by `@pytest.mark.fault(NUMBER, how="...", times=1)` on a function, class or parameter.
The marks are read from the source without running it.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "out" / "FAULTS.md"
HEAD = """# Table of faults

Made by `make faults` from the marks of the tests. A row is a test: how it injects the fault, how many times, and
when it runs (CI: `make test`; nightly: `make nightly`). The test checks the outcome; in addition no recorded sample is
lost or altered, no user sees a traceback, and pressure never leaves its limits.
"""


@dataclass(frozen=True, slots=True)
class Fault:
    """A row of faults.toml."""

    number: int
    group: str
    happens: str
    demanded: str


@dataclass(frozen=True, slots=True)
class Injection:
    """A mark of a test."""

    number: int
    how: str
    times: int
    test: str
    nightly: bool


def faults() -> tuple[Fault, ...]:
    """Return the faults, in order."""
    rows = tomllib.loads((Path(__file__).parent / "faults.toml").read_text(encoding="utf-8"))["fault"]
    return tuple(Fault(**row) for row in rows)


@cache
def injections() -> list[Injection]:
    """Return every mark in tests/, by fault and file."""
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    found = [mark for path in files for mark in _marks(path)]
    return sorted(found, key=lambda mark: (mark.number, mark.nightly))


def _marks(path: Path) -> Iterator[Injection]:
    source = path.read_text(encoding="utf-8")
    if "mark.fault(" not in source and "few_and_many(" not in source:
        return
    tree = ast.parse(source)
    shared = [
        node for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
    ]
    whole = any(map(_is_nightly, shared))
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            nightly = whole or any(_is_nightly(d) for d in node.decorator_list if not _is_parametrize(d))
            for decorator in node.decorator_list:
                where = f"{path.relative_to(ROOT).as_posix()}::{node.name}"
                for call, inside in _fault_calls(decorator):
                    arguments = [ast.literal_eval(argument) for argument in call.args]
                    if _is_few_and_many(call):
                        number, how, few, many = arguments
                        yield Injection(number, how, few, where, nightly)
                        yield Injection(number, how, many, where, nightly=True)
                        continue
                    values = {key.arg: ast.literal_eval(key.value) for key in call.keywords}
                    for number in arguments:
                        yield Injection(number, values["how"], values.get("times", 1), where, nightly or inside)


def _fault_calls(node: ast.AST, nightly: bool = False) -> Iterator[tuple[ast.Call, bool]]:
    """Yield the marks and `few_and_many` calls inside a decorator, and whether each is a nightly parameter."""
    if isinstance(node, ast.Call) and (ast.unparse(node.func) == "pytest.mark.fault" or _is_few_and_many(node)):
        yield node, nightly
        return
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "pytest.param":
        nightly = nightly or _is_nightly(node)
    for child in ast.iter_child_nodes(node):
        yield from _fault_calls(child, nightly)


def _is_few_and_many(node: ast.Call) -> bool:
    return ast.unparse(node.func) == "few_and_many"


def _is_parametrize(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "pytest.mark.parametrize"


def _is_nightly(node: ast.AST) -> bool:
    return "pytest.mark.nightly" in ast.unparse(node) or "NIGHTLY" in ast.unparse(node)


def page() -> str:
    """Return the table as Markdown."""
    marks = injections()
    lines = [HEAD]
    group = ""
    for fault in faults():
        if fault.group != group:
            group = fault.group
            lines += [f"## {group}", ""]
        lines += [f"**{fault.number}. {fault.happens}** — {fault.demanded}", "", "| injected | times | test | when |"]
        lines += ["|---|---:|---|---|"]
        lines += [
            f"| {mark.how} | {mark.times:,} | `{mark.test}` | {'nightly' if mark.nightly else 'CI'} |"
            for mark in marks
            if mark.number == fault.number
        ]
        lines.append("")
    total = sum(mark.times for mark in marks)
    lines.append(f"{len(faults())} faults, {len(marks)} injections by marked tests, {total:,} times in all.")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"{PAGE.relative_to(ROOT)} written\n")
