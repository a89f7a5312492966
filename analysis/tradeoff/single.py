"""The tracer in single precision, made from its own source: for comparison of speed and error, not for results.

Strategy: the modules of the compiled part are parsed, every floating-point constant in them (and `math.inf`) becomes
a float32, and they are compiled anew under other names. With tables, rules and rays in float32 no operation is left
that would widen to float64; sums over many rays (energies) stay in float64, as in any sensible single-precision tracer.
"""

from __future__ import annotations

import ast
import sys
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numba
import numpy as np

_PARTS = ("budget", "nearest", "tracer")
_PACKAGE = "analysis.optics"


class _Narrow(ast.NodeTransformer):
    """float constants -> float32; imports of the other parts -> their twins; nothing cached under the same name."""

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return _single(node) if isinstance(node.value, float) else node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        self.generic_visit(node)
        infinite = isinstance(node.value, ast.Name) and node.value.id == "math" and node.attr == "inf"
        return _single(node) if infinite else node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> list[ast.stmt]:
        room, _, name = (node.module or "").rpartition(".")
        if room == _PACKAGE and name in _PARTS:
            node.module = _twin(name)
        if room == _PACKAGE and name == "compiled":
            return [node, ast.ImportFrom(__name__, [ast.alias("uncached", "compiled")], 0)]
        return [node]


def _single(node: ast.expr) -> ast.Call:
    return ast.Call(ast.Name("_float32", ast.Load()), [node], [])


def _twin(name: str) -> str:
    return f"{_PACKAGE}.single_{name}"


def uncached(function: Any) -> Any:
    """What `compiled` is to the twins: the cache goes by file and line, which they share with their originals."""
    return numba.njit(nogil=True, error_model="numpy")(function)


@cache
def twins() -> tuple[ModuleType, ...]:
    """Budget, nearest and tracer with every float constant a float32; compiled when they are first called."""
    return tuple(_load(name) for name in _PARTS)


class _Loader(SourceFileLoader):
    """Loads a part's source, narrowed; nothing of it is kept beside the original's bytecode."""

    def get_code(self, fullname: str) -> CodeType:
        tree = _Narrow().visit(ast.parse(Path(self.path).read_text(encoding="utf-8")))
        return compile(ast.fix_missing_locations(tree), self.path, "exec")


def _load(name: str) -> ModuleType:
    spec = spec_from_loader(_twin(name), _Loader(_twin(name), str(Path(__file__).with_name(f"{name}.py"))))
    assert spec is not None
    module = sys.modules[spec.name] = module_from_spec(spec)
    module.__dict__["_float32"] = np.float32
    assert spec.loader is not None
    spec.loader.exec_module(module)
    return module
