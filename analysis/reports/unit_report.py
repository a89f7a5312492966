"""The report of a unit over time: its curves over each other, b1 and U over dates, En, and when it is due again."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

from analysis import figure_style as style
from analysis.history.between_runs import UnitComparison
from analysis.history.unit_history import UnitHistory, due_first, time_of
from analysis.numbers import rounded, with_uncertainty
from analysis.progress import Progress
from analysis.reports.document import Report, ReportDrawing, ReportTable, Section, date_of
from analysis.reports.html import write_html
from analysis.reports.pdf import write_pdf
from analysis.reports.shown_units import in_units
from analysis.version import program_version
from protocol.base.arrays import FloatArray
from protocol.base.errors import ChoiceError, writing
from protocol.base.units import NOTHING, STORED_UNITS

WRITERS = {".html": write_html, ".pdf": write_pdf}
MARGIN_DAYS = 0.08  # of the span, on either side of the dates
MOST_NAMED = 8  # curves of a legend


def write_unit_report(
    unit: str, histories: Sequence[UnitHistory], path: str | Path, *, simulated: bool, progress: Progress | None = None
) -> Report:
    """Write the history of a unit as .html or .pdf; raises BoatDaqError for another ending, or a refused file."""
    return write_built(partial(unit_report, unit, histories, simulated=simulated), Path(path), progress)


def write_built(build: Callable[[], Report], path: Path, progress: Progress | None) -> Report:
    """Write the report that `build` returns as .html or .pdf; raises BoatDaqError before if that cannot be."""
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise ChoiceError(f"{path.name} ends in neither .html nor .pdf", "Choose one of the two.")
    with writing(path):
        path.parent.stat()  # a folder that does not exist is reported before the pages are set
        report = build()
        writer(report, path, progress)
    return report


def unit_report(unit: str, histories: Sequence[UnitHistory], *, simulated: bool) -> Report:
    """Return the report of a unit over time; parameters as `write_unit_report`."""
    last, due = histories[0], due_first(histories)
    calibrations = f"{len(last.when)} calibration{'s' if len(last.when) > 1 else ''}"
    sentence = due.sentence
    verdict = f"{calibrations}; {sentence}."
    facts = (
        ("Unit", unit),
        ("Calibrations", str(len(last.when))),
        ("First", date_of(last.when[0])),
        ("Last", date_of(last.when[-1])),
        ("Due again", due.due_utc[:10] or NOTHING),
        ("Check point", f"{last.check_point_mm:g} mm"),
    )
    sections = [_sensor(history, number) for number, history in enumerate(histories, 1)]
    footer = f"boat-daq {program_version()}"
    found = Report("Unit over time", unit, simulated, verdict, facts, (*sections, _method()), footer, last.when[-1])
    return in_units(found, STORED_UNITS.of_signals_in(last.signal_unit))


def _sensor(history: UnitHistory, number: int) -> Section:
    curves = ReportDrawing(
        (partial(_curves, history), partial(_differences, history)),
        "Left: the curve of each calibration, the last in bold. Right: difference from the first, over both.",
    )
    over_dates = ReportDrawing(
        (partial(_coefficient, history, number - 1), partial(_uncertainty, history, number - 1)),
        "Left: the coefficient b1 with its expanded uncertainty (k = 2). Right: U of an elongation at the check point.",
        2.4,
    )
    return Section(f"Sensor {number}", (curves, over_dates, *history_tables(history, number)))


def history_of_unit(unit: UnitComparison) -> list[Section]:
    """Return the section on a unit's calibrations over time; none where it was calibrated once."""
    parts = [part for number, one in enumerate(unit.histories, 1) for part in history_tables(one, number)]
    return [Section(f"History of {unit.unit or 'the unit'}", tuple(parts))] if parts else []


def history_tables(history: UnitHistory, number: int) -> tuple[ReportTable | str, ...]:
    """Return the calibrations as a table, and the proposed interval; `number` from 1."""
    columns = (history.value_mv, history.expanded_mv, history.expanded_mm, history.en)
    rows = []
    for k, (when, value, expanded, mm, en) in enumerate(zip(history.when, *columns, strict=True)):
        b1, u = ((part[k, 1] if part.shape[1] > 1 else np.nan) for part in (history.coefficients, history.std_errors))
        rows.append((
            date_of(when), with_uncertainty(float(b1), 2.0 * float(u)) if np.isfinite(b1) else NOTHING,
            with_uncertainty(float(value), float(expanded)), f"{mm:.3f}" if np.isfinite(mm) else NOTHING,
            rounded(float(en), 0.1) if np.isfinite(en) else NOTHING, _finding(float(en), k in history.out_of_control),
        ))  # fmt: skip
    limits = ""
    if len(history.when) > 1:
        limits = f", control limits {_value(history, history.lower_mv)} to {_value(history, history.upper_mv)} mV"
    caption = (
        f"Sensor {number} at x = {history.check_point_mm:g} mm: mean {_value(history, history.centre_mv)} mV{limits}; "
        "U with k = 2; |En| above 1 is disagreement."
    )
    header = ("calibrated", "b1 ± U, mV/mm", "y(x0) ± U, mV", "U at x0, mm", "En", "finding")
    sentence = history.interval.sentence
    return ReportTable(header, tuple(rows), caption), f"{sentence[0].upper()}{sentence[1:]}."


