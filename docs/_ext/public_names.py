"""A page of the reference for each name of `boat_daq`: its documentation and `docs/reference/examples/NAME.py`."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import boat_daq


def page(name: str) -> str:
    """Return the page of a name."""
    found = getattr(boat_daq, name)
    directive = "autoclass" if inspect.isclass(found) else "autofunction"
    options = "\n   :members:" if inspect.isclass(found) else ""
    example = f"```{{literalinclude}} ../examples/{name}.py\n:language: python\n```"
    return f"# {name}\n\n{example}\n\n```{{eval-rst}}\n.. {directive}:: boat_daq.{name}{options}\n```\n"


def write_pages(application: Sphinx) -> None:
    """Write the pages; one that is as it was keeps its time, so that it is not read again."""
    folder = Path(application.confdir) / "reference" / "api"
    folder.mkdir(exist_ok=True)
    for name in boat_daq.__all__:
        path, text = folder / f"{name}.md", page(name)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(application: Sphinx) -> dict[str, Any]:
    """Register the writer of the pages."""
    application.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
