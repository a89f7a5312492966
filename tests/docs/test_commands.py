"""Every command and option that the documents name exists."""

from __future__ import annotations

import re
from collections.abc import Iterator

import typer.main

from boat_daq.cli import app
from tests.docs.pages import ROOT, markdown

GROUP = typer.main.get_command(app)
CODE = re.compile(r"^```[^\n]*\n(.*?)^```$|`([^`\n]+)`", re.MULTILINE | re.DOTALL)
HISTORY = "CHANGELOG.md"  # names options of earlier versions


def calls(text: str) -> Iterator[list[str]]:
    """Yield the words of each command line in the code of a page, from the name of the command on."""
    names = "|".join(getattr(GROUP, "commands"))  # noqa: B009 - typer's own kind of group
    for block, inline in CODE.findall(text):
        code = (block or inline).replace("\\\n", " ")
        found = re.findall(rf"boat-daq ((?:{names})\b[^\n|&;#]*)", code)
        found += re.findall(rf"^((?:{names}) [^\n|]*--[^\n|]*)", inline)
        yield from (call.split() for call in found)


def unknown(words: list[str]) -> list[str]:
    """Return the options of a command line that its command does not have."""
    command = GROUP
    while words and words[0] in getattr(command, "commands", {}):
        command = command.commands[words.pop(0)]  # type: ignore[attr-defined]
    known = {"--help", "--json"} | {option for parameter in command.params for option in parameter.opts}
    if getattr(command, "commands", None):  # several of a group, such as `twin accept|identify`
        return []
    return [word for word in re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", " ".join(words)) if word not in known]


def test_every_option_that_is_named_exists() -> None:
    gone = [
        (str(page), *call[:2], option)
        for page in markdown()
        if str(page) != HISTORY and page.parts[:2] != ("docs", "decisions")
        for call in calls((ROOT / page).read_text(encoding="utf-8"))
        for option in unknown(list(call))
    ]
    assert gone == []


def test_an_option_that_is_gone_is_noticed() -> None:
    found = list(calls("Use `analyze --gone 2` or\n```sh\nboat-daq optics trace --rays 250 \\\n    --lost\n```\n"))
    assert [unknown(words) for words in found] == [["--gone"], ["--lost"]]
