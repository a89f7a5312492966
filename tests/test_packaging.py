"""The package: every import declared, every declaration imported, one version, the files that belong to it."""

from __future__ import annotations

import ast
import contextlib
import functools
import importlib.util
import json
import re
import sys
import tomllib
from collections import defaultdict
from collections.abc import Mapping
from configparser import ConfigParser
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

import boat_daq
from boat_daq.cli import app
from boat_daq.commands import setup as examples
from boat_daq.engine import installation
from protocol.base.errors import RequestError
from protocol.base.optional import EXTRAS
from protocol.recording import SUFFIX
from protocol.recording.schema import APPLICATION_ID
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
IMPORTED = re.compile(r"^\s*(?:import (\w+)[\w.]*(?: as \w+)?(?: *#.*)?$|from (\w+)[\w.]* import )", re.MULTILINE)
"""The top package of an import as ruff formats it, one a line: to parse all sources takes 40 times as long."""


@pytest.fixture(scope="module")
def imported() -> dict[str, set[str]]:
    """The top packages that the program imports, of neither Python nor ourselves, each with its modules."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            names = {line[1] or line[2] for line in IMPORTED.finditer(path.read_text(encoding="utf-8"))}
            for name in names - sys.stdlib_module_names - {*PACKAGES}:
                found[name].add(path.relative_to(ROOT).as_posix())
    return found


@functools.cache
def distributions_by_module() -> Mapping[str, list[str]]:
    """Return what reads the lists of files of everything that is installed: seconds."""
    return metadata.packages_distributions()


def distributions(module: str) -> set[str]:
    """Return the names of the distributions that bring a module."""
    return {canonical(name) for name in distributions_by_module()[module]}


def test_every_import_is_declared(imported: dict[str, set[str]]) -> None:
    """Each by its own distribution, not by one that happens to bring it along."""
    optional = {name for name in imported if name in EXTRAS}
    assert {name for name in imported.keys() - optional if not distributions(name) & DECLARED} == set()


def test_every_declaration_is_imported(imported: dict[str, set[str]]) -> None:
    """A library that nothing imports is not installed."""
    used = {name for module in imported for name in distributions(module)}
    assert used >= DECLARED


def test_extras_are_imported_where_they_are_used(imported: dict[str, set[str]]) -> None:
    """Through `optional`; each is an extra and no requirement."""
    assert {module: imported[module] for module in EXTRAS if module in imported} == {}
    for module, (_, extra, requirements) in EXTRAS.items():
        assert list(requirements) == PROJECT["optional-dependencies"][extra]
        assert distributions(module) & {canonical(name) for name in requirements}, module
    assert not DECLARED & EXTRA


def test_lock_is_of_these_requirements() -> None:
    """`make lock` was run after the last change of a requirement: the same names and the same ranges."""
    locked = tomllib.loads((ROOT / "uv.lock").read_text(encoding="utf-8"))["package"]
    own = next(package for package in locked if package["name"] == "boat-daq")["metadata"]["requires-dist"]
    extras = (r for extra, each in PROJECT["optional-dependencies"].items() if extra != "all" for r in each)
    ranges = {
        canonical(requirement): set(re.findall(r"[<>=!~]+[^,;\s]+", requirement.partition(";")[0]))
        for requirement in (*PROJECT["dependencies"], *extras)
    }
    found = {entry["name"]: set(entry.get("specifier", "").split(",")) - {""} for entry in own}
    assert {name: limits for name, limits in found.items() if name != "boat-daq"} == ranges


def test_all_is_every_extra() -> None:
    """`boat-daq[all]` leaves none out."""
    extras = PROJECT["optional-dependencies"]
    assert extras["all"] == [f"boat-daq[{','.join(sorted(extras.keys() - {'all'}))}]"]


def test_version_is_one() -> None:
    """The installed program and the module give the same version, which is written in one place."""
    assert "version" in PROJECT["dynamic"]
    assert metadata.version("boat-daq") == boat_daq.__version__


def test_citation_names_this_version_and_the_paper() -> None:
    """CITATION.cff has the version of the program, and the paper's authors in their order."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {boat_daq.__version__}\n" in text
    names = re.findall(r"family-names: (\w+)", text)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert ", ".join(names) in readme


def test_pictures_of_the_readme_are_installed_beside_it() -> None:
    """Each picture has the same path from the installed README as in the checkout."""
    installed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["data-files"]
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert pictures
    for picture in map(Path, pictures):
        sources = installed[f"share/doc/boat-daq/{picture.parent.as_posix()}"]
        assert any(picture.match(source) for source in sources), picture
        assert (ROOT / picture).stat().st_size < 3e6


