"""The commands of the pages of the documentation, as one shell script a page.

Blocks marked `sh` are run in their order. A block marked `python NAME` is written to NAME, and run unless a later `sh`
block runs it. All other blocks are not executed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(?P<kind>sh|python (?P<name>\S+))\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)


def markdown() -> list[Path]:
    """Return every Markdown file of the repository, relative to its root."""
    folders = ("analysis", "docs", "protocol", "recordings")
    files = [*ROOT.glob("*.md"), *(path for folder in folders for path in (ROOT / folder).rglob("*.md"))]
    return sorted(path.relative_to(ROOT) for path in files)


def runnable() -> list[Path]:
    """Return the pages that have something to run."""
    return [page for page in markdown() if page.parts[0] == "docs" and BLOCK.search((ROOT / page).read_text("utf-8"))]


def script(text: str) -> str:
    """Return the shell script of a page's text; it stops at the first failure and ends what it left running."""
    return "\n".join(["set -eu -o pipefail", "trap 'kill $(jobs -p) 2>/dev/null || true' EXIT", *_commands(text)])


def _commands(text: str) -> Iterator[str]:
    blocks = list(BLOCK.finditer(text))
    for number, block in enumerate(blocks):
        name = block["name"]
        if name is None:
            yield block["body"]
            continue
        yield f"mkdir -p {Path(name).parent}\ncat > {name} <<'END_OF_FILE'\n{block['body']}END_OF_FILE"
        if not any(name in later["body"] for later in blocks[number + 1 :]):
            yield f"python {name}"
