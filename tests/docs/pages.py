"""The blocks of the pages of the documentation, as one shell script a page.

Blocks marked `sh` are run in their order. A block marked `python NAME` or `toml NAME` is written to NAME; Python is run
unless a later `sh` block runs it. What a reader has and a test lacks is replaced: the board by a virtual one, the
camera by its camera, libraries by those in `tests/docs/stand_ins`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(?P<kind>sh|(?:python|toml) (?P<name>\S+))\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
PORT, CAMERA, VIRTUAL_PORT, MJPEG = "/dev/ttyACM0", "source = 0 ", "./virtual-port", 8479
BOARD = f"boat-daq board --pty --link {VIRTUAL_PORT} --unit SA1"
PREPARED = {  # files that the reader of a page has
    "docs/how-to/camera.md": f"""{sys.executable} -m tests.docs.lens_pictures
ln -s run.mkv phone.mp4""",
}


def markdown() -> list[Path]:
    """Return every Markdown file of the repository, relative to its root."""
    folders = ("analysis", "docs", "protocol", "recordings")
    files = [*ROOT.glob("*.md"), *(path for folder in folders for path in (ROOT / folder).rglob("*.md"))]
    return sorted(path.relative_to(ROOT) for path in files)


def runnable() -> list[Path]:
    """Return the pages that have something to run."""
    return [page for page in markdown() if page.parts[0] == "docs" and BLOCK.search((ROOT / page).read_text("utf-8"))]


def block(page: str, name: str) -> str:
    """Return the block of a page that is written to `name`."""
    return next(found["body"] for found in BLOCK.finditer((ROOT / page).read_text("utf-8")) if found["name"] == name)


def script(text: str, page: str = "") -> str:
    """Return the shell script of a page's text; it stops at the first failure and ends what it left running."""
    start = ["set -eu -o pipefail", "trap 'kill $(jobs -p) 2>/dev/null || true' EXIT", PREPARED.get(page, "")]
    commands = "\n".join(_commands(text))
    if PORT in commands:
        camera = CAMERA in commands
        speed = f"--speed 1 --mjpeg {MJPEG}" if camera else "--speed 20"
        start.append(f"{BOARD} {speed} &\nuntil test -e {VIRTUAL_PORT}; do sleep 0.2; done")
        commands = commands.replace(PORT, VIRTUAL_PORT).replace(CAMERA, f'source = "http://127.0.0.1:{MJPEG}/" ')
    return "\n".join([*start, commands])


def _commands(text: str) -> Iterator[str]:
    blocks = list(BLOCK.finditer(text))
    for number, block in enumerate(blocks):
        name = block["name"]
        if name is None:
            yield block["body"]
            continue
        yield f"mkdir -p {Path(name).parent}\ncat > {name} <<'END_OF_FILE'\n{block['body']}END_OF_FILE"
        if name.endswith(".toml"):
            yield f'python -c "import tomllib; tomllib.load(open({name!r}, {"rb"!r}))"'
        elif not any(name in later["body"] for later in blocks[number + 1 :]):
            yield f"python {name}"
