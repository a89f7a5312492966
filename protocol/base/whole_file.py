"""Write files so that a reader finds the old content or the new, never a part of it.

Strategy: each writer writes a temporary file of its own beside the target, flushes it to the disk and renames it; then
the folder is flushed, so that the new name survives a power cut.
"""

from __future__ import annotations

import errno
import itertools
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_SUFFIX = ".part"
STEM_BYTES = 220
_number = itertools.count(1)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary name that becomes `path` on success, else is removed. OSError: `path` cannot be written.

    A symbolic link stays one, and a file keeps its permissions. A pipe or a device is written to directly.
    """
    path = Path(os.path.realpath(path))
    replaced = path.exists()
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if replaced and not path.is_file():
        yield path
        return
    if replaced and not os.access(path, os.W_OK):  # a name can be exchanged that may not be written
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    part = path.with_name(f"{_stem(path)}.{os.getpid()}-{next(_number)}{_SUFFIX}")
    try:
        yield part
        if replaced:
            shutil.copymode(path, part)
        _flush(part)
        part.replace(path)
        _flush_folder(path.parent)
    finally:
        with suppress(OSError):  # a folder that is none
            part.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file whole; text as UTF-8 with its line ends as they are. OSError: as `written_whole`."""
    data = content.encode("utf-8", errors="replace") if isinstance(content, str) else content
    with written_whole(path) as part:
        part.write_bytes(data)


def remove_unfinished(path: Path) -> None:
    """Remove what writers of `path` left beside it that were ended while they wrote."""
    path = Path(os.path.realpath(path))
    with suppress(OSError):  # a folder that is none, or is not to be written
        for part in path.parent.iterdir():
            if part.name.startswith(f"{_stem(path)}.") and part.suffix == _SUFFIX:
                part.unlink(missing_ok=True)


def _stem(path: Path) -> str:
    """Return the name of a file, cut where the longest name that a file system takes leaves no space for an ending."""
    return path.name.encode("utf-8", "surrogateescape")[:STEM_BYTES].decode("utf-8", "ignore")


def _flush(path: Path) -> None:
    """Have the content of a file on the disk."""
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Have the new names on the disk; systems that cannot flush a folder do it by themselves."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
