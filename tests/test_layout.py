"""The layout of the sources: small folders, one name for one class, tests beside what they test, no import circle."""

from __future__ import annotations

import ast
import itertools
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from analysis.calibration.record import CalibrationRecord, SensorRecord
from tests.conftest import ROOT

PACKAGES = ("boat_daq", "protocol", "analysis")
MOST_MODULES = 16
WITHOUT_LIMIT = {Path("boat_daq/commands")}  # one file for each group of commands
NO_MIRROR = {
    "benchmarks",
    "docs",
    "field",
    "faults",
    "firmware",
    "mutation",
    "system",
    "vectors",
    "verification",
}  # what concerns no single package


def modules(folder: Path) -> list[Path]:
    """Return the modules of one folder."""
    return sorted(path for path in folder.glob("*.py") if path.stem != "__init__")


def sources() -> list[Path]:
    """Return every source file of the three packages, relative to the checkout."""
    return sorted(path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def test_no_folder_holds_more_than_about_15_modules() -> None:
    """At most about 15 modules a folder."""
    folders = {path.parent for path in sources()} - WITHOUT_LIMIT
    counts = {str(folder): len(modules(ROOT / folder)) for folder in folders}
    assert {name: count for name, count in counts.items() if count > MOST_MODULES} == {}


def test_every_package_has_a_docstring() -> None:
    """Each package has a docstring."""
    packages = [path for path in sources() if path.name == "__init__.py"]
    assert [str(p) for p in packages if not ast.get_docstring(ast.parse((ROOT / p).read_text(encoding="utf-8")))] == []


def test_a_public_class_name_is_unique() -> None:
    """No two classes of one public name."""
    modules_of: defaultdict[str, list[str]] = defaultdict(list)
    for path in sources():
        for name in re.findall(r"^class ([^\W_]\w*)", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE):
            modules_of[name].append(str(path))
    assert len(modules_of) > 500
    assert {name: paths for name, paths in modules_of.items() if len(paths) > 1} == {}


def test_tests_mirror_the_sources() -> None:
    """`tests/a/b/test_c_anything.py` tests the module or package `a/b/c`, or the package `a/b` itself."""
    unmatched = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        folder = path.relative_to(ROOT / "tests").parent
        if folder == Path() or folder.parts[0] in NO_MIRROR:
            continue
        inside = ROOT / folder
        names = {p.stem for p in inside.iterdir() if p.suffix == ".py" or p.is_dir()} if inside.is_dir() else set()
        names |= {p.stem.lower() for p in inside.glob("*.md")} if inside.is_dir() else set()
        tested = path.stem.removeprefix("test_")
        if not any(tested == name or tested.startswith(f"{name}_") for name in names):
            unmatched.append(str(path.relative_to(ROOT)))
    assert unmatched == []


def test_sql_is_written_where_recordings_are_read() -> None:
    """Neither the window nor a command holds a query."""
    folders = ("viewmodels", "gui", "commands", "workflows")
    texts = {
        path: path.read_text(encoding="utf-8") for name in folders for path in (ROOT / "boat_daq" / name).rglob("*.py")
    }
    assert len(texts) > 60
    assert [str(path) for path, text in texts.items() if re.search(r"\bSELECT\b|\bsqlite3\.connect\b", text)] == []


def test_view_models_hold_no_stored_form_of_a_calibration() -> None:
    """Its keys are those of `analysis.calibration.record` alone, and its entries are read by workflows."""
    keys = {"reading_sd_mm", "model_mv", "between_cycles_mv", "half_loop_mv", "recording_id", "poor"}
    assert keys <= {*SensorRecord().as_json(), *CalibrationRecord((), simulated=False).as_json()}
    paths = [path for name in ("viewmodels", "gui", "commands") for path in (ROOT / "boat_daq" / name).rglob("*.py")]
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}
    found = {path: [key for key in keys if f'"{key}"' in text] for path, text in texts.items()}
    assert len(found) > 60
    assert {path: held for path, held in found.items() if held} == {}


