"""Names of the product: a public constant has one value, an option one unit of measurement in every command."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def constants(source: str) -> Iterator[tuple[str, str]]:
    """Yield name and value, as written, of the public constants of a module."""
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.Assign):
            targets, value = statement.targets, statement.value
        elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
            targets, value = [statement.target], statement.value
        else:
            continue
        for target in targets:
            pairs = [(target, value)]
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = list(zip(target.elts, value.elts, strict=True))
            for name, of in pairs:
                if isinstance(name, ast.Name) and name.id.isupper() and not name.id.startswith("_"):
                    yield name.id, ast.unparse(of)


def of_several_values(sources: Mapping[str, str]) -> dict[str, dict[str, list[str]]]:
    """Return the constants with more than one value: name -> value -> modules."""
    found: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for module, source in sources.items():
        for name, value in constants(source):
            found[name][value].append(module)
    return {name: dict(values) for name, values in found.items() if len(values) > 1}


def test_two_values_of_a_constant_are_found() -> None:
    """A tuple's parts and annotated constants count; private ones and functions do not."""
    sources = {
        "a": "FACTOR = 2.0\nLOW, HIGH = 0, 1\n_OWN = 3",
        "b": "FACTOR: float = 0.95\nHIGH = 2\n_OWN = 4\nLOW = 0",
    }
    assert of_several_values(sources) == {"FACTOR": {"2.0": ["a"], "0.95": ["b"]}, "HIGH": {"1": ["a"], "2": ["b"]}}


def test_a_public_constant_has_one_value() -> None:
    """A name that several modules import means one thing; what only its own module uses begins with an underscore."""
    paths = [path for package in ("protocol", "analysis", "boat_daq") for path in (ROOT / package).rglob("*.py")]
    sources = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}
    assert of_several_values(sources) == {}
