"""Machine code is kept between processes, and never older than any source that is compiled into it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

import analysis
import analysis.compiled as module
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
import sys
from analysis.compiled import CACHE_FOLDER
from analysis.optics.tracer.outer import outer
from analysis.progress import compiling
with compiling(lambda done, total: print(f"{done} of {total}", file=sys.stderr)):
    print(outer(10), sum(outer.stats.cache_hits.values()), CACHE_FOLDER)
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A package of two compiled functions in two files, one calling the other."""
    for name in ("analysis", *(f"analysis/{package}" for package in ("optics", *PACKAGES))):
        (tmp_path / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / name / "__init__.py").touch()
    for name in ("compiled.py", "progress.py"):
        shutil.copy(SOURCES / name, tmp_path / "analysis")
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
    counted = [] if int(hits) else ["compiling once, about 0 s", "1 of 2", "2 of 2"]
    assert ran.stderr.splitlines() == counted
    return int(value), int(hits), Path(folder)


def test_only_an_edit_compiles_again(tree: Path) -> None:
    """One of the same length and with the same date, of a function called from another file, changes the result."""
    assert run(tree)[:2] == (21, 0)
    assert run(tree)[:2] == (21, 1)
    inner = tree / "analysis/optics/scene/inner.py"
    dated = inner.stat()
    inner.write_text(INNER.format(factor=3))
    os.utime(inner, ns=(dated.st_atime_ns, dated.st_mtime_ns))
    assert run(tree)[:2] == (31, 0)


def test_a_new_compiler_has_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other versions of all other libraries load the machine code that is there."""
    assert module.CACHE_FOLDER is not None
    assert module.CACHE_FOLDER.name == f"compiled-{module._sources_hash()}"
    changed: set[str] = set()
    known = module.version
    monkeypatch.setattr(module, "version", lambda name: "99.0" if name in changed else known(name))
    hashes = [module._sources_hash()]
    for others in ({"numpy", "scipy", "pyside6", "boat-daq"}, {"llvmlite"}):
        changed = others
        hashes.append(module._sources_hash())
    monkeypatch.setattr(module.numba, "__version__", "99.0")
    hashes.append(module._sources_hash())
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 3


@pytest.mark.nightly
def test_the_first_call_says_that_it_compiles_and_no_later_one(tmp_path: Path) -> None:
    """Of the tracer, as `run` above has it of two small functions: one line where the cache is empty, then none."""
    program = "from analysis.optics.tracer.simulation import fan_step; fan_step(120.0, 250, 2.0)"
    for said in (r"compiling once, about \d+ s\n", ""):
        ran = subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert re.fullmatch(said, ran.stderr)
        assert ran.stdout == ""


def test_threads_that_decorate_side_by_side_use_the_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """One restored the empty path while the other was at work: a folder of machine code in the current directory."""
    used: list[str] = []
    inside, done = [threading.Event(), threading.Event()], threading.Event()

    def decorate(**_: object) -> Callable[[object], object]:
        first = not inside[0].is_set()
        inside[0 if first else 1].set()
        (inside[1] if first else done).wait(0.2)  # the second is not inside before the first is done
        used.append(module._CONFIG.CACHE_DIR)
        return lambda function: function

    monkeypatch.setattr(module.numba, "njit", decorate)
    monkeypatch.setattr(module, "_noted", lambda function: function)
    second = threading.Thread(target=lambda: inside[0].wait() and module.compiled(print))
    second.start()
    module.compiled(print)
    done.set()
    second.join()
    assert used == [str(module.CACHE_FOLDER)] * 2


def test_an_installed_package_keeps_machine_code_in_the_users_folder(tree: Path) -> None:
    """A new installation replaces what lies beside the old one; the user's cache folder stays."""
    installed = tree / "site-packages"
    installed.mkdir()
    (tree / "analysis").rename(installed / "analysis")
    _, _, folder = run(installed)
    assert folder.is_relative_to(installed / "cache")
    assert not list((installed / "analysis").rglob("*.nbi"))


def test_what_is_compiled_ahead_serves_every_later_call() -> None:
    """After `compile_all` a trace, a sweep, a frame of the shadow, an inverse and a run's cycles compile nothing."""
    program = """
import numba
from numba.core import event
from analysis import analyse
from analysis.compile_all import COMPILE_STEPS, compile_all
compile_all()
started = []

class Counted(event.Listener):
    def on_start(self, event):
        started.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event):
        pass

event.register("numba:compile", Counted())
for step in COMPILE_STEPS.values():
    step()
analyse("recordings/simulated_SA1_two_cycles.boat", mcmc=False)
print(started)

numba.njit(lambda x: x)(1)
print(started)
"""
    ran = subprocess.run(
        [sys.executable, "-c", program], cwd=SOURCES.parent, capture_output=True, text=True, check=True
    )
    assert ran.stdout.splitlines() == ["[]", "['<lambda>']"]


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
