"""Turn this project's compact docstrings into what napoleon reads.

Types are annotations here, so a parameter is documented as `name : meaning, unit` on one line. NumPy's form expects a
type behind the colon: the meaning is moved to a line of its own. What is returned is a sentence, without a type. An
indented block behind a blank line is code. A bar is the sign of an absolute value, not of a substitution.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_SECTIONS = ("Parameters", "Attributes", "Raises", "Yields", "Warns")
_RESULT = re.compile(r"^(?P<head>(?:Returns|Yields)\n-+\n)(?P<text>(?:\S.*\n)+)(?=\n|\Z)", re.MULTILINE)
_BAR = re.compile(r"(`[^`]*`)|\|")
_ENTRY = re.compile(r"(?P<names>[\w.*]+(?:, [\w.*]+)*) : (?P<meaning>.+)")


def _without_types(text: str) -> str:
    """Return a docstring whose sections Returns and Yields have one entry, with a sentence and without a type."""
    return _RESULT.sub(
        lambda found: found["head"] + ":\n    " + found["text"].replace("\n", "\n    ").rstrip(" "), text
    )


def rewrite(lines: list[str], *, is_property: bool = False) -> list[str]:
    """Return the lines of a docstring with its entries in NumPy's form and its examples as literal blocks."""
    out: list[str] = []
    section, literal = "", False
    names: list[str] = []  # of the entry whose meaning is being read
    meaning: list[str] = []
    lines = _without_types("\n".join([*lines, ""])).splitlines()
    for number, line in enumerate([*lines, "."]):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if names and not line.startswith("    "):
            out += [text for name in names for text in (name, *meaning)]
            names = []
        if names:
            meaning.append(line)
            continue
        if following and set(following) == {"-"} and len(following) >= len(line):
            section = line
        entry = _ENTRY.fullmatch(line)
        if entry and section in _SECTIONS:
            names, meaning = entry["names"].split(", "), ["    " + entry["meaning"]]
            continue
        if line.startswith("    ") and not literal and not section and out and not out[-1]:
            out += ["::", ""]
            literal = True
        elif line and not line.startswith(" "):
            literal = False
        if is_property and number == 0:  # napoleon takes what stands before a colon for the type
            line = line.replace(": ", " \N{EN DASH} ", 1)
        out.append(line if literal else _BAR.sub(lambda found: found[1] or r"\|", line))
    return out[:-1]


def _process(_app: Sphinx, what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = rewrite(lines, is_property=what == "property")


def setup(application: Sphinx) -> dict[str, Any]:
    """Run before napoleon, whose own hook has the default priority of 500."""
    application.connect("autodoc-process-docstring", _process, priority=400)
    return {"parallel_read_safe": True}
