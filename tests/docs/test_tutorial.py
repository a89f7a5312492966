"""The labels that the tutorial names in bold are labels of the window."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from tests.docs.pages import ROOT


def strings(folder: Path) -> set[str]:
    """Return every string of the sources of a folder."""
    nodes = (node for path in folder.rglob("*.py") for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    return {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def test_every_label_in_bold_is_in_the_window() -> None:
    page = (ROOT / "docs" / "tutorial" / "first-calibration.md").read_text(encoding="utf-8")
    labels = set(re.findall(r"\*\*(.+?)\*\*", page))
    assert len(labels) > 8
    assert labels <= strings(ROOT / "boat_daq" / "gui") | strings(ROOT / "boat_daq" / "viewmodels")
