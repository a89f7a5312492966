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


def test_workflows_call_targets_of_make() -> None:
    """Each workflow is YAML with steps, and each `make` in it names targets that exist."""
    yaml = pytest.importorskip("yaml")
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    files = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
    jobs = [job for file in files for job in yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"].values()]
    steps = [step.get("run", "") for job in jobs for step in job["steps"]]
    called = {word for step in steps if step.startswith("make ") for word in step.split()[1:] if "=" not in word}
    assert {"test", "demo", "docs", "wheel", "bundle", "sbom"} <= called <= targets


def test_addresses_of_the_project_have_one_source() -> None:
    """The placeholders are in `[project.urls]` alone, and CONTRIBUTING names what is to be set before a release."""
    pages = [ROOT / name for name in ("README.md", "SECURITY.md", "CITATION.cff", "CHANGELOG.md")]
    pages += [*(ROOT / "docs").rglob("*.md"), *(ROOT / "boat_daq").rglob("*.py")]
    holding = [str(path.relative_to(ROOT)) for path in pages if "https://example.org" in path.read_text("utf-8")]
    assert holding == []
    assert "[project.urls]" in TEXT


def test_the_methods_have_10_000_words_together() -> None:
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "analysis").rglob("METHODS.md")]
    assert (len(texts), sum(len(text.split()) for text in texts) <= 10_000) == (4, True)
