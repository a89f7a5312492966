"""Every colour, size and space of the window, once; and the style sheet made of them.

Rules: no colour or size is written anywhere else in `boat_daq.gui`. Data colours are Okabe and Ito's, lightened for
the dark theme; red is for VENT and faults alone; text has a contrast of 4.5 : 1 or more in both themes (a test
measures it). Space goes in steps of 4 px at 100 %; Qt scales the whole window with the
screen, so tokens are device-independent.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from string import Template

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QFont, QFontDatabase, QFontMetrics, QGuiApplication, QPalette
from PySide6.QtWidgets import QWidget

from protocol.base.units import STORED_UNITS, ShownUnits

HERE = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of one theme as `#rrggbb`."""

    name: str
    window: str  # behind everything
    surface: str  # cards and plots
    sunken: str  # fields and tracks
    line: str  # hairlines and borders
    grid: str  # grid of the plots
    text: str
    muted: str  # second voice: units, captions
    accent: str  # the one accent
    on_accent: str
    accent_soft: str  # selected row, hovered entry
    fault: str  # VENT and faults alone
    on_fault: str
    fault_soft: str
    ok: str
    warn: str
    warn_soft: str
    simulated: str
    on_simulated: str
    sensors: tuple[str, str, str, str]
    pressure: str
    elongation: str
    target: str
    units: ShownUnits = STORED_UNITS  # of the values that are shown, as the operator chose them


LIGHT = Theme(
    name="light", window="#eef0f3", surface="#ffffff", sunken="#f5f6f8", line="#d3d8de", grid="#e4e7eb",
    text="#1a2027", muted="#555f6b", accent="#3847a8", on_accent="#ffffff", accent_soft="#e5e8f7",
    fault="#c3161c", on_fault="#ffffff", fault_soft="#fbe9e9", ok="#0a6b4f", warn="#8a5300", warn_soft="#fdf1dc",
    simulated="#f0e442", on_simulated="#1a2027",
    sensors=("#0072b2", "#d55e00", "#56b4e9", "#e69f00"), pressure="#009e73", elongation="#cc79a7", target="#6b7683",
)  # fmt: skip
DARK = Theme(
    name="dark", window="#14181d", surface="#1c2127", sunken="#242a31", line="#38414b", grid="#2b323a",
    text="#e9edf1", muted="#a3aeb9", accent="#a3b1ff", on_accent="#14181d", accent_soft="#2c3350",
    fault="#d5282e", on_fault="#ffffff", fault_soft="#43201f", ok="#4fd0a5", warn="#f0b45a", warn_soft="#3b2f1b",
    simulated="#f0e442", on_simulated="#1a2027",
    sensors=("#56b4e9", "#ff9a52", "#8fd0f5", "#f5c04a"), pressure="#3ccba0", elongation="#e6a3c7", target="#93a0ad",
)  # fmt: skip

# Space and size, device-independent pixels.
STEP = 4
GAP = 2 * STEP
PAGE_MARGIN = 3 * STEP
CARD_PADDING = 3 * STEP
RADIUS = 6
HEADER_HEIGHT = 56
STRIP_HEIGHT = 40
STRIP_HEIGHT_LOW = 36  # the height of its buttons
NAVIGATION_WIDTH = 124
NAVIGATION_WIDTH_NARROW = 100
UNLIMITED = (1 << 24) - 1  # Qt's QWIDGETSIZE_MAX, which PySide6 does not name
PANE_WIDTH = 308
PANE_WIDTH_WIDE = 400
PANE_WIDTH_NARROW = 236
NARROW_BELOW = 1200  # a small or much enlarged screen: figures and pane shrink
CLOSE_BELOW = 1440  # width of the window below which the parts of the header are close together
STACKED_BELOW = 960  # a narrower page stacks its sides, each with the height below
STACKED_HEIGHT = 280
LOW_BELOW = 640  # in a lower window the staircase is hidden
WIDE_FROM = 1600  # from this window width on the pane and the figures grow
CONTROL_HEIGHT = 32
VENT_WIDTH = 176
VENT_HEIGHT = 44
TITLE_HEIGHT = 20
AXIS_WIDTH = 70  # a title in two lines beside labels of four digits
AXIS_HEIGHT = 36
POINT_SIZE = 8
WINDOW_SIZE = (1280, 800)
WINDOW_MINIMUM = (840, 500)  # 150 % on 1280 x 800, 200 % on 1920 x 1080, less the system's own frame
PLOT_MINIMUM = (168, 116)  # below it a page scrolls
PLOT_MORE = 64  # for each further plot of a card
LIVE_PLOTS_MINIMUM = 88
HEADING_LEAST = 72
REMARKS_MOST = 84  # words under the figures; more of them scroll
REMARKS_GROW = 900  # height of a window: they get what is above
FIGURES_LEAST = 280  # below it the table of figures scrolls
STRIP_PLOT_HEIGHT = 184  # of all designs by merit; the map below it gets the rest
ROW_LEAST = 56  # of a live plot; where not all are so high, a choice shows some
ROW_LOW = 120  # the same in a low window, where few are read well
FORM_WIDTH = 560
CERTIFICATE_WIDTH = 1280  # a page of A4 at 96 pixels per inch beside the form
PAGE_WIDTH = 794  # of A4 at 96 pixels per inch, at most
LIST_SHARE = 0.85  # of the height of the screen, for a window with a list
QUESTION_LEAST = 240
PANEL_SHARE = 0.9  # of the window, for a panel with a picture
THUMBNAIL = (168, 44)

