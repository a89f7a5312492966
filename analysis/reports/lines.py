"""How wide a text is, and where its lines end, measured with the font itself; inches and points."""

from __future__ import annotations

import textwrap
from functools import lru_cache

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextToPath

from analysis.reports.document import DIGIT_SPACE, PAIR, POINT_SPACE
from analysis.reports.glyphs import families, printable


@lru_cache(maxsize=20_000)
def width_of(text: str, size: float, weight: str = "normal") -> float:
    """Width of a line, in inches."""
    fonts = families(text)
    font = FontProperties(family=list(fonts), size=size, weight=weight if len(fonts) == 1 else "normal")
    return float(TextToPath().get_text_width_height_descent(printable(text), font, ismath=False)[0]) / 72.0


def wrapped(text: str, width: float, size: float, weight: str = "normal") -> list[str]:
    """Break text into lines that fit; a number, or a pair of them, is never broken."""
    if PAIR.match(text.replace(DIGIT_SPACE, "").replace(POINT_SPACE, "")) or _fits(text, width, size, weight):
        return [text] if text else []
    text = " ".join(text.split(" "))
    letters = max(8, int(1.3 * width / (width_of(text, size, weight) / len(text))))
    while True:
        lines = textwrap.wrap(text, letters, break_long_words=True)
        if letters <= 8 or all(_fits(line, width, size, weight) for line in lines):
            return lines
        letters -= 1


def _fits(text: str, width: float, size: float, weight: str) -> bool:
    return "\n" not in text and width_of(text, size, weight) <= width + 1e-6


def shortened(text: str, width: float, size: float) -> str:
    """Return the text, or its beginning with an ellipsis, on one line."""
    lines = wrapped(text, width, size)
    return lines[0] + (" …" if len(lines) > 1 else "") if lines else ""
