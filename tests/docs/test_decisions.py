"""Each decision has a record of one form and length, and a line in the list."""

from __future__ import annotations

import re

from tests.docs.pages import ROOT

FOLDER = ROOT / "docs" / "decisions"
FORM = re.compile(
    r"# (?P<number>\d{4})\. (?P<title>.+)\n\n- Date: \d{4}-\d\d-\d\d\n- Status: (accepted|superseded by \d{4})\n\n"
    r"## Context\n\n.+\n\n## Decision\n\n.+\n\n## Consequences\n\n.+\n",
    re.DOTALL,
)
MOST_WORDS = 250


def test_every_record_has_the_form() -> None:
    names = [path.name for path in FOLDER.glob("0*.md")]
    assert len(names) > 40
    for path in sorted(FOLDER.glob("[0-9]*.md")):
        text = path.read_text(encoding="utf-8")
        record = FORM.fullmatch(text)
        assert record and path.name.startswith(record["number"]), path.name
        assert len(text.split()) <= MOST_WORDS, path.name


def test_every_number_that_is_named_has_a_record() -> None:
    """In the records themselves, in the documents and in the sources."""
    numbers = {path.name[:4] for path in FOLDER.glob("[0-9]*.md")}
    named = set()
    for folder in ("analysis", "boat_daq", "docs", "protocol", "tests"):
        for path in [*(ROOT / folder).rglob("*.py"), *(ROOT / folder).rglob("*.md")]:
            text = path.read_text(encoding="utf-8")
            named |= set(re.findall(r"decisions?[ /](\d{4})", text))
            if path.parent == FOLDER:
                named |= set(re.findall(r"\((\d{4})\)", text))
    assert named and named <= numbers
