"""Fonts that hold a text's characters, and what of it can be printed.

Names of people and units are written in any script: the report's own font is used where it has all characters, with
the fonts of other scripts on this computer behind it; a character that no font has, or that PDF/A forbids, is set as
the replacement character.
"""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from pathlib import Path

from matplotlib import font_manager
from matplotlib.ft2font import FT2Font

from analysis import figure_style as style

REPLACEMENT = "\ufffd"
FORBIDDEN = ("Cc", "Cn", "Co", "Cs")  # categories: controls, unassigned, private use, halves of surrogates
_DIRECTIONS = dict.fromkeys(map(ord, "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"))
_WORD, _BREAK = re.compile(r"\S{40}(?=\S)"), "\u200b"


@cache
def _fonts() -> tuple[tuple[str, FT2Font, Path], ...]:
    installed = set(font_manager.get_font_names())
    names = (style.FONT, *(name for name in style.OTHER_SCRIPTS if name in installed))
    paths = [Path(font_manager.findfont(name)) for name in names]
    return tuple((name, font_manager.get_font(path), path) for name, path in zip(names, paths, strict=True))


@cache
def _font_of(character: str) -> str | None:
    return next((name for name, font, _ in _fonts() if font.get_char_index(ord(character))), None)


def fonts() -> list[str]:
    """Return the names of the fonts, the report's own first."""
    return [name for name, _, _ in _fonts()]


def font_folders() -> list[str]:
    return list(dict.fromkeys(str(path.parent) for _, _, path in _fonts()))


@cache
def families(text: str) -> tuple[str, ...]:
    """Return the fonts that `printable(text)` needs, the report's own first."""
    needed = {_font_of(character) for character in text} - {None, style.FONT}
    return (style.FONT, *(name for name in fonts() if name in needed))


@cache
def printable(text: str) -> str:
    """Return the text with what no font here has as the replacement character, on one line.

    A change of direction that is written as a character is left out: it would turn what follows it around; letters that
    are written from right to left need none. A word that is longer than a line may be broken.
    """
    text = "".join(map(_printable, text.translate(_DIRECTIONS)))
    return _WORD.sub(lambda word: word[0] + _BREAK, text)


@cache
def _printable(character: str) -> str:
    if character.isspace():
        return character if unicodedata.category(character) == "Zs" else " "
    if unicodedata.category(character) in FORBIDDEN or _font_of(character) is None:
        return REPLACEMENT
    return character
