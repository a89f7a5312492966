"""Tables of a report: numbers aligned at the decimal point and at the plus-minus."""

from __future__ import annotations

from analysis.reports.document import ReportTable, aligned, right_aligned, typeset


def test_columns_meet_at_the_decimal_point() -> None:
    """1.5 above 12.25 is padded by one digit, a whole number by point and digits."""
    table = aligned(ReportTable(("a", "b"), (("x", "1.5"), ("y", "12.25"), ("z", "3"), ("w", "–"))))
    assert [row[1] for row in table.rows] == ["1.5\u2007", "12.25", "3\u2008\u2007\u2007", "–"]
    assert len({len(row[1].partition(".")[2]) for row in table.rows[:2]}) == 1


def test_numbers_meet_at_the_point_and_at_the_plus_minus() -> None:
    """Digits of one place are aligned, in intervals too; text is left-aligned; the minus is U+2212."""
    limits = aligned(ReportTable(("", "95 % interval"), (("a", "-1.7 … 3.8"), ("b", "39.269 … 139.42"))))
    low, high = (line[1].replace("\u2007", "_").replace("\u2008", ".") for line in limits.rows)
    assert (low, high) == ("\u22121.7__ … __3.8_", "39.269 … 139.42")
    table = aligned(ReportTable(("", "b", "unit"), (("b0", "1651.98 ± 0.12", "mV"), ("b1", "-2.7 ± 12.1", "mV/mm"))))
    first, second = (line[1].replace("\u2007", "_").replace("\u2008", ".") for line in table.rows)
    assert first == "1651.98 ± _0.12"
    assert second == "\u22122.7_ ± 12.1_"
    assert right_aligned(table) == (False, True, False)
    assert typeset("from -2.7 on 2026-01-02 08:00:00 -0400") == "from \u22122.7 on 2026-01-02 08:00:00 -0400"
