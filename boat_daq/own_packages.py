"""The program's own `protocol` and `analysis`, where other files and packages have these names too.

Python imports what is first on `sys.path`: a lab's `analysis.py` beside a script, or with `python -m`. The program
orders `sys.path` before importing; in a script, a package refuses a stranger in place of another one of ours. Nothing
is imported to find out: a lab's file may start a measurement.
"""

from __future__ import annotations

import os
import sys
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
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


def adopt_own_packages() -> None:
    """Make `protocol` and `analysis` the program's own in a script, also beside a lab's packages of these names.

    What the lab's package holds is still found under its name: modules in its folder, names in its `__init__`, which is
    run when one of them is first used. A module of the same name as one of ours is hidden.
    """
    for name in NAMES:
        loaded, own = sys.modules.get(name), ROOT / name / "__init__.py"
        if _is_own(loaded, own):
            continue
        spec = find_spec(name) if loaded is None else loaded.__spec__
        if loaded is None and spec is not None and spec.origin and Path(spec.origin).resolve() == own:
            continue
        for module in [module for module in sys.modules if module.startswith(f"{name}.")]:
            del sys.modules[module]
        found = spec_from_file_location(name, own, submodule_search_locations=[str(own.parent)])
        assert found is not None
        assert found.loader is not None
        ours = sys.modules[name] = module_from_spec(found)
        found.loader.exec_module(ours)
        if spec is not None:
            if str(ROOT) != sys.path[0]:  # which spawned processes take over
                sys.path.insert(0, str(ROOT))
            ours.__path__ += list(spec.submodule_search_locations or ())
            _add_names(ours, loaded, spec)


def _is_own(module: ModuleType | None, own: Path) -> bool:
    return module is not None and bool(module.__file__) and Path(str(module.__file__)).resolve() == own


def _add_names(ours: ModuleType, labs: ModuleType | None, spec: ModuleSpec) -> None:
    """Look names that our package lacks up in the lab's, which is loaded for it where that was not done yet."""
    known, loaded = ours.__dict__["__getattr__"], [labs] if labs is not None else []

    def look_up(name: str) -> Any:
        try:
            return known(name)
        except AttributeError:
            if spec.loader is None or name.startswith("__") or find_spec(f"{ours.__name__}.{name}"):
                raise  # `from analysis import module` asks here first
            if not loaded:
                loaded.append(module_from_spec(spec))
                spec.loader.exec_module(loaded[0])
            return getattr(loaded[0], name)

    ours.__dict__["__getattr__"] = look_up


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
