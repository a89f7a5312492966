"""Fonts of names in any script."""

from __future__ import annotations

from analysis.reports.text_metrics import families, printable


def test_a_name_in_another_script() -> None:
    """Latin, Greek and Cyrillic need one font; what no font has is replaced, nothing is dropped."""
    assert families("Изделие Ångström β") == ("DejaVu Sans",)
    assert printable("a\U0001f9bfb") == "a\ufffdb"
    assert len(printable("ソフト")) == 3
