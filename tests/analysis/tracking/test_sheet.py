"""The sheet of marks: true size, and marks that the tracker finds."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import pytest

from analysis.tracking.sheet import write_sheet
from protocol.base.errors import RequestError

POINTS_PER_MM = 72 / 25.4


def test_marks_have_their_true_size_on_the_page(tmp_path: Path) -> None:
    """Black squares of 8 mm on A4, read from the page's own drawing commands."""
    write_sheet(tmp_path / "marks.pdf", 8.0)
    content = (tmp_path / "marks.pdf").read_bytes()
    (box,) = re.findall(rb"/MediaBox \[ ?([\d. ]+) ?\]", content)
    assert [float(v) / POINTS_PER_MM for v in box.split()[2:]] == pytest.approx([210.0, 297.0], abs=0.1)
    streams = [
        zlib.decompress(s) for s in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL) if s[:1] == b"x"
    ]
    page = next(s for s in streams if b" re" in s or b" l" in s)
    corners = [[float(v) for v in m] for m in re.findall(rb"([\d.]+) ([\d.]+) m\n([\d.]+) ([\d.]+) l\n", page)]
    sides = [abs(x1 - x0) / POINTS_PER_MM for x0, y0, x1, y1 in corners if y0 == y1 and x0 != x1]
    assert sum(side == pytest.approx(8.0, abs=0.01) for side in sides) >= 2
    assert any(side == pytest.approx(100.0, abs=0.01) for side in sides)


def test_other_files_and_sizes_are_refused(tmp_path: Path) -> None:
    """Cause and remedy."""
    with pytest.raises(RequestError, match=r"does not end in \.pdf"):
        write_sheet(tmp_path / "marks.png", 8.0)
    with pytest.raises(RequestError, match="1000 mm is not possible"):
        write_sheet(tmp_path / "marks.pdf", 1000.0)
