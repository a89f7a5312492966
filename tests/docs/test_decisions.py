"""Each decision has a record of one form, and a line in the index."""

from __future__ import annotations

import re

from tests.docs.pages import ROOT

FOLDER = ROOT / "docs" / "decisions"
FORM = re.compile(
    r"# (?P<number>\d{4})\. (?P<title>.+)\n\n- Date: (?P<date>\d{4}-\d\d-\d\d)\n"
    r"- Status: (?P<status>accepted|superseded by \d{4})\n\n"
    r"## Context\n\n.+\n\n## Decision\n\n.+\n\n## Consequences\n\n.+\n",
    re.DOTALL,
)


def test_every_record_has_the_form_and_a_line_in_the_index() -> None:
    expected = []
    for path in sorted(FOLDER.glob("[0-9]*.md")):
        record = FORM.fullmatch(path.read_text(encoding="utf-8"))
        assert record and path.name.startswith(record["number"]), path.name
        expected.append(
            f"| {record['number']} | [{record['title']}]({path.name}) | {record['date']} | {record['status']} |"
        )
    index = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert sorted(line for line in index.splitlines() if re.match(r"\| \d", line)) == expected


def test_numbers_are_unique() -> None:
    """Records may be deleted: their numbers stay unused."""
    numbers = [path.name[:4] for path in FOLDER.glob("[0-9]*.md")]
    assert len(numbers) == len(set(numbers)) > 0
