"""The table "to add X, touch Y" names files and folders that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (.+?) \| (.+) \|$", TEXT, re.MULTILINE)[1:]
NAME = re.compile(r"`([\w./]+(?:\.(?:py|toml|md|json)|/))`")


def folder_of(name: str) -> Path:
    """Return the folder that a name with a path leads to or lies in."""
    return ROOT / name if name.endswith("/") else (ROOT / name).parent


def missing(row: str) -> list[str]:
    """Return the names in a row that do not exist; a bare one must lie beside another name of its row."""
    names = NAME.findall(row)
    paths = [name for name in names if "/" in name or (ROOT / name).exists()]
    folders = [folder_of(name) for name in paths]
    bare = [name for name in names if name not in paths and not any((folder / name).exists() for folder in folders)]
    return bare + [name for name in paths if not (ROOT / name).exists()]


@pytest.mark.parametrize("row", [pytest.param(f"{what} {where}", id=what) for what, where in ROWS])
def test_every_named_file_and_folder_exists(row: str) -> None:
    assert missing(row) == []


def test_a_file_that_is_gone_is_noticed() -> None:
    assert len(ROWS) > 20
    assert missing("`protocol/simulator/faults.py`, `channel.py`, `gone/`, `board.py`") == ["channel.py", "gone/"]


def test_every_named_file_in_the_rules_exists() -> None:
    rules = TEXT.partition("## Rules")[2]
    assert [name for name in NAME.findall(rules) if not (ROOT / name).exists()] == []
