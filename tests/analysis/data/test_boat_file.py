"""Recordings of which no block is whole."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from analysis.data.boat_file import read_boat_file
from protocol.base.errors import FileError
from tests.analysis.boat_builder import Staircase, write_boat


@pytest.mark.parametrize(
    ("forgery", "word"),
    [
        ("n = n + 7", r"block 1 declares \d+ samples and holds \d+ bytes"),
        ("n = 0", "block 1 declares 0 samples"),
        ("crc32 = crc32 + 1", "block 1 does not match its checksum"),
    ],
)
def test_a_file_without_one_whole_block_is_called_damaged_and_not_empty(
    tmp_path: Path, forgery: str, word: str
) -> None:
    """What is wrong with the file, block by block; a file without blocks is one of a board that sent nothing."""
    path = write_boat(tmp_path / "forged.boat", Staircase(cycles=1).recording())
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"UPDATE block SET {forgery}")
    with pytest.raises(FileError, match=word) as refusal:
        read_boat_file(path)
    assert refusal.value.command == "boat-daq recover forged.boat"
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("DELETE FROM block")
    with pytest.raises(FileError) as empty:
        read_boat_file(path)
    assert "before the board sent any" in empty.value.remedy
