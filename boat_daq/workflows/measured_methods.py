"""Studies of the methods, with the part of the program that they need: the virtual camera."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.progress import Progress
from boat_daq.engine.simulator.picture import CameraScene, Picture, Renderer

if TYPE_CHECKING:
    from analysis.studies.tradeoff.measure import Method


def tradeoff_methods() -> dict[str, Method]:
    """Return the methods whose time and error can be measured here, by name; the camera's needs OpenCV."""
    from analysis.studies.tradeoff.jobs import METHODS

    camera = {} if importlib.util.find_spec("cv2") is None else {"tracking": camera_tracker()}
    return METHODS | camera


def measure_methods(*, progress: Progress | None = None) -> dict[str, Any]:
    """Measure every method, few settings of each; return what `boat-daq tradeoff --json` prints."""
    from analysis.studies.tradeoff.charts import report_json
    from analysis.studies.tradeoff.measure import measure_all

    methods = list(tradeoff_methods().values())
    return report_json(measure_all(methods, quick=True, progress=progress), quick=True)


def camera_tracker() -> Method:
    """Return the method of the camera's tracker, on pictures of the virtual camera."""
    from analysis.studies.tradeoff.tracking import tracking

    def render(width: int, elongations_mm: Sequence[float]) -> list[Picture]:
        scene = CameraScene(width=width, height=3 * width // 4, px_per_mm=width / 32.0)
        renderer = Renderer(scene)
        return [renderer.frame(n, np.array([x]), n / 30.0) for n, x in enumerate(elongations_mm)]

    return tracking(render)
