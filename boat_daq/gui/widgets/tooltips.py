"""Tooltips as plain text: Qt takes a text with a tag for rich text, and loads the pictures that it names."""

from __future__ import annotations

from html import escape


def as_words(text: str) -> str:
    """Return `text` escaped for a tooltip; it may come from a file or a board."""
    return f"<p style='white-space: pre-wrap'>{escape(text)}</p>" if "<" in text else text
