"""Fonts of names in any script."""

from __future__ import annotations

from analysis.reports.text_metrics import families, printable


def test_a_name_in_another_script() -> None:
    """Latin, Greek and Cyrillic need one font; what no font has is replaced, nothing is dropped."""
    assert families("Изделие Ångström β") == ("DejaVu Sans",)
    assert printable("a\U0001f9bfb") == "a\ufffdb"
    assert len(printable("ソフト")) == 3


def test_nothing_that_cannot_be_printed_is_left() -> None:
    """Controls, private and unpaired characters are replaced, an override of direction is dropped, long words break."""
    assert printable("a\x00b\ue000c\ud800") == "a\ufffdb\ufffdc\ufffd"
    assert printable("a\u202eb\nc\td") == "ab c d"
    assert max(map(len, printable("x" * 99).split("\u200b"))) == 40
