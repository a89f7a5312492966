"""The tokens of the style: contrast, colours that stay apart, none written elsewhere."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path

import pytest
from PySide6.QtGui import QColor

from boat_daq.gui import style

GUI = Path(style.__file__).parent


def luminance(colour: str) -> float:
    """Relative luminance, WCAG 2.2."""
    parts = [c / 255 for c in QColor(colour).getRgb()[:3]]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(a: str, b: str) -> float:
    """Contrast ratio, WCAG 2.2."""
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [style.LIGHT, style.DARK], ids=lambda t: t.name)
def test_text_has_contrast(theme):
    """Text of every voice has 4.5 : 1 or more on every surface it is drawn on."""
    pairs = [
        *((theme.text, g) for g in (theme.window, theme.surface, theme.sunken, theme.accent_soft, theme.warn_soft)),
        *((theme.muted, ground) for ground in (theme.window, theme.surface, theme.sunken)),
        (theme.accent, theme.surface), (theme.on_accent, theme.accent), (theme.on_fault, theme.fault),
        (theme.ok, theme.surface), (theme.warn, theme.surface), (theme.on_simulated, theme.simulated),
        (theme.text, theme.fault_soft),
    ]  # fmt: skip
    assert {pair: round(contrast(*pair), 2) for pair in pairs if contrast(*pair) < 4.5} == {}


@pytest.mark.parametrize("theme", [style.LIGHT, style.DARK], ids=lambda t: t.name)
def test_curves_contrast_with_the_ground(theme):
    """Every curve has 2 : 1 or more against the plot's ground."""
    curves = (*theme.sensors[:2], theme.pressure, theme.elongation, theme.target)
    assert [c for c in curves if contrast(c, theme.surface) < 2.0] == []


def colour_blind(colour: str) -> tuple[float, float, float]:
    """Deuteranope's view of a colour (Vienot, Brettel and Mollon 1999), linear RGB."""
    r, g, b = (c / 255 for c in QColor(colour).getRgb()[:3])
    r, g, b = r**2.2, g**2.2, b**2.2
    return 0.29275 * r + 0.70725 * g, 0.29275 * r + 0.70725 * g, -0.02234 * r + 0.02234 * g + b


@pytest.mark.parametrize("theme", [style.LIGHT, style.DARK], ids=lambda t: t.name)
def test_data_colours_stay_apart_for_the_colour_blind(theme):
    """The two sensors, pressure and elongation differ for a deuteranope."""
    colours = (*theme.sensors[:2], theme.pressure, theme.elongation)
    for a, b in combinations(colours, 2):
        distance = sum((x - y) ** 2 for x, y in zip(colour_blind(a), colour_blind(b), strict=True)) ** 0.5
        assert distance > 0.1, (a, b)


def test_no_colour_is_written_elsewhere():
    """Only the style file and the icons made for it hold a colour."""
    found = [
        f"{path.name}: {match}"
        for path in [*GUI.rglob("*.py"), GUI / "sheet.css"]
        if path.name != "style.py"
        for match in re.findall(r'#[0-9a-fA-F]{6}\b|(?:QColor|mkPen|mkBrush)\("\w+"', path.read_text(encoding="utf-8"))
    ]
    assert found == []


def test_the_sheet_needs_only_tokens():
    """Every name in the sheet is a token; one that is not would raise."""
    for theme in (style.LIGHT, style.DARK):
        assert "$" not in style.style_sheet(theme)


def test_viridis_keeps_its_order():
    """The one sequential scale of both themes grows lighter, and is visible on either ground at both ends."""
    steps = [luminance(style.sequential(i, 8)) for i in range(8)]
    assert steps == sorted(steps)
    for theme in (style.LIGHT, style.DARK):
        assert min(contrast(theme.surface, style.sequential(i, 8)) for i in range(8)) > 1.5
