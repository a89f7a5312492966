"""The one decorator of compiled functions, and the folder in which their machine code is kept.

Compiled functions release the interpreter's lock, so that threads run side by side. No fast-math unless requested: IEEE
arithmetic in the written order gives identical bits on any number of cores or computers.

numba reuses cached code while the function's own file is unchanged, although functions of other files are compiled into
it. The cache folder is therefore named by a hash of all files in `PACKAGES` and of the compiler's versions. It lies
beside the sources of a checkout, and in the user's cache folder where they are installed. What takes long to compile is
announced once by the logger `analysis.compiled`, which writes to standard error; `analysis.progress.compiling` shows
how much of it is done.

Rule: a compiled function calls compiled functions of its own file or of `PACKAGES` only (tested).
"""

from __future__ import annotations

import hashlib
import logging
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numba
import numba.extending
import numpy as np
import platformdirs
from numba.core import cgutils, event

from analysis.progress import show_compiled

Function = TypeVar("Function", bound=Callable[..., Any])

PACKAGES = ("optics/scene", "optics/tracer", "shadow/fem")
ANNOUNCED = ("analysis.optics", "analysis.shadow")
"""Packages that take long to compile; elsewhere it is not worth a line."""
FUNCTION_S = 0.2  # CPU time that a function takes to compile, in the mean
UNUSED_S = 30 * 86_400.0
_HERE = Path(__file__).parent
_INSTALLED = {"site-packages", "dist-packages"}
_LOG = logging.getLogger(__name__)
_CONFIG: Any = numba.config


def _sources_hash() -> str:
    files = [Path(__file__), *(file for name in PACKAGES for file in sorted((_HERE / name).glob("*.py")))]
    versions = f"{numba.__version__} {version('llvmlite')} {sys.implementation.cache_tag}".encode()
    return hashlib.sha256(b"".join([versions, *(file.read_bytes() for file in files)])).hexdigest()[:16]


def _cache_folder() -> Path | None:
    """Return the first folder that can be written, or None: every process then compiles for itself."""
    chosen = [Path(_CONFIG.CACHE_DIR)] if _CONFIG.CACHE_DIR else []
    name = f"compiled-{_sources_hash()}"
    places = [_HERE / "__pycache__", platformdirs.user_cache_path("boat-daq") / "compiled"]
    if _INSTALLED & set(_HERE.parts):  # a new installation would lose what lies beside the old one
        places.reverse()
    for base in (*chosen, *places):
        try:
            (base / name).mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=base / name):
                _remove_unused(base)
                return base / name
        except OSError:
            continue
    return None


def _remove_unused(base: Path) -> None:
    """Remove the machine code of sources that were replaced long ago."""
    for folder in base.glob("compiled-*"):
        if time.time() - folder.stat().st_mtime > UNUSED_S:
            shutil.rmtree(folder, ignore_errors=True)


CACHE_FOLDER = _cache_folder()
_FUNCTIONS: set[Any] = set()
_DIRECTING = threading.Lock()  # two threads that import: one would restore what the other has set, an empty path


def _with_callees(function: Any) -> set[Any]:
    """Return a function and the compiled functions that it calls, directly or not."""
    found, waiting = set(), [function]
    while waiting:
        if (each := waiting.pop()) not in found:
            found.add(each)
            code, names = each.py_func.__code__, each.py_func.__globals__
            modules = [vars(names[name]) for name in code.co_names if isinstance(names.get(name), ModuleType)]
            named = (place.get(name) for place in (names, *modules) for name in code.co_names)
            waiting += [called for called in named if hasattr(called, "py_func") and called is not pointers]
    return found


def _package_of(function: Any) -> str:
    return ".".join(function.py_func.__module__.split(".")[:2])


class _Compilation(event.Listener):
    """Counts the functions that are compiled, and says once for each package that it begins."""

    def __init__(self) -> None:
        self._depth = 0
        self._said: set[str] = set()
        self.done: set[Any] = set()
        self.expected: set[Any] = set()

    def on_start(self, event: Any) -> None:
        """Expect what a function calls, and what may follow: the package's functions that do not call it."""
        function = event.data["dispatcher"]
        if function not in _FUNCTIONS:
            return
        if self._depth == 0:
            package = _package_of(function)
            calls = {each: _with_callees(each) for each in _FUNCTIONS if _package_of(each) == package}
            entries = [each for each in calls if "no_cpython_wrapper" not in each.targetoptions]
            self.expected |= calls[function].union(*(calls[each] for each in entries if function not in calls[each]))
            if package in ANNOUNCED and package not in self._said:
                self._said.add(package)
                _LOG.warning("compiling once, about %.0f s", len(self.expected - self.done) * FUNCTION_S)
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """Show how many are compiled, of how many."""
        function = event.data["dispatcher"]
        if function in _FUNCTIONS:
            self._depth -= 1
            self.done.add(function)
            show_compiled(len(self.done), len(self.expected), all_called=self._depth == 0)