CIRCLES = {  # the module that gets one more import, the import, the package in which a circle is then reported
    "for types only": (
        "analysis/data/recording.py",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from analysis.data.boat_file import read_boat_file\n",
        "analysis.data",
    ),
    "inside a function": (
        "analysis/calibration/joint_fit.py",
        "def late() -> None:\n    from analysis.calibration.fit import fit_by_branch\n",
        "analysis.calibration",
    ),
    "between folders": (
        "boat_daq/engine/link/reader.py",
        "from boat_daq.engine.recording.recorder import Recorder\n",
        "boat_daq.engine",
    ),
}
LINT = "import sys; sys.path.insert(0, ''); from importlinter.cli import lint_imports_command; lint_imports_command()"


def test_circles_of_imports_are_found(tmp_path: Path) -> None:
    """The contracts of pyproject.toml fail on each of the circles that are added to a copy of the sources."""
    for source in sources():
        (tmp_path / source).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / source, tmp_path / source)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for module, imported, _ in CIRCLES.values():
        with (tmp_path / module).open("a", encoding="utf-8") as file:
            file.write(f"\n{imported}")
    command = [sys.executable, "-c", LINT, "--no-cache", "--no-logo"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    missed = [kind for kind, (_, _, name) in CIRCLES.items() if f"No cycles are allowed in {name}." not in done.stdout]
    assert missed == []


RAISING = {"raises", "warns", "fail", "waitUntil", "waitSignal"}  # calls of pytest and pytest-qt that fail a test


def without_assertion(sources: Mapping[str, str]) -> list[str]:
    """Return the tests that assert nothing, neither themselves nor in a function of the tests that they call."""
    tests: list[tuple[str, str, set[str]]] = []
    calls: defaultdict[str, set[str]] = defaultdict(set)
    asserting: set[str] = set()
    for path, source in sources.items():
        body = ast.parse(source).body
        classes = (node.body for node in body if isinstance(node, ast.ClassDef))
        for node in itertools.chain(body, *classes):
            if not isinstance(node, ast.FunctionDef):
                continue
            inside = list(ast.walk(node))
            functions = [n.func for n in inside if isinstance(n, ast.Call)]
            called = {f.id for f in functions if isinstance(f, ast.Name)}
            methods = {f.attr for f in functions if isinstance(f, ast.Attribute)}
            raises = methods & RAISING or any(name.startswith("assert_") for name in methods)
            if raises or any(isinstance(n, ast.Assert) for n in inside):
                asserting.add(node.name)
            calls[node.name] |= called
            if node.name.startswith("test_"):
                tests.append((path, node.name, called | {node.name}))
    before = 0
    while before < len(asserting):
        before = len(asserting)
        asserting |= {name for name, called in calls.items() if called & asserting}
    return [f"{path}: {name}" for path, name, called in tests if not called & asserting]


def test_a_test_without_assertion_is_found() -> None:
    """One that calls a helper which asserts is none."""
    helper = "def check(x):\n    assert x\n"
    assert without_assertion({"a": f"{helper}def test_a():\n    check(1)\n", "b": "def test_b():\n    run()\n"}) == [
        "b: test_b"
    ]
    wait = "session" + ".wait(lambda s: s.latched, 5)"
    assert (ends_in_time(wait), ends_in_time(f"assert {wait}.latched")) == (True, False)


def test_every_test_asserts() -> None:
    """Else it passes whatever the product does."""
    files = sorted((ROOT / "tests").rglob("*.py"))
    texts = {str(p.relative_to(ROOT)): p.read_text(encoding="utf-8") for p in files}
    assert without_assertion(texts) == []
    silent = {path: lines for path, text in texts.items() if (lines := list(filter(ends_in_time, text.splitlines())))}
    assert silent == {}  # `reached` fails where the time is over


def ends_in_time(line: str) -> bool:
    """Whether a line waits for a session's state and goes on without it when the time is over."""
    return re.search(r"\w\.wait\(\s*lambda", line) is not None and "assert " not in line