def test_readme_is_short() -> None:
    """At most 700 words, with a moving picture."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 700
    assert ".gif)" in text


def test_recordings_have_a_type_of_file_of_their_own() -> None:
    """The desktop recognises a recording by the mark that the program writes, and opens it with the program."""
    packaging = ROOT / "packaging"
    kind = ElementTree.parse(packaging / "boat-daq.xml").getroot()[0]
    names = {"m": "http://www.freedesktop.org/standards/shared-mime-info"}
    marks = [match.attrib["value"] for match in kind.findall("m:magic/m:match/m:match", names)]
    assert [int(mark, 16) for mark in marks] == [APPLICATION_ID]
    assert [glob.attrib["pattern"] for glob in kind.findall("m:glob", names)] == [f"*{SUFFIX}"]
    entry = ConfigParser(interpolation=None)
    entry.read(packaging / "boat-daq.desktop", encoding="utf-8")
    assert entry["Desktop Entry"]["MimeType"] == f"{kind.attrib['type']};"
    assert entry["Desktop Entry"]["Exec"] == "boat-daq gui %f"


def test_examples_are_copied_and_never_replaced(tmp_path: Path) -> None:
    """Recordings and notebook are there, the same bytes; a file of that name stays as it is."""
    out = tmp_path / "examples"
    done = CliRunner().invoke(app, ["examples", "--out", str(out), "--json"])
    assert done.exit_code == 0, done.output
    files = [Path(file) for file in json.loads(done.stdout)["files"]]
    sources = {path.name: path for path in (*(ROOT / "recordings").iterdir(), *ROOT.glob("docs/tutorial/*.ipynb"))}
    assert {file.name: file.read_bytes() for file in files} == {k: p.read_bytes() for k, p in sources.items()}
    assert len(sources) > 2
    files[0].write_text("mine")
    assert CliRunner().invoke(app, ["examples", "--out", str(out)]).exit_code == 0
    assert files[0].read_text() == "mine"


def test_examples_of_an_installation_are_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Beside no checkout: among the files that the installation lists; none is said with the remedy."""
    installed = tmp_path / "share" / "boat-daq" / "recordings" / "a.boat"
    installed.parent.mkdir(parents=True)
    installed.write_bytes(b"")
    file = metadata.PackagePath("share/boat-daq/recordings/a.boat")
    file.dist = metadata.PathDistribution(tmp_path / "boat_daq.dist-info")
    monkeypatch.setattr(installation, "ROOT", tmp_path)
    monkeypatch.setattr(installation.metadata, "files", lambda _: [file])
    assert examples.example_files() == [installed]
    monkeypatch.setattr(installation.metadata, "files", lambda _: None)
    with pytest.raises(RequestError, match="not installed"):
        examples.example_files()


@pytest.fixture(scope="module")
def notices() -> Any:
    """The tool that writes the notices of third parties."""
    spec = importlib.util.spec_from_file_location("notices", ROOT / "packaging" / "notices.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_third_parties_are_listed_as_they_are_installed(notices: Any) -> None:
    """`python packaging/notices.py` was run after the last change of the requirements; the package holds the list."""
    assert (ROOT / "THIRD-PARTY.txt").read_text(encoding="utf-8") == notices.name_list()
    assert "THIRD-PARTY.txt" in PROJECT["license-files"]
    assert {canonical(library.name) for library in notices.libraries()} >= DECLARED


def test_notices_of_a_bundle_hold_every_licence(notices: Any) -> None:
    """Each library with its text; of Qt the LGPL, and the GPL that it refers to."""
    text = notices.bundle_notices()
    for library in notices.libraries():
        assert f"{library.name} {library.version}: " in text
        assert any(len(part) > 200 for part in notices.texts(library)), library.name
    for words in ("GNU LESSER GENERAL PUBLIC LICENSE", "GNU GENERAL PUBLIC LICENSE", "download.qt.io", "Chris Liechti"):
        assert words in text


def test_extras_under_the_gpl_are_marked(notices: Any) -> None:
    """By the licences that their libraries state."""
    found = set()
    for extra, requirements in PROJECT["optional-dependencies"].items():
        for requirement in requirements if extra != "all" else ():
            with contextlib.suppress(metadata.PackageNotFoundError):
                library = metadata.distribution(canonical(requirement))
                stated = (library.metadata.get("License-Expression"), library.metadata.get("License"))
                if any(re.search(r"(?<![LA])GPL", words or "") for words in stated):
                    found.add(extra)
    assert found == set(notices.COPYLEFT)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(f"`{extra}`" in readme for extra in found)


def test_parts_of_qt_that_the_window_never_loads_are_left_out_of_the_bundle() -> None:
    """QML and Quick, whatever brings them along; what the window is made of stays."""
    tree = ast.parse((ROOT / "packaging" / "boat-daq.spec").read_text(encoding="utf-8"))
    (call,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "UNUSED_QT"
    )
    assert isinstance(call, ast.Call)
    unused = re.compile(ast.literal_eval(call.args[0]))
    out = ("lib/libQt6Qml.so.6", "lib/libQt6Quick.so.6", "qml/QtQuick/qmldir", "lib/libQt6VirtualKeyboard.so.6")
    kept = ("lib/libQt6Core.so.6", "lib/libQt6Svg.so.6", "plugins/platforms/libqxcb.so", "lib/libQt6DBus.so.6")
    assert all(unused.search(f"PySide6/Qt/{name}") for name in out)
    assert not any(unused.search(f"PySide6/Qt/{name}") for name in kept)
