"""The live plots: the last seconds of every signal, thinned to extremes, with cursors, markers and values.

Rules: drawing never touches more points than the screen has columns (the ring keeps a min-max pyramid, so no spike is
lost). Freezing stops the plots, never the recording. Elongation is shown only while a calibration is in use.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.formatting import in_units, number
from boat_daq.viewmodels.live.axis import SteadyRange, extremes
from boat_daq.viewmodels.live.layout import ELONGATION, PRESSURE, Axes, Layout, difference_of, is_signal, titles, unit
from boat_daq.viewmodels.live.layout import title as layout_title
from boat_daq.workflows.live_conversion import LiveElongation
from protocol.base.arrays import FloatArray
from protocol.base.units import NOTHING, STORED_UNITS, ShownUnits, as_text
from protocol.recording import ExtraChannel

if TYPE_CHECKING:
    from analysis.signal_prediction.prediction import LivePrediction

Columns = Mapping[str, FloatArray]

WINDOWS_S = (10.0, 30.0, 60.0, 120.0, 300.0, 900.0, 3600.0, math.inf)
HEADLINE_S = 0.2  # a value is the mean over this time, so that it is legible
POINTS_A_COLUMN = 16  # read for each column of pixels, of which two are painted
HOLE_S = 1.0  # without a sample: a disconnected board, not a lost frame
_QUICK_SAMPLES = 128  # samples
PIXELS_A_FRAME = 0.6  # a smaller motion need not be drawn
FASTEST_MS, _CALM_MS, REST_MS = 16, 40, 250
FRAMES_SHARE = 0.2  # of a core, that frames may take: where each costs more, fewer are drawn
CYCLES_KEPT, CYCLE_POINTS = 5, 1200  # of the overlay
RECENT = 200  # samples among which a channel has a value, or is taken for text
CHANNEL_DECIMALS = 2


Inverse = Callable[[FloatArray], LiveElongation]  # [n, sensors] mV -> elongation


@dataclass(frozen=True, slots=True)
class PlotFrame:
    """One frame of the plots: width in pixels, horizontal range, columns."""

    width: int
    low_s: float
    high_s: float
    columns: Columns
    elongation: LiveElongation | None
    predicted: tuple[FloatArray, FloatArray] | None = None  # signals [n, sensors], and half the width of their band


@dataclass(frozen=True, slots=True)
class Headline:
    signals: tuple[str, ...]
    pressure: str
    target: str
    elongation: str
    band: str
    band_short: str = ""  # for a narrow window


@dataclass(frozen=True, slots=True)
class Span:
    """The statistics of a quantity between the cursors; `sensor` is 0 for any but a signal."""

    sensor: int
    name: str
    unit: str
    decimals: int
    mean: float
    sd: float
    low: float
    high: float
    slope_per_s: float
    snr_db: float
    difference: float  # at B less at A

    @property
    def cells(self) -> tuple[str, ...]:
        """Return the row as text, in the order of `STATISTICS_HEADINGS`."""
        d = self.decimals
        return (
            f"{self.name} ({self.unit})", number(self.mean, d), number(self.sd, d + 1), number(self.low, d),
            number(self.high, d), number(self.difference, d, sign=True), number(self.slope_per_s, d + 1, sign=True),
            f"{number(self.snr_db, 1)} dB" if self.sensor else NOTHING,
        )  # fmt: skip


HEADINGS_SHORT = ("mean", "sd", "min", "max", "B \u2212 A", "slope/s", "SNR, dB")
STATISTICS_HEADINGS = ("", "mean", "sd", "min", "max", "B \u2212 A", "slope per s", "SNR (mean / sd)")


def sensor_names(columns: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the signal columns, in order of their sensor."""
    return _sensor_names(tuple(columns))


@lru_cache(maxsize=64)
def _sensor_names(columns: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted(filter(is_signal, columns)))


def signals(columns: Mapping[str, FloatArray | float]) -> FloatArray:
    """Return the signals side by side, [n, sensors] mV."""
    return np.column_stack([columns[name] for name in sensor_names(columns)])


