"""Machine code is kept between processes, and never older than any source that is compiled into it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import analysis
from analysis.compiled import PACKAGES

SOURCES = Path(analysis.__file__).parent
OUTER = """
from analysis.compiled import compiled
from analysis.optics.scene.inner import inner

@compiled
def outer(x):
    return inner(x) + 1
"""
INNER = """
from analysis.compiled import compiled

@compiled
def inner(x):
    return x * {factor}
"""
PROGRAM = """
from analysis.compiled import CACHE_FOLDER
from analysis.optics.tracer.outer import outer
print(outer(10), sum(outer.stats.cache_hits.values()), CACHE_FOLDER)
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A package of two compiled functions in two files, one calling the other."""
    for name in ("analysis", *(f"analysis/{package}" for package in ("optics", *PACKAGES))):
        (tmp_path / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / name / "__init__.py").touch()
    shutil.copy(SOURCES / "compiled.py", tmp_path / "analysis")
    (tmp_path / "analysis/optics/tracer/outer.py").write_text(OUTER)
    (tmp_path / "analysis/optics/scene/inner.py").write_text(INNER.format(factor=2))
    return tmp_path


def run(tree: Path) -> tuple[int, int, Path]:
    """Return the result in a process of its own, how often machine code was loaded, and the folder it is kept in."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    environment |= {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1", "XDG_CACHE_HOME": str(tree / "cache")}
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=tree, env=environment, capture_output=True, text=True, check=True
    )
    value, hits, folder = ran.stdout.split()
    return int(value), int(hits), Path(folder)


def test_an_edit_of_another_file_is_compiled_again(tree: Path) -> None:
    """An edit of the same length and with the same date of a function called from another file changes the result."""
    assert run(tree)[:2] == (21, 0)
    assert run(tree)[:2] == (21, 1)
    inner = tree / "analysis/optics/scene/inner.py"
    dated = inner.stat()
    inner.write_text(INNER.format(factor=3))
    os.utime(inner, ns=(dated.st_atime_ns, dated.st_mtime_ns))
    assert run(tree)[:2] == (31, 0)


@pytest.mark.nightly
def test_a_read_only_installation_keeps_machine_code_in_the_users_folder(tree: Path) -> None:
    """Where nothing can be written beside the sources the user's cache folder is used."""
    (tree / "analysis/__pycache__").write_text("no folder can be made here")
    value, _, folder = run(tree)
    assert value == 21
    assert folder.is_relative_to(tree / "cache")
    assert list(folder.rglob("*outer*.nbc"))


@pytest.mark.nightly
def test_without_any_folder_every_process_compiles(tree: Path) -> None:
    """A cache that cannot be written costs time, never the answer."""
    for name in ("analysis/__pycache__", "cache"):
        (tree / name).write_text("no folder can be made here")
    assert run(tree) == (21, 0, Path("None"))
    assert not list(tree.rglob("*.nb[ic]"))


def test_compiled_functions_lie_where_the_cache_expects_them() -> None:
    """Only functions that call no compiled function of another file may lie outside the hashed packages."""
    decorated = [f for f in SOURCES.rglob("*.py") if re.search(r"^@(compiled|inner|numba|njit)", f.read_text(), re.M)]
    outside = {f for f in decorated if f.parent.relative_to(SOURCES).as_posix() not in PACKAGES}
    assert len(decorated) > len(outside) + 5
    for file in outside - {SOURCES / "compiled.py"}:
        assert not re.search(rf"from analysis\.({'|'.join(PACKAGES).replace('/', '.')})", file.read_text()), file
