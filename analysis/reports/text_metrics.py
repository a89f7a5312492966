"""Fonts that hold a text's characters, how wide it is, and where its lines end; in inches and points.

Names of people and units are written in any script: the report's own font is used where it has all characters, with
the fonts of other scripts on this computer behind it; a character that no font has is set as the replacement character.
Widths are measured with the font itself.
"""

from __future__ import annotations

import textwrap
from functools import cache, lru_cache

from matplotlib import font_manager
from matplotlib.font_manager import FontProperties
from matplotlib.ft2font import FT2Font
from matplotlib.textpath import TextToPath

from analysis import figure_style as style
from analysis.reports.document import DIGIT_SPACE, PAIR, POINT_SPACE

REPLACEMENT = "\ufffd"


@cache
def _fonts() -> tuple[tuple[str, FT2Font], ...]:
    installed = set(font_manager.get_font_names())
    names = (style.FONT, *(name for name in style.OTHER_SCRIPTS if name in installed))
    return tuple((name, font_manager.get_font(font_manager.findfont(name))) for name in names)


@cache
def _font_of(character: str) -> str | None:
    return next((name for name, font in _fonts() if font.get_char_index(ord(character))), None)


@cache
def families(text: str) -> tuple[str, ...]:
    """Return the fonts that `printable(text)` needs, the report's own first."""
    needed = {_font_of(character) for character in text} - {None, style.FONT}
    return (style.FONT, *(name for name, _ in _fonts() if name in needed))


@cache
def printable(text: str) -> str:
    """Return the text with what no font here has as the replacement character."""
    return "".join(c if c.isspace() or _font_of(c) else REPLACEMENT for c in text)


@lru_cache(maxsize=20_000)
def width_of(text: str, size: float, weight: str = "normal") -> float:
    """Width of a line, in inches.

    Parameters
    ----------
    text : one line.
    size : points.
    weight : of the font.
    """
    fonts = families(text)
    font = FontProperties(family=list(fonts), size=size, weight=weight if len(fonts) == 1 else "normal")
    return float(TextToPath().get_text_width_height_descent(printable(text), font, ismath=False)[0]) / 72.0


def wrapped(text: str, width: float, size: float, weight: str = "normal") -> list[str]:
    """Break text into lines that fit; a number, or a pair of them, is never broken.

    Parameters
    ----------
    text : to break.
    width : inches.
    size : points.
    weight : of the font.
    """
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
    """Return the text, or its beginning with an ellipsis, on one line.

    Parameters
    ----------
    text : to shorten.
    width : inches.
    size : points.
    """
    lines = wrapped(text, width, size)
    return lines[0] + (" …" if len(lines) > 1 else "") if lines else ""
