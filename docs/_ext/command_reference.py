"""Directive `commands`: a section for each command of boat-daq, holding what its own `--help` prints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer
import typer.main
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from boat_daq.cli import app

WIDTH = 88


def commands() -> Iterator[tuple[str, str]]:
    """Yield each command's full name and its help text, groups before their members."""

    def walk(command: Any, name: str, parent: Any) -> Iterator[tuple[str, str]]:
        context = command.make_context(name.split()[-1], ["--help"], parent=parent, resilient_parsing=True)
        context.terminal_width = context.max_content_width = WIDTH
        yield name, command.get_help(context)
        for member in getattr(command, "commands", {}).values():
            yield from walk(member, f"{name} {member.name}", context)

    yield from walk(typer.main.get_command(app), "boat-daq", None)


class Commands(SphinxDirective):
    """Sections of all commands, in the order of the command line."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        sections: list[nodes.Node] = []
        for name, text in commands():
            section = nodes.section(ids=[nodes.make_id(name)], names=[nodes.fully_normalize_name(name)])
            section += nodes.title("", "", nodes.literal("", name))
            section += nodes.literal_block("", text, language="text")
            self.state.document.note_explicit_target(section, section)
            sections.append(section)
        return sections


def setup(application: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    application.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
