"""Rules for the program's source: how databases are opened and SQL is built, and that no input is evaluated."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from tests.faults.drill import ROOT

PRODUCT = [path for package in ("protocol", "analysis", "boat_daq") for path in sorted((ROOT / package).rglob("*.py"))]

CALLS = {"extractall", "extract", "unpack_archive", "eval", "exec", "read_pickle", "system", "load"}


@cache
def sources() -> list[tuple[Path, str]]:
    """Return the program's files with their text."""
    return [(path, path.read_text(encoding="utf-8")) for path in PRODUCT]


def functions_that(calls: str) -> list[tuple[Path, str]]:
    """Return every function of the program, with its source, that contains a call."""
    trees = [(path, ast.parse(source)) for path, source in sources() if calls in source]
    functions = [(path, node) for path, tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return [(path, source) for path, node in functions if calls in (source := ast.unparse(node))]


def test_every_database_connection_is_hardened() -> None:
    """A function that opens SQLite hardens the connection at once, or opens a file that it created itself."""
    found = functions_that("sqlite3.connect(")
    assert len(found) >= 7
    for path, source in found:
        own = "':memory:'" in source or "unfinished" in source
        assert own or "harden(" in source or "trusted_schema=off" in source, path


def test_sql_values_are_parameters() -> None:
    """S608 is enabled; a waived line inserts names of columns and tables, never a value."""
    import tomllib

    ruff = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ruff"]["lint"]
    assert "S" in ruff["select"]
    assert not {"S", "S6", "S608"} & set(ruff["ignore"])
    waived = [line for _, source in sources() for line in source.splitlines() if "S608" in line]
    assert waived
    assert all("VALUES ('" not in line and "= '{" not in line for line in waived)


@pytest.mark.fault(50, how="the whole program searched for calls that unpickle, evaluate, or read YAML tags", times=1)
@pytest.mark.fault(51, how="the whole program searched for calls that unpack an archive into files", times=1)
def test_no_input_is_evaluated() -> None:
    """No pickle, YAML, eval or exec; arrays are loaded without objects, archives never unpacked into files."""
    forbidden = {"pickle", "marshal", "shelve", "yaml", "dill", "joblib", "cloudpickle", "tarfile"}
    held = re.compile("|".join(forbidden | CALLS))
    for path, source in sources():
        for node in ast.walk(ast.parse(source)) if held.search(source) else ():
            names: set[str] = set()
            if isinstance(node, ast.Import):
                names = {alias.name.split(".")[0] for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                names = {(node.module or "").split(".")[0]}
            assert not names & forbidden, path
            if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in CALLS:
                called = ast.unparse(node.func)
                unpacking = (".extractall", ".extract", "unpack_archive")
                assert not called.removesuffix(".str.extract").endswith(unpacking), path
                assert called not in {"eval", "exec", "pd.read_pickle", "os.system"}, path
                if called in {"np.load", "numpy.load"}:
                    options = {key.arg: ast.unparse(key.value) for key in node.keywords}
                    assert options.get("allow_pickle") == "False", path


WRITES = {"write_text", "write_bytes", "savefig", "savez"}
NOT_WHOLE = {  # function: why it writes on its own
    "_open_truth": "the true values of a virtual board grow while it runs",
    "_keep": "a copy under a name that nothing had, flushed there",
    "analysed_with": "in a temporary folder",
    "first_difference": "in a temporary folder",
    "_again": "in a temporary folder",
    "_from_sheet": "in a temporary folder",
    "_standard_input": "in a temporary folder",
    "_write_csv": "into the part that `export` gives it",
    "as_svg": "in memory",
}


def writes(call: ast.Call) -> bool:
    """Whether a call writes a file: by a method of a path or a figure, or by one opened for it."""
    name = getattr(call.func, "attr", "")
    modes = [value.value for value in call.args if isinstance(value, ast.Constant) and isinstance(value.value, str)]
    return name in WRITES or (name in {"open", "ZipFile"} and any(mode[:1] in "wx" for mode in modes if mode))


def test_files_are_written_whole() -> None:
    """Every function that writes a file does so by `protocol.base.whole_file`, or is named above."""
    candidates = (*WRITES, "open(", "ZipFile(")
    trees = [ast.parse(source) for _, source in sources() if any(name in source for name in candidates)]
    functions = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    writers = [f for f in functions if any(isinstance(n, ast.Call) and writes(n) for n in ast.walk(f))]
    assert len(writers) > len(NOT_WHOLE)
    assert {f.name for f in writers if "written_whole(" not in ast.unparse(f)} == set(NOT_WHOLE)