def with_holes(columns: Columns) -> Columns:
    """Return the columns with a NaN in each gap of time, so that no line is drawn across it.

    A gap is longer than a second and than five times the 90th percentile of the steps.
    """
    time_s = columns["time_s"]
    steps = np.diff(time_s)
    if not steps.size or steps.max() <= HOLE_S:
        return columns
    behind = np.flatnonzero(steps > max(HOLE_S, 5 * float(np.percentile(steps, 90)))) + 1
    middle = 0.5 * (time_s[behind - 1] + time_s[behind])
    return {name: np.insert(v, behind, middle if name == "time_s" else math.nan) for name, v in columns.items()}


@dataclass(slots=True)
class LiveModel:
    ring: Callable[[], RingBuffer | None]
    inverse: Inverse | None = None
    loading: bool = False  # the calibration that will give it
    prediction: LivePrediction | None = None
    window_s: float = 60.0
    cursors_s: dict[str, float] = field(default_factory=dict)  # "a", "b"
    markers: list[tuple[float, str]] = field(default_factory=list)  # notes at instants of the ring's time
    frozen_s: tuple[float, float] | None = None  # the span, where it does not follow the data
    units: ShownUnits = STORED_UNITS  # of the values as they are shown
    _measured: set[str] = field(default_factory=set)  # extra channels that have had a value
    layout: Callable[[], Layout] = Layout
    _marked: RingBuffer | None = None
    _ranges: dict[str, SteadyRange] = field(default_factory=dict)
    _plots: tuple[Layout, list[str], tuple[Axes, ...]] | None = None

    @property
    def following(self) -> bool:
        return self.frozen_s is None

    def has_data(self) -> bool:
        return not math.isnan(self.now_s())

    def sensors(self) -> int:
        """Return the number of sensors of the board; 0 before its first sample."""
        ring = self.ring()
        return len(sensor_names(ring.names)) if ring is not None else 0

    def quantities(self) -> list[str]:
        """Return what the plots can show; the signals of two sensors before the first sample."""
        names = [f"s{n}_mv" for n in range(1, (self.sensors() or 2) + 1)]
        elongation = [ELONGATION] if self.inverse is not None else []
        return [*names, *elongation, PRESSURE, *self.channels(), *self.differences()]

    def differences(self) -> list[str]:
        """Return the differences of measured and predicted signals, where these are predicted."""
        sensors = self.sensors() if self.prediction is not None else 0
        return [difference_of(f"s{n}_mv") for n in range(1, sensors + 1)]

    def channels(self) -> dict[str, ExtraChannel]:
        """Return the extra channels that have had a value, by column."""
        ring = self.ring()
        found = {channel.column: channel for channel in ring.channels} if ring is not None else {}
        if ring is not None and not found.keys() <= self._measured:
            recent = ring.view(last=RECENT)
            self._measured |= {name for name in found if np.isfinite(recent[name]).any()}
        return {name: channel for name, channel in found.items() if name in self._measured}

    def title(self, quantity: str) -> str:
        channel = self.channels().get(quantity)
        return channel.title if channel is not None else layout_title(quantity)

    def titles(self, quantities: Sequence[str]) -> str:
        return titles(quantities, self.title)

    def unit(self, quantity: str) -> str:
        """Return the unit in which a quantity is stored."""
        channel = self.channels().get(quantity)
        return channel.unit if channel is not None else unit(quantity)

    def text(self, quantity: str, value: float) -> str:
        return in_units(self.units, self.unit(quantity), value, CHANNEL_DECIMALS if quantity in self.channels() else 1)

    def plots(self) -> tuple[Axes, ...]:
        """Return what each plot shows, from the top; kept, because each frame asks several times."""
        layout, quantities = self.layout(), self.quantities()
        if self._plots is None or self._plots[0] is not layout or self._plots[1] != quantities:
            shown = layout.plots(quantities)
            if self._plots is None or self._plots[2] != shown:
                self._ranges.clear()  # else an own axis keeps the range of those that shared it
            self._plots = layout, quantities, shown
        return self._plots[2]

    def now_s(self) -> float:
        """Return the ring's time of the newest sample, s; NaN without one."""
        ring = self.ring()
        return ring.newest_s if ring is not None else math.nan

    def time_of(self, time_us: int) -> float | None:
        """Return the ring's time of an instant of board time; None where the ring does not hold it."""
        ring = self.ring()
        return ring.time_of(time_us) if ring is not None else None

    def notes(self) -> list[tuple[float, str]]:
        """Return the markers; those of a previous connection are forgotten, as its samples are."""
        ring = self.ring()
        if ring is not None and ring is not self._marked:
            if self._marked is not None:
                self.markers.clear()
            self._marked = ring
        return self.markers

    def set_window(self, seconds: float) -> None:
        """Show the last `seconds` (inf: all), following the data."""
        self.window_s, self.frozen_s = seconds, None

    def toggle_freeze(self) -> None:
        """Keep the current span, or follow the data again."""
        self.frozen_s = self.span_s() if self.following else None

    def span_s(self) -> tuple[float, float]:
        """Return the horizontal range, s: from the first sample on until its right edge is reached, then the newest."""
        if self.frozen_s is not None:
            return self.frozen_s
        now = self.now_s()
        if math.isnan(now):
            return 0.0, min(self.window_s, 60.0)
        if math.isinf(self.window_s):
            ring = self.ring()
            first = float(ring.draw(max_points=4)["time_s"][0]) if ring is not None else 0.0
            return first, max(now, first + 1.0)
        return max(0.0, now - self.window_s), max(now, self.window_s)

    def frame(self, width: int) -> PlotFrame | None:
        """Return the frame for `width` pixels; None before the first sample."""
        ring = self.ring()
        if ring is None:
            return None
        low, high = self._shown_s(width)
        most, column_s = max(200, POINTS_A_COLUMN * width), (high - low) / max(width, 1)
        points = ring.draw(low, high, max_points=most, column_s=column_s)
        return self._picture(width, low, high, with_holes(points)) if points["time_s"].size else None

    def past(self, frame: PlotFrame, width: int) -> bool:
        """Return whether a frame is of a frozen span that no sample is added to: what comes is drawn beyond it."""
        drawn = (frame.low_s, frame.high_s)
        return self.frozen_s == drawn and width == frame.width and self.now_s() > frame.high_s

    def newest(self, frame: PlotFrame, width: int) -> PlotFrame | None:
        """Return what was added after `frame`, and the range to show; None where the plot has to be drawn whole."""
        ring, span_s = self.ring(), frame.high_s - frame.low_s
        (low, high), column_s = self._shown_s(width), span_s / max(width, 1)
        if ring is None or width != frame.width or abs(high - low - span_s) > column_s / 2:
            return None
        if not -column_s / 2 <= low - frame.low_s <= span_s / 2:
            return None
        columns = self._since(ring, float(frame.columns["time_s"][-1]), column_s)
        if not columns["time_s"].size or with_holes(columns) is not columns:
            return None
        added = self._picture(width, low, high, columns)
        known = added.elongation is None or frame.elongation is not None
        shown = self._ranges
        inside = (name in shown and shown[name].holds(*ends) for name, ends in self._extremes(added).items())
        return added if known and all(inside) else None

    @staticmethod
    def _since(ring: RingBuffer, since_s: float, column_s: float) -> Columns:
        """Return the samples from an instant on; of many the extremes of each column of pixels."""
        few = ring.newest_s - since_s < _QUICK_SAMPLES * ring.step_s
        return ring.view(since_s) if few else ring.draw(since_s, max_points=4 * _QUICK_SAMPLES, column_s=column_s)

    def _shown_s(self, width: int) -> tuple[float, float]:
        """Return the horizontal range on `width` pixels: while it moves it ends just before a whole column does.

        What is at a round time would else be on the edge of two pixels, and jump between them.
        """
        low, high = self.span_s()
        if not self.following or math.isinf(self.window_s) or low == 0.0:
            return low, high
        column_s = (high - low) / max(width, 1)
        ahead = -(high + column_s / 16) % column_s
        return low + ahead, high + ahead

    def _picture(self, width: int, low_s: float, high_s: float, columns: Columns) -> PlotFrame:
        elongation = self.inverse(signals(columns)).drawn() if self.inverse is not None else None
        predicted = self.prediction(columns[PRESSURE]) if self.prediction is not None else None
        if predicted is not None and predicted[0].shape[1] == len(sensor_names(columns)):
            away = {difference_of(q): columns[q] - predicted[0][:, i] for i, q in enumerate(sensor_names(columns))}
            return PlotFrame(width, low_s, high_s, {**columns, **away}, elongation, predicted)
        return PlotFrame(width, low_s, high_s, columns, elongation)

    def disagreement(self) -> str:
        """Return which link of the chain disagrees over the last moment; "none" where none does, or none is known."""
        means, n = self.means(), round(HEADLINE_S * 100)
        if self.prediction is None or not means:
            return "none"
        return str(self.prediction.disagreement(signals(means)[0], means[PRESSURE], n))

    def frame_interval_ms(self, width: int, cost_ms: float, *, connected: bool) -> int:
        """Return the time between frames, ms: every change is visible, and drawing takes a fixed share of a core."""
        if not connected:
            return REST_MS
        low, high = self.span_s()
        moves_ms = 1000 * PIXELS_A_FRAME * (high - low) / max(width, 1)
        return int(min(_CALM_MS, max(FASTEST_MS, moves_ms, cost_ms / FRAMES_SHARE)))

    def ranges(self, frame: PlotFrame, now_s: float) -> dict[str, tuple[float, float]]:
        """Return the vertical range of each column; constant while the data stay inside."""
        wanted = self._extremes(frame)
        smallest = {"pressure_kpa": 10.0, "elongation_mm": 1.0}
        for name in wanted:
            usual = 10.0 if is_signal(name) else 1.0
            self._ranges.setdefault(name, SteadyRange(smallest=smallest.get(name, usual)))
        return {name: self._ranges[name].update(low, high, now_s) for name, (low, high) in wanted.items()}

    def _extremes(self, frame: PlotFrame) -> dict[str, tuple[float, float]]:
        """Return the least and greatest value of each quantity that is shown; of all, where they share an axis."""
        columns = frame.columns
        found: dict[str, tuple[float, float]] = {}
        for plot in self.plots():
            for names in (plot.left, plot.right):
                shown = [columns[name] for name in names if name in columns]
                if PRESSURE in names:
                    shown.append(columns["target_kpa"])
                if frame.predicted is not None:
                    sensors = enumerate(sensor_names(columns))
                    shown += [frame.predicted[0][:, i] for i, name in sensors if name in names]
                if ELONGATION in names and frame.elongation is not None:
                    shown.append(frame.elongation.mm)
                if shown:
                    found |= dict.fromkeys(names, extremes(*shown))
        return found

    def means(self) -> dict[str, float]:
        """Return the mean of each column over the last moment, for all readouts; empty before the first sample."""
        ring = self.ring()
        recent = ring.view(self.now_s() - HEADLINE_S) if ring is not None and self.has_data() else {}
        return {name: _mean(values) for name, values in recent.items() if values.size}

    def values_at(self, time_s: float) -> dict[str, float]:
        """Return the mean of each column about an instant, or the nearest sample; empty where there are no data."""
        ring = self.ring()
        if ring is None:
            return {}
        found = ring.draw(time_s - HEADLINE_S / 2, time_s + HEADLINE_S / 2)
        if not found["time_s"].size:
            around = ring.draw(time_s - HOLE_S, time_s + HOLE_S)
            nearest = np.abs(around["time_s"] - time_s).argsort()[:1]
            found = {name: values[nearest] for name, values in around.items()}
        if not found["time_s"].size:
            return {}
        means = {name: _mean(values) for name, values in found.items()}
        if self.inverse is not None:
            at = self.inverse(signals(means))
            means |= {"elongation_mm": float(at.mm[0]), "expanded_mm": float(at.expanded_mm[0])}
            means |= {"stand_in": 1.0} if at.stand_in else {}
        return means

    def headline(self, snapshot: SessionSnapshot) -> Headline:
        """Return the measured values, means of the last moment with data; dashes where there were none."""
        means, last = self.means(), snapshot.last
        ageless = snapshot.link is not LinkState.UP and snapshot.health is None
        if not means or last is None or ageless:
            return Headline((), NOTHING, NOTHING, NOTHING, "")
        kpa, mv = self.units.shown("kPa"), self.units.shown("mV")
        pressure, target = (
            number(kpa.value(value), kpa.decimals(1), sign=True) for value in (means["pressure_kpa"], last.target_kpa)
        )
        signals_mv = tuple(number(mv.value(means[name]), mv.decimals(1)) for name in sensor_names(means))
        return Headline(signals_mv, pressure, target, *self._elongation_text(signals(means)))

    def _elongation_text(self, means: FloatArray) -> tuple[str, str, str]:
        """Return the elongation, its band or why there is none, and the same for a narrow window."""
        if self.inverse is None:
            return (NOTHING, "preparing", "preparing") if self.loading else (NOTHING, "", "")
        found = self.inverse(means)
        if not math.isfinite(found.mm[0]):
            return NOTHING, "\u25b2 out of range", "\u25b2 range"
        mm = self.units.shown("mm")
        elongation = number(mm.value(float(found.mm[0])), mm.decimals(2), sign=True)
        u_mm = float(found.expanded_mm[0])
        if not math.isfinite(u_mm):
            return elongation, "U not known", "no U"
        band = f"\u00b1{number(mm.factor * u_mm, mm.decimals(2))}"
        if found.disagree[0]:  # the band does not hold then
            return elongation, "\u25b2 disagree", "\u25b2 differ"
        if found.beyond is not None and found.beyond[0]:
            return elongation, f"{band} at end", f"{band} end"
        if found.stand_in:
            return elongation, f"{band} stated", f"{band} \u25b2"
        return elongation, f"{band} (k = 2)", band

    def place(self, which: str) -> float:
        """Return the place of a new cursor: a third or two thirds of the span."""
        low, high = self.span_s()
        return low + (high - low) * (1 / 3 if which == "a" else 2 / 3)

    def _b_after_a_s(self) -> float:
        """Return the time from cursor A to cursor B, s; NaN without two."""
        return self.cursors_s.get("b", math.nan) - self.cursors_s.get("a", math.nan)

    def difference(self) -> str:
        """Return the time between the cursors as text; empty without two."""
        apart_s = self._b_after_a_s()
        return "" if math.isnan(apart_s) else f"B \u2212 A = {number(apart_s, 3, sign=True)} s"

    def statistics(self) -> list[Span]:
        """Return the statistics of every column between the two cursors; empty without two."""
        apart_s = self._b_after_a_s()
        columns = self._samples(*sorted(self.cursors_s.values())) if not math.isnan(apart_s) else {}
        time_s = columns.get("time_s", np.zeros(0))
        if time_s.size < 2:
            return []
        sign = 1.0 if apart_s >= 0 else -1.0
        names = sensor_names(columns)
        measured: list[tuple[str, str, int, FloatArray]] = [(layout_title(n), "mV", 1, columns[n]) for n in names]
        if self.inverse is not None:
            measured.append(("Elongation", "mm", 3, self.inverse(signals(columns)).mm))
        measured.append(("Pressure", "kPa", 2, columns["pressure_kpa"]))
        measured += [(c.title, c.unit, CHANNEL_DECIMALS + 1, columns[name]) for name, c in self.channels().items()]
        spans = []
        for nth, (title, stored, decimals, values) in enumerate(measured, 1):
            shown = self.units.shown(stored)
            what = (nth if nth <= len(names) else 0, title, as_text(shown.symbol), shown.decimals(decimals))
            spans.append(_span(what, time_s, values * shown.factor + shown.offset, sign))
        return spans

    def _samples(self, low_s: float, high_s: float) -> dict[str, FloatArray]:
        """Return every sample of a span; empty before the first connection."""
        ring = self.ring()
        columns = ring.view(low_s) if ring is not None else {}
        return {name: values[columns["time_s"] <= high_s] for name, values in columns.items()}

    def table(self, frame: PlotFrame | None) -> dict[str, FloatArray]:
        """Return every sample of the span shown, for a CSV."""
        result = self._samples(frame.low_s, frame.high_s) if frame is not None else {}
        if result and self.inverse is not None:
            found = self.inverse(signals(result))
            result |= {"elongation_mm": found.mm, "elongation_expanded_mm": found.expanded_mm}
            if found.beyond is not None:
                result["elongation_beyond"] = found.beyond.astype(np.float64)
            if found.stand_in:
                result["elongation_u_stand_in"] = np.ones(found.mm.size)
        return result


