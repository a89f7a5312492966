"""An analysis as the pages show it: plain arrays and texts, made by a helper process."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from analysis.arrays import BoolArray, FloatArray
from analysis.figures.figure import SENSOR_FIGURES, Figure
from analysis.warning import Warning
from boat_daq.viewmodels.common.formatting import NOTHING, number

Band = tuple[FloatArray, FloatArray]


class FigureText(NamedTuple):
    """One cell of the table of figures: its text and its tooltip."""

    text: str
    tip: str


@dataclass(frozen=True, slots=True)
class FigureRow:
    """One figure for every sensor; its name has its unit."""

    name: str
    cells: tuple[FigureText, ...]


def figure_text(figure: Figure | None, decimals: int) -> FigureText:
    """Return a figure as text, with definition, interval and count as its tooltip; an en dash without a figure."""
    if figure is None:
        return FigureText(NOTHING, "not computed for this run")
    lines = [figure.definition] if figure.definition else []
    if math.isfinite(figure.low) and math.isfinite(figure.high):
        lines.append(f"95 %: {number(figure.low, decimals)} to {number(figure.high, decimals)} {figure.unit}")
    if figure.n:
        lines.append(f"n = {figure.n}")
    lines += [part for part in (figure.void, figure.note) if part]
    return FigureText(number(figure.value, decimals), "\n".join(lines))


def figure_rows(sensors: Sequence[Mapping[str, Figure]]) -> tuple[FigureRow, ...]:
    """Return the table of figures of all sensors, without figures that no sensor has."""
    return tuple(
        FigureRow(d.label_with_unit, tuple(figure_text(figures.get(d.key), d.decimals) for figures in sensors))
        for d in SENSOR_FIGURES.values()
        if any(d.key in figures for figures in sensors)
    )


@dataclass(frozen=True, slots=True)
class LoopSet:
    """The loops of a run: [2 branches, cycles, levels], signals [sensors, 2, cycles, levels]."""

    numbers: tuple[int, ...]
    pressure_kpa: FloatArray
    elongation_mm: FloatArray | None
    signal_mv: FloatArray

    def closed(self, abscissa: FloatArray, ordinate: FloatArray, cycle: int) -> tuple[FloatArray, FloatArray]:
        """Return one cycle as a closed line: down the unloading branch, back up the loading one."""
        x = np.concatenate([abscissa[0, cycle][::-1], abscissa[1, cycle]])
        y = np.concatenate([ordinate[0, cycle][::-1], ordinate[1, cycle]])
        keep = np.isfinite(x) & np.isfinite(y)
        return x[keep], y[keep]

    def broken(self, abscissa: FloatArray, ordinate: FloatArray, cycles: range) -> tuple[FloatArray, FloatArray]:
        """Return several cycles as one line with a NaN between them, so that one curve draws them all.

        Parameters
        ----------
        abscissa, ordinate : [2 branches, cycles, levels].
        cycles : numbers along the second axis.
        """
        parts = [np.pad(self.closed(abscissa, ordinate, k), ((0, 0), (0, 1)), constant_values=np.nan) for k in cycles]
        x, y = np.concatenate(parts, axis=1) if parts else np.zeros((2, 0))
        return x, y


@dataclass(frozen=True, slots=True)
class CycleSeries:
    """A sensor's figures cycle by cycle, [cycles]: hysteresis over pressure % FSO, SNR dB, end-to-end sensitivity.

    The sensitivity is in mV/mm where the elongation was read in every cycle, else in mV/kPa.
    """

    hysteresis_percent_fso: FloatArray
    snr_db: FloatArray
    sensitivity: FloatArray
    sensitivity_unit: str
    warm_up: int


@dataclass(frozen=True, slots=True)
class SensorResult:
    """One sensor: its points, its curve with the 68 % and 95 % bands of the fit, and what acceptance stores."""

    label: str
    void: str
    cycles: CycleSeries
    x: FloatArray
    y: FloatArray
    residuals: FloatArray
    loading: BoolArray
    grid: FloatArray
    curve: FloatArray
    band_68: Band
    band_95: Band
    content: Mapping[str, Any] | None
    out_of_tolerance: tuple[Warning, ...] = ()


@dataclass(frozen=True, slots=True)
class BreakResult:
    """An interruption of a run that was resumed: between which cycles, as a sentence, and the tests across it.

    A row has quantity, mean before, mean after, p of t, p of F, as text.
    """

    at_cycle: float
    sentence: str
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class RunResult:
    """All that a page shows of one run; of its `plateaus`, `read` have an elongation."""

    path: str
    unit: str
    simulated: bool
    duration_s: float
    cycles: int
    partial: int
    sensors: tuple[SensorResult, ...]
    figures: tuple[FigureRow, ...]
    loops: LoopSet
    warnings: tuple[Warning, ...]
    reading_sd_mm: float
    breaks: tuple[BreakResult, ...] = ()
    plateaus: int = 0
    read: int = 0

    @property
    def calibrated(self) -> bool:
        """Whether every sensor has a calibration."""
        return bool(self.sensors) and all(sensor.content is not None for sensor in self.sensors)


@dataclass(frozen=True, slots=True)
class PosteriorResult:
    """The posterior of one sensor on a grid of elongations: its mean curve, and the bands that belong to it."""

    grid: FloatArray
    mean: FloatArray
    curve_68: Band
    curve_95: Band
    new_reading_95: Band
    content: Mapping[str, Any]

    @property
    def verdict(self) -> str:
        """Whether it converged, as text."""
        verdict = "converged" if self.content["converged"] else "NOT CONVERGED"
        return f"{verdict}, {self.content['n_eff']:.0f} independent samples"
