"""The program with every sentence of its own scrambled: what it does may not depend on how a message is worded.

Strategy: an import hook compiles the three packages with each sentence in their sources replaced by letters of the same
length, by another key in every place, so that two places that spell a sentence alike no longer do. Codes, names, keys
and the words of file formats are single words or are in `FORMATS`, and stay. The journeys then end in codes and
numbers, which `test_scrambled_text.py` compares with those of the program as it is.
"""

from __future__ import annotations

import ast
import importlib.abc
import importlib.machinery
import re
import sys
import zlib
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, SourceFileLoader
from types import CodeType, ModuleType

PACKAGES = ("boat_daq", "protocol", "analysis")
FORMATS = (  # modules whose sentences are the words of a file format
    "analysis.data.csv_", "analysis.shadow.fem.mesh_files", "analysis.shadow.fem.mesh_files", "analysis.optics.outline",
    "protocol.recording",
)  # fmt: skip
SENTENCE = re.compile(r"[A-Za-z]{2,}[,;:]? +[A-Za-z(]")
CODE = re.compile(r"[<>{}\\=]|%[a-zA-Z]|\b(SELECT|INSERT|CREATE|PRAGMA|UPDATE|DELETE|BEGIN|ORDER BY|VALUES)\b")
MATPLOTLIB = ("loc", "xycoords", "textcoords")  # arguments whose values are codes, some of two words
WORD = re.compile(r"[A-Za-z]+")


class Scrambler(ast.NodeTransformer):
    """Replaces the sentences of one module; `count` of them."""

    def __init__(self, module: str) -> None:
        self.module, self.count = module, 0

    def scrambled(self, text: str, node: ast.AST) -> str:
        """Return `text` with the letters of every word moved on, by a key of its place."""
        key = 1 + zlib.crc32(f"{self.module}:{node.lineno}:{node.col_offset}".encode()) % 25  # type: ignore[attr-defined]
        self.count += 1

        def moved(match: re.Match[str]) -> str:
            return "".join(chr((ord(c) - b + key) % 26 + b) for c in match[0] for b in [65 if c.isupper() else 97])

        return WORD.sub(moved, text)

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """Leave docstrings."""
        return node if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_keyword(self, node: ast.keyword) -> ast.AST:
        """Leave matplotlib's codes of two words."""
        return node if node.arg in MATPLOTLIB else self.generic_visit(node)

    def visit_Dict(self, node: ast.Dict) -> ast.AST:
        """Leave them in a dict of matplotlib's arguments too."""
        for i, (key, value) in enumerate(zip(node.keys, node.values, strict=True)):
            if not (isinstance(key, ast.Constant) and key.value in MATPLOTLIB):
                node.values[i] = self.visit(value)
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Scramble a sentence."""
        if isinstance(node.value, str) and SENTENCE.search(node.value) and not CODE.search(node.value):
            return ast.copy_location(ast.Constant(self.scrambled(node.value, node)), node)
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        """Scramble the fixed parts of an f-string that is a sentence."""
        fixed = [part for part in node.values if isinstance(part, ast.Constant)]
        whole = " x ".join(str(part.value) for part in fixed)
        if SENTENCE.search(whole) and not CODE.search(whole):
            for part in fixed:
                part.value = self.scrambled(str(part.value), part)
        return node


class ScrambledLoader(SourceFileLoader):
    """Loads a module with its sentences scrambled; nothing of it is cached."""

    total = 0

    def get_code(self, fullname: str) -> CodeType:
        """Return the module's code."""
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path), path)
        scrambler = Scrambler(fullname)
        if not fullname.startswith(FORMATS):
            tree = ast.fix_missing_locations(scrambler.visit(tree))
        ScrambledLoader.total += scrambler.count
        return compile(tree, path, "exec", dont_inherit=True)


class ScrambledFinder(importlib.abc.MetaPathFinder):
    """Finds the modules of the three packages for `ScrambledLoader`."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the usual spec with another loader."""
        if fullname.split(".")[0] not in PACKAGES:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = ScrambledLoader(fullname, spec.loader.path)
        return spec


def install() -> None:
    """Scramble every module of the program that is imported from now on."""
    if loaded := [name for name in sys.modules if name.split(".")[0] in PACKAGES]:
        raise RuntimeError(f"imported before the hook: {loaded}")
    sys.meta_path.insert(0, ScrambledFinder())
