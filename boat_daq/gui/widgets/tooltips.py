"""What is said on hover, as words: Qt takes a text with a tag for rich text, and loads the pictures that it names."""

from __future__ import annotations

from html import escape


def as_words(text: str) -> str:
    """Return `text` such that a tip shows it letter by letter; it may come from a file, a board, a name."""
    return f"<p style='white-space: pre-wrap'>{escape(text)}</p>" if "<" in text else text
