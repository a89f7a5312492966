"""Where the pages of a report end: all breaks are chosen at once, for the least white.

Strategy: a report is a row of blocks that no break divides: a line, a row of a table, a drawing. A page may stretch its
drawings and shrink drawings and rows a little; the white that remains costs its square, as breaking a table does, and
the cheapest set of breaks is found by dynamic programming (Knuth and Plass, Software: Practice and Experience 11 (1981)
1119, with pages for lines).

Rules: a block that is `kept` is separated from the next only where no page holds both; a table that continues repeats
its head; sizes are in inches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis import figure_style as style
from analysis.reports.document import ReportDrawing

STRETCH, SHRINK = 0.35, 0.25  # of a drawing's height
ROW_SHRINK = 0.07  # of a row's height
LEAST_LAST = 0.2  # a last page that is less full costs
PAGE, PARTED, TABLE, SECTION = 0.03, 10.0, 0.04, 0.02  # costs; SECTION of a break that is not before a heading


@dataclass(frozen=True, slots=True)
class Text:
    """A piece of text; y down from the top of its block, on a page from the top of the page."""

    x: float
    y: float
    text: str
    size: float = 8.5
    colour: str = style.INK
    weight: str = "normal"
    align: str = "left"


@dataclass(frozen=True, slots=True)
class Rule:
    """A horizontal line; in a block it is at the lower edge."""

    x: float
    y: float
    length: float
    colour: str = style.LINE
    thick: float = 0.5


@dataclass(frozen=True, slots=True)
class Placed:
    """A drawing whose top is at y."""

    y: float
    drawing: ReportDrawing


Item = Text | Rule | Placed


@dataclass(frozen=True, slots=True)
class PageBlock:
    """What no break divides.

    Attributes
    ----------
    height : without `space`, the white above it, which a page that begins with the block leaves out.
    texts, rule, drawing : its content.
    kept : is on one page with the next block.
    starts : begins a section.
    head : repeated above the block where a page begins with it.
    """

    height: float
    texts: tuple[Text, ...] = ()
    rule: Rule | None = None
    drawing: ReportDrawing | None = None
    space: float = 0.0
    kept: bool = False
    starts: bool = False
    head: PageBlock | None = None

    @property
    def stretch(self) -> float:
        """By how much it may grow."""
        return STRETCH * self.height if self.drawing else 0.0

    @property
    def shrink(self) -> float:
        """By how much it may become shorter."""
        if self.drawing:
            return SHRINK * self.height
        return ROW_SHRINK * self.height if self.head else 0.0


def broken(blocks: Sequence[PageBlock], page_height: float) -> list[list[PageBlock]]:
    """Return the blocks page by page, each page holding `page_height` inches."""
    best = [0.0] + [float("inf")] * len(blocks)  # cost of the first n blocks on whole pages
    start = [0] * (len(blocks) + 1)
    for first in range(len(blocks)):
        if best[first] == float("inf"):
            continue
        height, stretch, shrink = _sums(_page(blocks, first, first))
        for end in range(first + 1, len(blocks) + 1):
            block = blocks[end - 1]
            height += block.height + (block.space if end > first + 1 else 0.0)
            stretch, shrink = stretch + block.stretch, shrink + block.shrink
            cost = _cost((height, stretch, shrink), page_height, last=end == len(blocks))
            if cost is None and end > first + 1:
                break
            total = best[first] + (PARTED if cost is None else cost) + PAGE + _parting(blocks, end)
            if total < best[end]:
                best[end], start[end] = total, first
    pages: list[list[PageBlock]] = []
    end = len(blocks)
    while end:
        pages.insert(0, _page(blocks, start[end], end))
        end = start[end]
    return pages


def _page(blocks: Sequence[PageBlock], first: int, end: int) -> list[PageBlock]:
    """The blocks of a page, the head of a table that continues included; with `end` = `first`, that head alone."""
    top = blocks[first]
    head = [top.head] if top.head else []
    return head if end == first else [*head, replace(top, space=0.0), *blocks[first + 1 : end]]


def _sums(page: Sequence[PageBlock]) -> tuple[float, float, float]:
    """Height of a page's blocks, and by how much they may grow and become shorter."""
    return sum(b.space + b.height for b in page), sum(b.stretch for b in page), sum(b.shrink for b in page)


def _parting(blocks: Sequence[PageBlock], end: int) -> float:
    if end == len(blocks):
        return 0.0
    after = blocks[end]
    return PARTED * blocks[end - 1].kept + TABLE * (after.head is not None) + SECTION * (not after.starts)


def _cost(sums: tuple[float, float, float], page_height: float, *, last: bool) -> float | None:
    """Cost of a page, None where it does not hold the blocks."""
    height, stretch, shrink = sums
    if height > page_height:
        pressed = (height - page_height) / (shrink or 1e-9)
        return None if pressed > 1.0 else 0.05 * pressed**2
    if last:
        return max(0.0, 1.0 - height / (LEAST_LAST * page_height)) * 0.5
    white = page_height - height
    grown = min(white, stretch)
    return ((white - grown) / page_height) ** 2 + 0.05 * (grown / page_height) ** 2


def placed(page: Sequence[PageBlock], page_height: float, top: float, *, last: bool) -> list[Item]:
    """Return the items of a page in their places, its drawings and rows fitted to the page.

    Parameters
    ----------
    page : its blocks.
    page_height, top : height of the type area and its upper edge, inches.
    last : the last page keeps its white.
    """
    total, stretch, shrink = _sums(page)
    white = page_height - total
    grow = 0.0 if last or white < 0 else min(1.0, white / (stretch or 1e9))
    press = min(1.0, -white / (shrink or 1e9)) if white < 0 else 0.0
    items: list[Item] = []
    y = top
    for block in page:
        y += block.space
        height = block.height + grow * block.stretch - press * block.shrink
        if block.drawing is not None:
            items.append(Placed(y, replace(block.drawing, height=height)))
        items += [replace(text, y=y + text.y) for text in block.texts]
        y += height
        if block.rule is not None:
            items.append(replace(block.rule, y=y))
    return items