def _mean(values: FloatArray) -> float:
    """Return the mean of the values that are known; nan where none is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def _span(what: tuple[int, str, str, int], time_s: FloatArray, values: FloatArray, sign: float) -> Span:
    """Return the statistics of one column between the cursors; `sign` is -1 where B is before A.

    `what` are the sensor, the name, the unit and the decimals. The difference is that of the means next to the cursors,
    over `HEADLINE_S` or half of the span.
    """
    keep = np.isfinite(values)
    x, y = time_s[keep] - time_s[0], values[keep]
    if y.size < 2:
        return Span(*what, *([math.nan] * 7))
    sd, mean = float(y.std(ddof=1)), float(y.mean())
    centred = x - x.mean()
    slope = float(centred @ (y - mean) / (centred @ centred)) if centred.any() else math.nan
    snr = 20 * math.log10(abs(mean) / sd) if sd > 0 and mean else math.inf
    beside = min(HEADLINE_S, (x[-1] - x[0]) / 2)
    apart = sign * float(y[x >= x[-1] - beside].mean() - y[x <= x[0] + beside].mean())
    return Span(*what, mean, sd, float(y.min()), float(y.max()), slope, snr, apart)


@dataclass(frozen=True, slots=True)
class OverlayModel:
    """The last `CYCLES_KEPT` cycles of the run, each from its own beginning, to be overlaid."""

    ring: Callable[[], RingBuffer | None]
    steps: Callable[[], tuple[StepMark, ...]]
    time_of: Callable[[int], float | None]

    def channels(self) -> dict[str, ExtraChannel]:
        ring = self.ring()
        return {channel.column: channel for channel in ring.channels} if ring is not None else {}

    def cycles(self) -> list[tuple[int, Columns]]:
        """Return number and columns of each cycle, over the time since it began, oldest first."""
        ring, spans = self.ring(), self.spans()[-CYCLES_KEPT:]
        if ring is None:
            return []
        drawn = ((n, begin, ring.draw(begin, end, max_points=CYCLE_POINTS)) for n, begin, end in spans)
        return [(n, columns | {"time_s": columns["time_s"] - begin}) for n, begin, columns in drawn]

    def spans(self) -> list[tuple[int, float, float | None]]:
        """Return (cycle, begin, end) in the ring's time; the end of the current one is None."""
        spans: dict[int, tuple[float, float | None]] = {}
        for step in self.steps():
            begin = self.time_of(step.started_us)
            if step.cycle < 1 or begin is None:
                continue
            end = None if step.ended_us is None else self.time_of(step.ended_us)
            spans[step.cycle] = (spans.get(step.cycle, (begin, None))[0], end)
        return [(number, begin, end) for number, (begin, end) in sorted(spans.items())]
