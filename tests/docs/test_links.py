"""Relative links, images and named commands of the documents lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

from tests.docs.pages import ROOT, markdown

LINK = re.compile(r"\]\((?P<target>[^)\s]+)\)")
FILE = re.compile(r"`((?:\w+/)+\w+\.(?:py|toml|json|csv|md|c|h))`")
ANCHOR = re.compile(r"[^\w\- ]")


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {ANCHOR.sub("", heading.strip().lower()).replace(" ", "-") for heading in headings}


def targets(page: Path) -> list[str]:
    """Return the targets of a page's links and images that stay in the repository."""
    return [target for target in LINK.findall((ROOT / page).read_text(encoding="utf-8")) if "://" not in target]


def target_exists(page: Path, target: str) -> bool:
    """Whether file and heading of a link exist."""
    name, _, anchor = target.partition("#")
    file = (ROOT / page).parent / name if name else ROOT / page
    return file.exists() and (not anchor or anchor in anchors(file))


def test_every_relative_link_leads_to_a_file_and_heading() -> None:
    dead = [(str(page), target) for page in markdown() for target in targets(page) if not target_exists(page, target)]
    assert not dead


def test_every_file_of_ours_that_is_named_exists() -> None:
    gone = []
    for page in markdown():
        for name in FILE.findall((ROOT / page).read_text(encoding="utf-8")):
            beside = (ROOT / page).parent / name
            if not (name.startswith(("out/", "units/")) or beside.exists() or (ROOT / name).exists()):
                gone.append((str(page), name))
    assert not gone


def test_no_line_is_hidden_as_a_comment() -> None:
    """MyST takes a line that begins with a percent sign for a comment and leaves it out of the site."""
    hidden = [str(page) for page in markdown() if re.search(r"^%", (ROOT / page).read_text("utf-8"), re.MULTILINE)]
    assert not hidden
