"""Small files of the program's own: replaced whole or not at all, the one before kept as `.bak`.

A file that a disk destroyed (gone, empty, no text) is replaced by its backup, with a warning (`take_warnings`); one
that editing made unreadable is refused instead, because its backup would undo the edit, a tighter limit perhaps.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from boat_daq.engine.toml_values import TOML_MAX_BYTES, read_text
from protocol.base.errors import RequestError, StorageError
from protocol.base.regular_file import read_regular
from protocol.base.whole_file import write_whole, written_whole

T = TypeVar("T")

BACKUP = ".bak"

_warnings: list[tuple[str, str]] = []


def take_warnings() -> list[tuple[str, str]]:
    """Return cause and remedy for every backup used since the last call."""
    taken = _warnings.copy()
    _warnings.clear()
    return taken


def read_stored(path: Path) -> str | None:
    """Return the text of a stored file, or of its backup where a disk destroyed it. None where nothing was stored."""
    backup = path.with_name(path.name + BACKUP)
    if not is_destroyed(path) or not backup.exists():
        return read_text(path) if path.exists() else None
    text = read_text(backup)
    if "\0" in text or not text.strip():
        raise RequestError(f"{path} and its backup are destroyed", "write the file again; check the disk")
    warning = (f"{path} was destroyed; its backup is used", "check its contents, store it again, and check the disk")
    if warning not in _warnings:
        _warnings.append(warning)
    return text


def read_whole(path: Path, parse: Callable[[str], T]) -> T | None:
    """Return what is stored in a file; None where nothing is."""
    text = read_stored(path)
    if text is None:
        return None
    try:
        return parse(text)
    except RequestError as error:
        backup = path.with_name(path.name + BACKUP)
        if is_destroyed(path) or not _is_good(backup, parse):
            raise
        way_out = f"correct it, or restore its backup: copy {backup} over {path.name}"
        raise RequestError(error.cause, f"{error.remedy}; {way_out}" if error.remedy else way_out) from error


def _is_good(path: Path, parse: Callable[[str], object]) -> bool:
    try:
        parse(read_text(path))
    except RequestError:
        return False
    return True


def is_destroyed(path: Path) -> bool:
    """Whether a file is gone or holds what no editor leaves. Nothing at all, NUL bytes, or no UTF-8."""
    try:
        content = read_regular(path, TOML_MAX_BYTES)
        return not content.strip() or b"\0" in content or not content.decode("utf-8-sig").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        return True
    except OSError:
        return False  # present but unreadable or too large: `read_text` raises the reason


def write_stored(path: Path, text: str) -> None:
    """Replace a file at once, the one before kept as `.bak`. StorageError: the folder or the file cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not is_destroyed(path):  # else the backup is the better one
            with written_whole(path.with_name(path.name + BACKUP)) as kept:
                shutil.copy2(path, kept)
        write_whole(path, text)
    except OSError as error:
        raise StorageError(f"{path} cannot be written: {error.strerror}", "check the folder and the disk") from error
