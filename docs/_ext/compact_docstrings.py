"""Turn this project's compact docstrings into what napoleon reads.

Types are annotations here, so a parameter is documented as `name : meaning, unit` on one line. NumPy's form expects a
type behind the colon: the meaning is moved to a line of its own. An indented block behind a blank line is code.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_SECTIONS = ("Parameters", "Attributes", "Raises", "Yields", "Warns")
_ENTRY = re.compile(r"(?P<names>[\w.*]+(?:, [\w.*]+)*) : (?P<meaning>.+)")


def rewrite(lines: list[str]) -> list[str]:
    """Return the lines of a docstring with its entries in NumPy's form and its examples as literal blocks."""
    out: list[str] = []
    section, literal = "", False
    for number, line in enumerate(lines):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if following and set(following) == {"-"} and len(following) >= len(line):
            section = line
        entry = _ENTRY.fullmatch(line)
        if entry and section in _SECTIONS:
            out += [entry["names"], "    " + entry["meaning"]]
            continue
        if line.startswith("    ") and not literal and not section and out and not out[-1]:
            out += ["::", ""]
            literal = True
        elif line and not line.startswith(" "):
            literal = False
        out.append(line)
    return out


def _process(_app: Sphinx, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = rewrite(lines)


def setup(application: Sphinx) -> dict[str, Any]:
    """Run before napoleon, whose own hook has the default priority of 500."""
    application.connect("autodoc-process-docstring", _process, priority=400)
    return {"parallel_read_safe": True}