_COMPILATION = _Compilation()
cast(Any, event).register("numba:compile", _COMPILATION)


def expect_all() -> None:
    """Expect that all functions that are imported will be compiled."""
    _COMPILATION.expected |= _FUNCTIONS


def _noted(function: Any) -> Any:
    _FUNCTIONS.add(function)
    return function


def _cached(function: Function, **options: Any) -> Function:
    """Compile with numba's cache directed to the folder: numba chooses the place when it decorates a function."""
    with _DIRECTING:
        before = _CONFIG.CACHE_DIR
        _CONFIG.CACHE_DIR = str(CACHE_FOLDER or before)
        try:
            jit = numba.njit(cache=CACHE_FOLDER is not None, nogil=True, error_model="numpy", **options)
            return cast(Function, _noted(jit(function)))
        finally:
            _CONFIG.CACHE_DIR = before


def compiled(function: Function) -> Function:
    """Compile `function` at its first call, cached, without the interpreter's lock."""
    return _cached(function)


def compiled_reassociating(function: Function) -> Function:
    """As `compiled`; sums may be reordered and products fused, so that inner products are vectorised."""
    return _cached(function, fastmath={"contract", "reassoc"})


def inside(function: Function, **options: Any) -> Function:
    """As `compiled`, for what compiled functions alone call: without an entry from Python, which takes long to compile.

    Its machine code is kept in that of its callers. To call it from Python would end the process.
    """
    without_entry: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    jit: Any = numba.njit(nogil=True, error_model="numpy", **without_entry, **options)
    return cast(Function, _noted(jit(function)))


def inner(function: Function, **options: Any) -> Function:
    """As `inside`, and inlined into its callers: for the innermost loops."""
    return inside(function, forceinline=True, **options)


def interpreted(function: Function, made: dict[Any, Any] | None = None) -> Function:
    """Return a function, and what it calls by name, as Python runs it: the same bits, for little work, uncompiled.

    Not for functions that reassociate, divide by zero, or call as an attribute of a module.
    """
    made = {} if made is None else made
    source = cast(Any, getattr(function, "py_func", function))
    if source not in made:
        names = dict(source.__globals__)
        made[source] = FunctionType(source.__code__, names, source.__name__, source.__defaults__, source.__closure__)
        for name in source.__code__.co_names:
            if hasattr(names.get(name), "py_func"):
                names[name] = interpreted(names[name], made)
    return cast(Function, made[source])


def compile_ahead(function: Callable[..., Any], *arguments: Any) -> None:
    """Compile `function` for arguments like these in this thread: threads of a pool that compile end only when done."""
    dispatcher = cast(Any, function)
    dispatcher.compile(tuple(dispatcher.typeof_pyval(each) for each in arguments))


@numba.extending.intrinsic
def _pointers(_typing_context: Any, tables: Any) -> Any:
    """Return the named tuple with the addresses of its contiguous arrays' first elements, to be indexed flat.

    Passing arrays costs inner loops two thirds of their time, all of it atomic reference counting. A pointer has no
    length and no owner: the caller keeps the arrays alive.
    """
    types: Any = numba.types
    unpacked: Any = cgutils.unpack_tuple
    arrays = [t for t in tables.types if isinstance(t, types.Array)]
    kinds = [types.CPointer(t.dtype) if t in arrays else t for t in tables.types]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        members = zip(tables.types, unpacked(builder, args[0]), strict=True)
        values = [context.make_array(t)(context, builder, v).data if t in arrays else v for t, v in members]
        return context.make_tuple(builder, signature.return_type, values)

    return types.NamedTuple(kinds, tables.instance_class)(tables), codegen


def _views(tables: Any) -> Any:
    """Return the named tuple with flat views of its arrays, for `interpreted`: their elements are Python's numbers."""
    return tables._make(each.reshape(-1).data if isinstance(each, np.ndarray) else each for each in tables)


pointers: Any = _pointers
pointers.py_func = _views