def _value(history: UnitHistory, value: float) -> str:
    return rounded(value, float(np.nanmin(history.expanded_mv)) / 2.0)


def _finding(en: float, outside: bool) -> str:
    found = {"outside the control limits": outside, "differs from the one before": abs(en) > 1}
    return ", ".join(text for text, holds in found.items() if holds) or NOTHING


def _method() -> Section:
    text = (
        "The proposal follows ILAC-G24 (method 2, control chart): a line through the check point's error over time, "
        "weighted by its uncertainty. The interval ends where the drift since the last calibration, with its expanded "
        "uncertainty, would reach the permissible drift: U of an elongation unless another is given. It is at most "
        "twice the time that the calibrations cover. The owner of the unit decides on the interval."
    )
    return Section("How the interval is proposed", (text,))


def _colours(count: int) -> list[tuple[float, float, float, float]]:
    return [colormaps[style.CYCLES](0.85 * k / max(count - 1, 1)) for k in range(count)]


def _curves(history: UnitHistory, ax: Axes) -> None:
    last = len(history.curves) - 1
    for k, (curve, colour) in enumerate(zip(history.curves, _colours(last + 1), strict=True)):
        label = date_of(history.when[k])[:10] if last < MOST_NAMED or k in (0, last) else None
        ax.plot(curve[:, 0], curve[:, 1], color=colour, linewidth=2.0 if k == last else 1.0, label=label)
    ax.set(xlabel="elongation, mm", ylabel="signal, mV", title="Curves overlaid")
    ax.legend()


def _differences(history: UnitHistory, ax: Axes) -> None:
    """Each curve less the first, where both are."""
    for (x, y), colour in zip(curve_differences(history), _colours(len(history.curves)), strict=True):
        ax.plot(x, y, color=colour)
    ax.axvline(history.check_point_mm, color=style.SOFT, linewidth=0.7, linestyle=":")
    ax.set(xlabel="elongation, mm", ylabel="difference, mV", title="Difference from the first calibration")


def curve_differences(history: UnitHistory) -> list[tuple[FloatArray, FloatArray]]:
    """Return x and the difference of each curve from the first one, over the range of both."""
    first = history.curves[0]
    found = []
    for curve in history.curves:
        both = (curve[:, 0] >= first[0, 0]) & (curve[:, 0] <= first[-1, 0])
        found.append((curve[both, 0], curve[both, 1] - np.interp(curve[both, 0], first[:, 0], first[:, 1])))
    return found


def _coefficient(history: UnitHistory, sensor: int, ax: Axes) -> None:
    """The coefficient b1 of every calibration with its expanded uncertainty, over dates."""
    if history.coefficients.shape[1] > 1:
        _over_dates(history, history.coefficients[:, 1], ax, sensor, reach=2.0 * history.std_errors[:, 1])
    ax.set(ylabel="b1, mV/mm", title="Coefficient b1")


def _uncertainty(history: UnitHistory, sensor: int, ax: Axes) -> None:
    """U of an elongation at the check point of every calibration, over dates."""
    _over_dates(history, history.expanded_mm, ax, sensor)
    if np.isfinite(history.expanded_mm).any():
        ax.set_ylim(0.0, 1.25 * float(np.nanmax(history.expanded_mm)))
    ax.set(ylabel="U, mm", title=f"Uncertainty at {history.check_point_mm:g} mm, k = 2")


def _over_dates(
    history: UnitHistory, values: FloatArray, ax: Axes, sensor: int, reach: FloatArray | None = None
) -> None:
    times = [time_of(when) for when in history.when]
    known = [k for k, time in enumerate(times) if time is not None and np.isfinite(values[k])]
    if not known:
        return
    dates = [time for k in known if (time := times[k]) is not None]
    error = None if reach is None else reach[known]
    ax.errorbar(dates, values[known], yerr=error, fmt="o-", color=style.sensor_colour(sensor), capsize=2)  # type: ignore[arg-type]
    margin = max((dates[-1] - dates[0]) * MARGIN_DAYS, datetime.timedelta(hours=12))
    ax.set_xlim(dates[0] - margin, dates[-1] + margin)  # type: ignore[arg-type]
    locator = AutoDateLocator(minticks=2, maxticks=5)  # type: ignore[no-untyped-call]
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    ax.set_xlabel("date, UTC")
