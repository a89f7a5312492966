"""Studies of the methods, with the parts of the program that they need: the live plot's store, the virtual camera."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.progress import Progress
from boat_daq.engine.display.ring_buffer import MinMaxPyramid, fold_columns
from boat_daq.engine.simulator.picture import CameraScene, Picture, Renderer
from protocol.base.arrays import FloatArray

if TYPE_CHECKING:
    from analysis.studies.tradeoff.decimation import Curve, Paint
    from analysis.studies.tradeoff.measure import Method


def tradeoff_methods(paint: Paint | None = None) -> dict[str, Method]:
    """Return the methods whose time and error can be measured here, by name; the camera's needs OpenCV.

    `paint`: paints a curve of the live plot; without it the curve is fetched only.
    """
    from analysis.studies.tradeoff.methods import METHODS

    camera = {} if importlib.util.find_spec("cv2") is None else {"tracking": camera_tracker()}
    return METHODS | {"decimation": live_plot(paint)} | camera


def measure_methods(paint: Paint | None = None, *, progress: Progress | None = None) -> dict[str, Any]:
    """Measure every method, few settings of each; return what `boat-daq tradeoff --json` prints."""
    from analysis.studies.tradeoff.charts import report_json
    from analysis.studies.tradeoff.measure import measure_all

    methods = list(tradeoff_methods(paint).values())
    return report_json(measure_all(methods, quick=True, progress=progress), quick=True)


def live_plot(paint: Paint | None = None) -> Method:
    """Return the method of the live plot, with the time of `paint` where it is given."""
    from analysis.studies.tradeoff.decimation import decimation

    return decimation(_stored, paint)


def _stored(record: FloatArray) -> Curve:
    from analysis.studies.tradeoff.decimation import WIDTH_PX

    pyramid = MinMaxPyramid(*record.shape)
    pyramid.append(record)
    return lambda end_s, points: fold_columns(pyramid.draw(0.0, end_s, points), end_s / WIDTH_PX)


def camera_tracker() -> Method:
    """Return the method of the camera's tracker, on pictures of the virtual camera."""
    from analysis.studies.tradeoff.tracking import tracking

    def render(width: int, elongations_mm: Sequence[float]) -> list[Picture]:
        scene = CameraScene(width=width, height=3 * width // 4, px_per_mm=width / 32.0)
        renderer = Renderer(scene)
        return [renderer.frame(n, np.array([x]), n / 30.0) for n, x in enumerate(elongations_mm)]

    return tracking(render)