# Type, pixels: measured is large and still, set is medium, chrome is small.
FONT_CHROME = 13
FONT_SMALL = 12
FONT_NARROW = 11  # of the table beside narrow plots: four columns fit in the widest of FAMILIES
FONT_SET = 16
FONT_TITLE = 18
FONT_MEASURED = 34
FONT_MEASURED_NARROW = 18  # four of them beside the pane at 853 px, in the widest of FAMILIES
FONT_MEASURED_WIDE = 48
FAMILIES = ("Inter", "Segoe UI", "SF Pro Text", "Helvetica Neue", "Noto Sans", "Liberation Sans", "DejaVu Sans")

VIRIDIS = ("#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725")
VIRIDIS_USED = (0.32, 0.84)  # without the ends that a dark and a light ground would swallow

BAND_OPACITY = 56  # of 255: a band lets the grid and the curve through
BAND_ALPHA_WIDE = 30
LABEL_OPACITY = 200  # of the ground of a line's label: data stay visible through it
RAY_ALPHA = 90
PAST_ALPHA = 150  # of curves of cycles before the last one
STALE_OPACITY = 0.35  # of data that have ended


def style_sheet(theme: Theme) -> str:
    colours = {field.name: getattr(theme, field.name) for field in fields(theme)}
    sheet = Template((HERE / "sheet.css").read_text(encoding="utf-8"))
    return sheet.substitute(
        colours,
        icons=(HERE / "icons").as_posix(),
        fault_text="#ff8a86" if theme.name == "dark" else theme.fault,
        under_icons=theme.target if theme.name == "dark" else theme.surface,  # Qt's own icons are dark
        font_chrome=FONT_CHROME, font_small=FONT_SMALL, font_set=FONT_SET, font_title=FONT_TITLE,
        radius=RADIUS, inner_height=CONTROL_HEIGHT - 8, vent_height=VENT_HEIGHT - 4, vent_width=VENT_WIDTH - 4,
        vent_focus_height=VENT_HEIGHT - 12, vent_focus_width=VENT_WIDTH - 12,
        paste_height=3 * CONTROL_HEIGHT - 8,
    )  # fmt: skip


def palette(theme: Theme) -> QPalette:
    """Return Qt's palette in `theme`, for what no style sheet reaches (placeholders, links, disabled text)."""
    result = QPalette()
    roles = QPalette.ColorRole
    for role, colour in (
        (roles.Window, theme.window), (roles.Base, theme.surface), (roles.AlternateBase, theme.sunken),
        (roles.WindowText, theme.text), (roles.Text, theme.text), (roles.ButtonText, theme.text),
        (roles.Button, theme.surface), (roles.Highlight, theme.accent), (roles.HighlightedText, theme.on_accent),
        (roles.PlaceholderText, theme.muted), (roles.Link, theme.accent), (roles.ToolTipBase, theme.text),
        (roles.ToolTipText, theme.surface), (roles.Mid, theme.line),
    ):  # fmt: skip
        result.setColor(role, QColor(colour))
    return result


def sequential(place: int, of: int) -> str:
    """Return the colour of the `place`-th of `of` steps on viridis: one scale for both themes."""
    first, last = VIRIDIS_USED
    at = (first + (last - first) * place / max(of - 1, 1)) * (len(VIRIDIS) - 1)
    low = min(int(at), len(VIRIDIS) - 2)
    a, b = QColor(VIRIDIS[low]), QColor(VIRIDIS[low + 1])
    share = at - low
    mixed = (x + (y - x) * share for x, y in ((a.red(), b.red()), (a.green(), b.green()), (a.blue(), b.blue())))
    return QColor(*(round(value) for value in mixed)).name()


def faint(value: str, alpha: int) -> str:
    """Return a token with `alpha` of 255, as `#aarrggbb`."""
    return colour(value, alpha).name(QColor.NameFormat.HexArgb)


def colour(value: str, alpha: int = 255) -> QColor:
    """Return a token as Qt's colour, with `alpha` of 255."""
    result = QColor(value)
    result.setAlpha(alpha)
    return result


@cache
def _family() -> str:
    known = set(QFontDatabase.families())
    return next((name for name in FAMILIES if name in known), QFont().defaultFamily())


def font(pixels: int = FONT_CHROME, weight: QFont.Weight = QFont.Weight.Normal) -> QFont:
    """Return the program's font: the system's first of `FAMILIES`; figures have one width, so that none moves."""
    result = QFont(_family(), weight=weight)
    result.setPixelSize(pixels)
    result.setFeature(QFont.Tag("tnum"), 1)
    return result


def small_font() -> QFont:
    return font(FONT_SMALL)


def text_width(of: QFont, text: str) -> int:
    """Return the width of `text` in a font, pixels."""
    return QFontMetrics(of).horizontalAdvance(text)


def list_height(window: QWidget) -> int:
    return round(LIST_SHARE * window.screen().availableSize().height())


def system_theme() -> Theme:
    """Return the theme that the system asks for; light where it does not say."""
    scheme = QGuiApplication.styleHints().colorScheme()
    return DARK if scheme == Qt.ColorScheme.Dark else LIGHT
