"""Directive `values MODULE:CLASS`: a table of the values that a dataclass describes, as forms and commands use them."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from boat_daq.engine.described import described, text_of

HEADINGS = ("key", "meaning", "range", "default", "a new value applies")


def rows(name: str) -> Iterator[tuple[str, ...]]:
    """Yield the cells of each described value of the dataclass `MODULE:CLASS`."""
    module, _, cls = name.partition(":")
    for key, about in described(getattr(import_module(module), cls)).items():
        default = f"`{text_of(about.default)}`" if about.default != "" else "empty"
        yield f"`{key}`", about.meaning, about.range_text or "text", default, str(about.applies)


class Values(SphinxDirective):
    """A table of values."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        lines = [".. list-table::", "   :header-rows: 1", ""]
        for cells in (HEADINGS, *rows(self.arguments[0])):
            lines += [f"   {'  -' if i else '* -'} {cell}" for i, cell in enumerate(cells)]
        found = nodes.container()
        self.state.nested_parse(StringList(lines, source=self.arguments[0]), 0, found)
        return list(found.children)


def setup(application: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    application.add_directive("values", Values)
    return {"parallel_read_safe": True}
