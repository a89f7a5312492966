"""Which font holds a text's characters: names of people and units are written in any script.

Rules: the report's own font where it has them all, with the scripts' fonts of this computer behind it where not; a
character that no font here has is set as the replacement character.
"""

from __future__ import annotations

from functools import cache

from matplotlib import font_manager
from matplotlib.ft2font import FT2Font

from analysis import figure_style as style

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
