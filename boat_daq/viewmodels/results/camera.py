"""What the calibration page shows of a camera's elongation: the continuous record beside the plateaus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analysis.numbers import with_uncertainty
from boat_daq.formatting import count, number
from protocol.base.arrays import FloatArray
from protocol.base.units import NOTHING, in_signal_unit

if TYPE_CHECKING:
    from analysis.figures.pipeline import Analysis
    from analysis.tracking.continuous import CameraFigures, ContinuousCalibration

Row = tuple[tuple[str, str], ...]  # texts with their tooltips


@dataclass(frozen=True, slots=True)
class CameraResult:
    """The continuous record of a run, of each sensor.

    Attributes
    ----------
    loops : elongation and signal less curve, % FSO, of unloading, a NaN, then loading.
    by_speed : speed, mm/s, and distance of the signal from its branch, mV.
    per_cycle : hysteresis over elongation of each of `cycles`, % FSO.
    """

    text: str
    rows: tuple[Row, ...]
    loops: tuple[tuple[FloatArray, FloatArray], ...]
    by_speed: tuple[tuple[FloatArray, FloatArray], ...]
    cycles: FloatArray
    per_cycle: tuple[FloatArray, ...]


def camera_result(found: Analysis) -> CameraResult | None:
    """Return what is shown of a camera; None without one."""
    camera = found.camera
    if camera is None:
        return None
    return CameraResult(
        _text(camera),
        _rows(found, camera.sensors),
        tuple(map(_loop, camera.sensors)),
        tuple((one.by_speed[:, 0], one.by_speed[:, 1]) for one in camera.sensors),
        np.array(camera.cycles, float),
        tuple(np.array(one.per_cycle, float) for one in camera.sensors),
    )


def _text(camera: CameraFigures) -> str:
    record, delay = camera.film.record, camera.film.delay
    lines = [
        f"{int(record.valid.sum())} of {count(record.time_s.size, 'frame')} give an elongation, "
        f"{record.dropped} missing; u {number(1000 * camera.u_mm, 1)} \u00b5m, scale "
        f"{number(100 * camera.film.u_scale, 2)} %"
    ]
    if delay is None:
        return f"{lines[0]}\n\u25b2 The delay of the frames is not known"
    late = with_uncertainty(1000 * delay.delay_s, 1000 * delay.u_s).replace("-", "\u2212")
    lines.append(f"Frames late by {late} ms, corrected")
    return "\n".join(lines)


def _rows(found: Analysis, sensors: Sequence[ContinuousCalibration]) -> tuple[Row, ...]:
    """Return the figures of the continuous record, those of the plateaus in the second line of a cell."""
    plateaus = [sensor.figures for sensor in found.sensors]
    beside = "second line: by the plateaus"

    def row(name: str, unit: str, tip: str, values: Sequence[str], second: Sequence[str] = ()) -> Row:
        cells = (one.void or ("hysteresis" in name and one.hysteresis_void) or tip for one in sensors)
        texts = (f"{a}\n{b}" if b else a for a, b in zip(values, second or [""] * len(values), strict=True))
        return ((f"{name}\n{in_signal_unit(unit, found.recording.signal_unit)}", tip), *zip(texts, cells, strict=True))

    def of_plateaus(key: str, decimals: int) -> list[str]:
        known = [figures.get(key) for figures in plateaus]
        return [number(figure.value, decimals) if figure is not None else NOTHING for figure in known]

    r2 = [number(s.calibration.r2, 5) if s.calibration is not None else NOTHING for s in found.sensors]
    hysteresis, sensitivity = of_plateaus("sensor_hysteresis_percent_fso", 2), of_plateaus("sensitivity_mv_per_mm", 2)
    return (
        row(
            "Sensitivity", "mV/mm", f"end points of the continuous record; {beside}",
            [number(one.sensitivity_mv_per_mm, 2) for one in sensors], sensitivity,
        ),
        row(
            "Sensor hysteresis", "% FSO", f"largest distance of the branches, signal over elongation; {beside}",
            [number(one.hysteresis_percent_fso, 2) for one in sensors], hysteresis,
        ),
        row("R\u00b2", "all samples", f"of the curve over all samples; {beside}",
            [number(one.r2, 5) for one in sensors], r2),
        row("Curve", "% FSO", "largest distance of the continuous curve from the plateaus' curve, the calibration",
            [number(one.apart_percent_fso, 3) for one in sensors]),
        row("Dynamic error", "mV per mm/s", "change of the signal with speed on one branch, with standard uncertainty",
            [with_uncertainty(one.dynamic_mv_per_mm_per_s, one.u_dynamic) for one in sensors]),
    )  # fmt: skip


def _loop(one: ContinuousCalibration) -> tuple[FloatArray, FloatArray]:
    """Return elongation and signal less curve, % FSO, of unloading, a NaN, then loading."""
    if one.calibration is None:
        return np.zeros(0), np.zeros(0)
    apart = 100.0 / one.calibration.full_scale * (one.loop_mv - one.calibration.predict(one.loop_mm))
    joined = (np.concatenate([part[0], [np.nan], part[1]]) for part in (one.loop_mm, apart))
    x, y = joined
    keep = np.isfinite(y)
    keep[one.loop_mm.shape[1]] = True
    return x[keep], y[keep]
