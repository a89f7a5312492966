"""No sentence of the window names a command of the terminal: those are in `command`, which only the terminal shows."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
NAMES = (
    "analyze|atlas|board|bugreport|export|fit|import|info|ports|record|recover|report|shadow|tradeoff|upgrade|verify"
)
COMMAND = re.compile(rf"boat-daq (?:{NAMES})\b|(?<![\w-])--[a-z]{{3,}}")
TERMINAL_ONLY = {  # modules whose errors and texts the window never shows
    "analysis/data/column_map.py": "the window maps columns in its panel, from a preview that refuses none",
    "analysis/data/csv_import.py": "the window maps columns in its panel, from a preview that refuses none",
    "analysis/data/boat_writer.py": "verifying an import",
    "analysis/data/load.py": "options for a CSV",
    "analysis/data/export.py": "a format by name",
    "analysis/shadow/model/states.py": "head of a file",
    "analysis/optics/sweep/report.py": "the text that the command prints",
    "protocol/base/optional.py": "an extra is installed in a terminal, wherever it is missed",
    "boat_daq/engine/screen.py": "shown where no window opens",
    "boat_daq/engine/qualification/drill_rig.py": "arguments of a process",
    "boat_daq/engine/simulator/server.py": "the command board",
}


def sentences(path: Path):
    """Give the texts of a module but docstrings and those given as `command`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    left_out = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == "command":
            left_out |= {id(part) for part in ast.walk(node.value)}
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in left_out:
            yield node.value


def test_no_sentence_names_a_command():
    """Whoever reads it in the window has no terminal; an error keeps its command beside the remedy."""
    folders = ("protocol", "analysis", "boat_daq/engine", "boat_daq/viewmodels", "boat_daq/gui")
    named = {}
    for path in (file for folder in folders for file in (ROOT / folder).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if name not in TERMINAL_ONLY and COMMAND.search(path.read_text(encoding="utf-8")):
            named |= {f"{name}: {text}": 1 for text in sentences(path) if COMMAND.search(text)}
    assert not named
