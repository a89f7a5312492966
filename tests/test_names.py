"""Names of the product: a public constant is defined once, an option has one unit of measurement in every command."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from boat_daq.cli import app

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
                if isinstance(name, ast.Name) and re.fullmatch(r"[A-Z][A-Z0-9_]+", name.id):  # T is a type variable
                    yield name.id, ast.unparse(of)


def defined_twice(sources: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return the constants of more than one module: name -> module -> value."""
    found: dict[str, dict[str, str]] = defaultdict(dict)
    for module, source in sources.items():
        for name, value in constants(source):
            found[name][module] = value
    return {name: values for name, values in found.items() if len(values) > 1}


def test_constants_of_two_modules_are_found() -> None:
    """A tuple's parts and annotated constants count; private ones do not."""
    sources = {"a": "FACTOR = 2.0\nLOW, HIGH = 0, 1\n_OWN = 3", "b": "FACTOR: float = 0.95\nHIGH = 1\n_OWN = 4"}
    assert defined_twice(sources) == {"FACTOR": {"a": "2.0", "b": "0.95"}, "HIGH": {"a": "1", "b": "1"}}


def test_a_public_constant_is_defined_once() -> None:
    """A name that several modules import has one value, from one module; what one module uses is private to it."""
    paths = [path for package in ("protocol", "analysis", "boat_daq") for path in (ROOT / package).rglob("*.py")]
    sources = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}
    modules: dict[str, set[str]] = defaultdict(set)
    for module, source in sources.items():
        for names in re.findall(r"^([A-Z][A-Z0-9_, ]*)(?: =|: )", source, re.MULTILINE):
            for name in names.split(", "):
                modules[name].add(module)
    assert len(modules) > 500
    shared = set().union(*(held for held in modules.values() if len(held) > 1))  # to parse all takes seconds
    assert defined_twice({module: sources[module] for module in shared}) == {}


UNITS = ("mm", "mm²", "kpa", "kpa/s", "s", "hz", "mv", "db/cm", "rays", "percent", "samples/s")
HELP = re.compile(rf"(?:, |\b)({'|'.join(map(re.escape, UNITS))})(?=[;,.]|$)", re.IGNORECASE)


def unit_of(metavar: str | None, text: str) -> str:
    """Return the unit of measurement that an option's metavar or help gives, in lower case; "" where none does."""
    named = (metavar or "").lower().replace("_per_", "/")
    if named in UNITS:
        return named
    found = HELP.search(text.partition(";")[0])
    return found[1].lower() if found else ""


def of_several_units(options: Iterable[tuple[str, str | None, str]]) -> dict[str, set[str]]:
    """Return the options with more than one unit, of rows (option, metavar, help)."""
    units: dict[str, set[str]] = defaultdict(set)
    for option, metavar, text in options:
        if unit := unit_of(metavar, text):
            units[option].add(unit)
    return {option: found for option, found in units.items() if len(found) > 1}


def numeric_options(command: Any) -> Iterator[tuple[str, str | None, str]]:
    """Yield name, metavar and help of every option of the commands that takes a number."""
    for below in getattr(command, "commands", {}).values():
        yield from numeric_options(below)
    for parameter in command.params:
        if parameter.param_type_name == "option" and _takes_number(parameter):
            yield from ((name, parameter.metavar, parameter.help or "") for name in parameter.opts)


def _takes_number(parameter: Any) -> bool:
    kind = getattr(parameter, "type_descriptor", None) or parameter.type  # typer's own, or click's
    return any(word in str(getattr(kind, "annotation", kind)).lower() for word in ("float", "int"))


def test_two_units_of_an_option_are_found() -> None:
    """By the metavar, or by the unit that ends the first clause of the help."""
    rows = [("--far", "MM", "Distance."), ("--far", None, "Distance, kPa; at most."), ("--long", None, "Length, mm.")]
    assert of_several_units(rows) == {"--far": {"mm", "kpa"}}


def test_an_option_has_one_unit() -> None:
    """An option of several commands is given in the same unit of measurement in all."""
    rows = list(numeric_options(typer.main.get_command(app)))
    assert ("--check-point", "mm") in {(name, unit_of(metavar, text)) for name, metavar, text in rows}
    assert of_several_units(rows) == {}
