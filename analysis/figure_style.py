"""The look of every figure and report: colours (Okabe and Ito, safe for colour blindness), sizes, fonts."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from protocol.base.errors import ChoiceError
from protocol.base.whole_file import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Arguments = ParamSpec("Arguments")
Drawn = TypeVar("Drawn")

SENSOR_COLOURS = ("#0072B2", "#D55E00", "#882255", "#44AA99")
PRESSURE_COLOUR = "#009E73"
ELONGATION_COLOUR = "#CC79A7"
INK = "#1A1A1A"
SOFT = "#5F6670"
LINE = "#C9CED6"
PAPER_COLOUR = "#FFFFFF"
PANEL = "#F4F6F8"
WARNING = "#8A4B00"
ON_DARK: dict[str, str] = {  # the same colours on a dark screen
    **dict(zip(SENSOR_COLOURS, ("#56B4E9", "#FF9A52", "#D98BB0", "#7FD1C3"), strict=True)),
    PRESSURE_COLOUR: "#3CCBA0", ELONGATION_COLOUR: "#E6A3C7", INK: "#E9EDF1", SOFT: "#A3AEB9", LINE: "#38414B",
    PAPER_COLOUR: "#1C2127", PANEL: "#14181D", WARNING: "#F0B45A",
}  # fmt: skip
BAND_ALPHA = 0.22
CYCLES = "viridis"

FONT = "DejaVu Sans"
OTHER_SCRIPTS = (  # TrueType, tried in this order for what the font lacks
    "Droid Sans Fallback", "WenQuanYi Zen Hei", "Arial Unicode MS", "Microsoft YaHei", "Yu Gothic", "MS Gothic",
    "Malgun Gothic", "Nirmala UI",
)  # fmt: skip
A4_INCH = (8.27, 11.69)
MARGIN_INCH = 0.75

RC: Any = {  # matplotlib types the keys of rc_context one by one
    "font.family": FONT,
    "font.size": 8.5,
    "text.color": INK,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "grid.color": LINE,
    "grid.linewidth": 0.4,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.5,
    "legend.frameon": True,
    "legend.framealpha": 0.75,
    "legend.edgecolor": "none",
    "legend.fontsize": 7.5,
    "svg.fonttype": "path",
    "svg.hashsalt": "boat-daq",
    "pdf.fonttype": 42,
    "figure.dpi": 100,
    "path.simplify": True,
}


def sensor_colour(number: int) -> str:
    """Return the colour of a sensor, counted from 0."""
    return SENSOR_COLOURS[number % len(SENSOR_COLOURS)]


def save_picture(figure: Figure, path: Path, **options: Any) -> None:
    """Write a figure whole, in the format of the suffix. OSError: it cannot be written. ChoiceError: no such format."""
    if path.suffix[1:].lower() not in figure.canvas.get_supported_filetypes():
        raise ChoiceError(f"{path} does not end in the format of a picture", "choose .png, .svg or .pdf")
    with written_whole(path) as part:
        figure.savefig(part, format=path.suffix[1:], **options)


def styled(draw: Callable[Arguments, Drawn]) -> Callable[Arguments, Drawn]:
    """Run a function that draws with matplotlib in this style, whatever the global one is."""

    @wraps(draw)
    def within(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Drawn:
        import matplotlib as mpl  # half a second that only who draws spends

        with mpl.rc_context(RC):
            return draw(*args, **kwargs)

    return within
