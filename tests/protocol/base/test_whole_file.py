"""Files that are replaced whole, or left as they were."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import pytest

from protocol.base.whole_file import remove_unfinished, write_whole, written_whole

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and permissions of POSIX")


def test_content_is_written_as_given(tmp_path: Path) -> None:
    """Text keeps its ends of lines, bytes are bytes, and nothing is left beside the file."""
    write_whole(tmp_path / "a.csv", "x,y\r\n1,2\n")
    write_whole(tmp_path / "b.pdf", b"\x00\xff")
    assert (tmp_path / "a.csv").read_bytes() == b"x,y\r\n1,2\n"
    assert (tmp_path / "b.pdf").read_bytes() == b"\x00\xff"
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", "b.pdf"}


def test_failure_leaves_the_file_before(tmp_path: Path) -> None:
    """Whatever stops the writer: the old content, and no part of the new."""
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), written_whole(path) as part:
        part.write_text("ne")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_content_is_on_the_disk_before_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file is flushed, then renamed, then its folder is flushed: a power cut never finds a name without content."""
    steps: list[str] = []

    def fsync(descriptor: int) -> None:
        steps.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file")

    def replace(part: Path, path: Path) -> None:
        steps.append("name")
        os.replace(part, path)  # noqa: PTH105 - Path.replace is what is watched

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    write_whole(tmp_path / "a.txt", "new")
    assert steps == ["file", "name", *(["folder"] if sys.platform != "win32" else [])]


def test_two_writers_do_not_mix(tmp_path: Path) -> None:
    """Two that write the same file at the same time: the last one to end has it, whole."""
    path = tmp_path / "a.txt"
    with written_whole(path) as first:
        first.write_text("1" * 1000)
        with written_whole(path) as second:
            second.write_text("2")
    assert path.read_text() == "1" * 1000
    assert list(tmp_path.iterdir()) == [path]


@POSIX
def test_link_and_permissions_remain(tmp_path: Path) -> None:
    """A symbolic link leads to the new content, with the permissions of the file before."""
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old")
    path.chmod(0o600)
    link.symlink_to(path)
    write_whole(link, "new")
    assert link.is_symlink()
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ("new", 0o600)


@POSIX
def test_protected_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A write-protected file is not replaced, though its folder would allow it; nor is a folder."""
    path = tmp_path / "a.txt"
    path.write_text("old")
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anything
    with pytest.raises(PermissionError):
        write_whole(path, "new")
    assert path.read_text() == "old"
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path, "new")


@POSIX
def test_device_is_written_to(tmp_path: Path) -> None:
    """What is no file, such as standard output, is not replaced by one."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_whole(pipe, "new")
    assert os.read(reader, 10) == b"new"
    os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_longest_name_is_written(tmp_path: Path) -> None:
    """A name as long as the file system takes leaves space for the ending of the file beside."""
    path = tmp_path / ("\u00b5" * 125 + ".csv")
    write_whole(path, "new")
    assert path.read_text() == "new"


def test_unfinished_files_of_a_killed_writer_are_removed(tmp_path: Path) -> None:
    """Its parts, and no other file."""
    parts = tmp_path / "a.csv.77-1.part", tmp_path / "a.csv.77-2.part"
    others = tmp_path / "a.csv", tmp_path / "ab.csv.77-1.part"
    for path in (*parts, *others):
        path.write_text("x")
    remove_unfinished(tmp_path / "a.csv")
    assert sorted(tmp_path.iterdir()) == sorted(others)
    remove_unfinished(tmp_path / "none" / "a.csv")
