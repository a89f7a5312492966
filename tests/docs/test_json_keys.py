"""The keys of the reference are the keys that the commands print."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from boat_daq.cli import app
from tests.docs.pages import ROOT

PAGE = (ROOT / "docs" / "reference" / "json.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"


def documented(command: str) -> set[str]:
    """Return the dotted names of the keys under a command's heading; lists are left out of the names."""
    found = re.search(rf"^## `{re.escape(command)}`$.*?```text\n(.*?)```", PAGE, re.MULTILINE | re.DOTALL)
    assert found, command
    names: set[str] = set()
    path: list[str] = []
    name = ""
    for token in re.findall(r"[{}\[\],]|[^{}\[\],]+", found[1]):
        if token == "{":
            path.append(name)
        elif token == "}":
            path.pop()
        elif token.strip() and token not in "[],":
            name = " ".join(token.split())
            names.add(".".join([*path, name]).lstrip("."))
    return names


def printed(value: Any, path: str = "") -> Iterator[str]:
    """Yield the dotted names of the keys of a command's object."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield f"{path}{key}"
            yield from printed(inner, f"{path}{key}.")
    elif isinstance(value, list):
        for inner in value:
            yield from printed(inner, path)
        if not value:
            yield f"{path}*"  # an empty list has no objects whose keys could be seen


CASES = [
    ("info RUN", ["info", "RUN"]),
    ("strokes RUN", ["strokes", "RUN"]),
    ("fit FILE.csv --x COL --y COL --bands", ["fit", "TABLE", "--x", "x", "--y", "y", "--bands"]),
    ("metadata RUN", ["metadata", "RUN"]),
    ("profile FILE", ["profile", "TABLE"]),
    ("config get", ["config", "get"]),
    pytest.param("certificate RUN --out FILE", ["certificate", "RUN", "--out", "FILE"], marks=pytest.mark.nightly),
    pytest.param("analyze RUN", ["analyze", "RUN", "--no-store"], marks=pytest.mark.nightly),
    pytest.param("verify RUN", ["verify", "RUN"], marks=pytest.mark.nightly),
    pytest.param("optics trace", ["optics", "trace"], marks=pytest.mark.nightly),
    pytest.param("shadow solve --pressure KPA", ["shadow", "solve", "--pressure", "20"], marks=pytest.mark.nightly),
    pytest.param("shadow replay RUN", ["shadow", "replay", "RUN"], marks=pytest.mark.nightly),
]


@pytest.mark.parametrize(("heading", "call"), CASES)
def test_every_promised_key_is_printed(heading: str, call: list[str], tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("x,y\n-2,1549\n-1,1603\n0,1652\n1,1695\n2,1731\n3,1757\n", encoding="utf-8")
    files = {"RUN": str(EXAMPLE), "TABLE": str(table), "FILE": str(tmp_path / "c.xml")}
    done = CliRunner().invoke(app, [*(files.get(word, word) for word in call), "--json"])
    assert done.exit_code == 0, done.output
    names = set(printed(json.loads(done.stdout)))
    missing = {name for name in documented(heading) if not any(_same(name, other) for other in names)}
    assert not missing


def _same(entry: str, name: str) -> bool:
    """Whether a printed name matches a documented one; NAME matches any name."""
    wanted, found = entry.split("."), name.split(".")
    if found[-1] == "*":
        wanted, found = wanted[: len(found) - 1], found[:-1]
    return len(wanted) == len(found) and all(w in ("NAME", f) for w, f in zip(wanted, found, strict=True))
