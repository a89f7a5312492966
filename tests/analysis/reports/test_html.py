"""HTML reports: one file that loads nothing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from analysis import figure_style as style
from tests.analysis.reports.conftest import MARKUP


@pytest.mark.fault(48, 54, how="markup in each name and note of a simulated run", times=1)
def test_html_is_one_file_that_loads_nothing(written: Path) -> None:
    """Fault 48: markup is escaped, no outside reference, no script, SIMULATED in head and title."""
    html = (written / "r.html").read_text(encoding="utf-8")
    assert MARKUP not in html
    assert "&lt;script&gt;" in html
    outside = re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?(?!#|data:)([^"\')\s>]+)', html)
    assert [ref for ref in outside if not ref.startswith("#")] == []
    assert "<script" not in html
    assert html.count("SIMULATED") >= 2
    assert html.count("<svg") >= 5  # curve, loops, cycles, budget, trace


def test_no_table_is_wider_than_a_telephone(written: Path) -> None:
    """Below 640 px each cell is a line of its own with its heading; nothing has a least width or scrolls sideways.

    Of the headings the first alone is left above the table, for its cells carry none, and it wraps.
    """
    html = (written / "r.html").read_text(encoding="utf-8")
    narrow = html.partition("@media (max-width: 640px)")[2].partition("@media print")[0]
    assert "min-width" not in narrow
    rules = {name.strip(): rule for name, rule in re.findall(r"([^{};]+)\{([^{}]*)\}", narrow)}
    assert "display: none" in rules["th"]
    assert all("white-space: normal" in rules[cell] for cell in ("th:first-child", "td, td.right"))
    assert "content: attr(data-head)" in narrow
    cells = re.findall(r"<td [^>]*>", html)
    assert cells
    assert all('data-head="' in cell for cell in cells)


def test_labels_of_drawings_are_read_on_a_telephone(written: Path) -> None:
    """A drawing shrinks to the 358 px of a telephone of 390: ticks of 8 pt stay above 7 pt; they were 5.5 pt."""
    html = (written / "r.html").read_text(encoding="utf-8")
    widths_pt = [float(width) for width in re.findall(r'<svg[^>]*? width="([\d.]+)pt"', html)]
    assert len(widths_pt) == html.count("<svg")
    px_per_pt, tick_pt = 4 / 3, style.RC["xtick.labelsize"]
    assert min(tick_pt * 358 / (px_per_pt * width) for width in widths_pt) > 7.0


def test_each_drawing_has_an_alternative_text_and_both_themes(written: Path) -> None:
    """Its title and axes in words; no colour of the light theme is fixed in a drawing."""
    html = (written / "r.html").read_text(encoding="utf-8")
    drawings = re.findall(r"<svg.*?</svg>", html, flags=re.DOTALL)
    alternatives = [re.match(r'<svg role="img" aria-label="([^"]+)"', drawing) for drawing in drawings]
    named = {one[1] for one in alternatives if one}
    assert len(named) == len(drawings)  # no two alike
    assert "Loading − unloading of the mean loop: hysteresis, % FSO over pressure, kPa" in named
    assert "@media screen and (prefers-color-scheme: dark)" in html
    assert not [colour for colour in style.ON_DARK if any(colour.lower() in drawing for drawing in drawings)]
