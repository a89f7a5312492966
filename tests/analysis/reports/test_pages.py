"""Pages of a report: where they end, against every other way to end them; the script of a name."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from analysis.reports import pages, pdf
from analysis.reports.document import ReportDrawing, ReportTable
from analysis.reports.pages import PageBlock, broken, placed


def row(height: float, head: PageBlock | None = None, **how: bool) -> PageBlock:
    return PageBlock(height, head=head, **how)


def drawn(height: float) -> PageBlock:
    return PageBlock(height, drawing=ReportDrawing((), "", height), kept=True)


def cost(blocks: list[PageBlock], counts: list[int], height_inch: float) -> float:
    """Cost of pages of so many blocks each; a page that does not hold its blocks is one only if it is a single one."""
    total, first = 0.0, 0
    for n in counts:
        end = first + n
        found = pages._cost(pages._sums(pages._page(blocks, first, end)), height_inch, last=end == len(blocks))
        own = found if found is not None else pages.PARTED if n == 1 else np.inf
        total += own + pages.PAGE + pages._parting(blocks, end)
        first = end
    return total


def test_no_other_breaks_are_cheaper() -> None:
    """Every set of breaks of nine blocks is tried: none costs less than the chosen one."""
    rng = np.random.default_rng(0)
    cuts = [cut for n in range(9) for cut in itertools.combinations(range(1, 9), n)]
    for _ in range(5):
        blocks = [drawn(float(h)) if h > 2 else row(float(h), starts=h < 0.5) for h in rng.uniform(0.2, 3.5, 9)]
        chosen = [len(page) for page in broken(blocks, 6.0)]
        every = ([b - a for a, b in itertools.pairwise([0, *cut, 9])] for cut in cuts)
        assert cost(blocks, chosen, 6.0) == pytest.approx(min(cost(blocks, counts, 6.0) for counts in every))


@pytest.mark.parametrize("rows", range(48, 58))
def test_no_page_holds_a_single_row(rows: int) -> None:
    """However long a table is, its head is on every page, with four rows or more of it, and none is lost."""
    blocks = pdf._table(ReportTable(("no.", "mV"), tuple((str(k), "1.0") for k in range(rows)), "Means."))
    found = broken(blocks, pdf.PAGE_INCH)
    heads = [sum(b is blocks[0] or b.texts == blocks[0].texts for b in page) for page in found]
    held = [sum(b.head is not None for b in page) for page in found]
    assert heads == [1] * len(found)
    assert sum(held) == rows
    assert min(held) >= pdf.ORPHANS


@pytest.mark.parametrize(("drawing", "last", "foot"), [(5.8, False, 7.0), (4.0, False, 6.6), (4.0, True, 5.2)])
def test_what_is_placed_stays_on_its_page(drawing: float, last: bool, foot: float) -> None:
    """Pressed, a page ends at its foot; stretched, no further than drawings may grow; the last one is not stretched."""
    page = [drawn(drawing), PageBlock(0.2, rule=pages.Rule(0.0, 0.0, 1.0), head=row(0.2))]
    assert placed(page, 6.0 if foot == 7.0 else 5.6, 1.0, last=last)[-1].y == pytest.approx(foot)


def test_a_heading_is_never_the_last_line_of_a_page() -> None:
    """It goes over with what it names."""
    blocks = [row(1.0), row(1.0), row(0.3, kept=True, starts=True), row(0.9)]
    assert [len(page) for page in broken(blocks, 2.5)] == [2, 2]
