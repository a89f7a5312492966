"""The package: every import declared, every declaration imported, one version, the files that belong to it."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import defaultdict
from importlib import metadata

import pytest

import boat_daq
from analysis.optional import EXTRAS
from tests.conftest import ROOT

PACKAGES = ("boat_daq", "protocol", "analysis")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def canonical(requirement: str) -> str:
    """Return the name of a distribution in a requirement, as package indexes compare it."""
    name = re.match(r"[\w.-]+", requirement)
    assert name, requirement
    return re.sub(r"[-_.]+", "-", name[0]).lower()


DECLARED = {canonical(requirement) for requirement in PROJECT["dependencies"]}
EXTRA = {
    canonical(requirement)
    for extra, requirements in PROJECT["optional-dependencies"].items()
    for requirement in requirements
    if extra != "all"
}


@pytest.fixture(scope="module")
def imported() -> dict[str, set[str]]:
    """The top packages that the program imports, of neither Python nor ourselves, each with its modules."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                if isinstance(node, ast.ImportFrom) and not node.level:
                    names = [node.module or ""]
                for name in {name.partition(".")[0] for name in names} - sys.stdlib_module_names - {*PACKAGES}:
                    found[name].add(path.relative_to(ROOT).as_posix())
    return found


def distributions(module: str) -> set[str]:
    """Return the names of the distributions that bring a module."""
    return {canonical(name) for name in metadata.packages_distributions()[module]}


def test_every_import_is_declared(imported: dict[str, set[str]]) -> None:
    """Each by its own distribution, not by one that happens to bring it along."""
    optional = {name for name in imported if name in EXTRAS}
    assert {name for name in imported.keys() - optional if not distributions(name) & DECLARED} == set()


def test_every_declaration_is_imported(imported: dict[str, set[str]]) -> None:
    """A library that nothing imports is not installed."""
    used = {name for module in imported for name in distributions(module)}
    assert used >= DECLARED


def test_extras_are_imported_where_they_are_used(imported: dict[str, set[str]]) -> None:
    """Through `optional`, or in the one module that is all about the library; each is an extra and no requirement."""
    assert {module: imported[module] for module in EXTRAS if module in imported} == {
        "skfem": {"analysis/shadow/fem/scikit_fem.py"}
    }
    for module, (_, extra) in EXTRAS.items():
        declared = {canonical(name) for name in PROJECT["optional-dependencies"][extra]}
        assert distributions(module) & declared, module
    assert not DECLARED & EXTRA


def test_all_is_every_extra() -> None:
    """`boat-daq[all]` leaves none out."""
    extras = PROJECT["optional-dependencies"]
    assert extras["all"] == [f"boat-daq[{','.join(sorted(extras.keys() - {'all'}))}]"]


def test_version_is_one() -> None:
    """The installed program and the module give the same version, which is written in one place."""
    assert "version" in PROJECT["dynamic"]
    assert metadata.version("boat-daq") == boat_daq.__version__
