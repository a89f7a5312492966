"""The program's own `protocol` and `analysis`, where other files and packages have these names too.

Python imports what is first on `sys.path`: a lab's `analysis.py` beside a script, or with `python -m`. The program
orders `sys.path` before importing; in a script, a package refuses a stranger in place of another one of ours. Nothing
is imported to find out: a lab's file may start a measurement.
"""

from __future__ import annotations

import os
import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import subprocess

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("protocol", "analysis")


def prefer_own_packages() -> None:
    """Order `sys.path` so that `protocol` and `analysis` are the program's own, in helper processes as well.

    The working folder, first with `python -m`, is left out: any of its files could hide a library's. PYTHONSAFEPATH
    holds for the first imports of a spawned process, which then takes over `sys.path`.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    if not sys.flags.safe_path and Path(sys.path[0]).resolve() == Path.cwd().resolve() != ROOT:
        del sys.path[0]
    at = next((i for i, entry in enumerate(sys.path) if Path(entry).resolve() == ROOT), len(sys.path))
    hiding = [entry for entry in sys.path[:at] if any(PathFinder.find_spec(name, [entry]) for name in NAMES)]
    if hiding:
        before = [entry for entry in sys.path[:at] if entry not in hiding]
        sys.path[:] = [*before, str(ROOT), *hiding, *sys.path[at + 1 :]]


def require_own(name: str) -> None:
    """Refuse another `name` than the program's own package. ImportError: names what is found, and the remedy."""
    spec = find_spec(name)
    found = Path(spec.origin or next(iter(spec.submodule_search_locations or [""]))) if spec is not None else None
    if found is None or found.resolve() == ROOT / name / "__init__.py":
        return
    if {"site-packages", "dist-packages"} & set(found.parts):
        remedy = "Use an environment without the package that it belongs to."
    else:
        remedy = "Rename it, or move it to another folder."
    raise ImportError(f"{found} would be imported in place of boat-daq's package '{name}'. {remedy}", name=name)


def start_module(module: str, *arguments: str, **options: Any) -> subprocess.Popen[Any]:
    """Start a module as `python -m` does, without the working folder on its path; `options` are those of `Popen`."""
    import subprocess

    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    command = [sys.executable, "-P", "-m", module, *arguments]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}, **options)
