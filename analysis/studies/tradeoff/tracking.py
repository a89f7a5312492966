"""The camera's tracker: ways to find the marks, and resolutions, against the elongation that was rendered.

The pictures are those of the virtual camera with its default noise, drawn by the caller: the analysis knows no camera.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import count

import numpy as np

from analysis.studies.tradeoff.measure import Method, Setting
from analysis.tracking.lens import Picture
from analysis.tracking.marks import BASE, TIP, find_marks, project
from analysis.tracking.tracker import LEARNED_PICTURES, MarkTracker, Optics, learn_plane, similarity, square
from protocol.base.arrays import FloatArray
from protocol.base.optional import optional

MARK_MM = 8.0
WIDTHS_PX = (160, 320, 640, 1280)
USED = "edges, 640 px"
TRAVEL_MM = (*np.linspace(0.0, 1.8, 31).tolist(), *np.linspace(1.74, 0.06, 29).tolist())  # as fast as a ramp moves it
_RATE_HZ = 30.0
Render = Callable[[int, Sequence[float]], Sequence[Picture]]
Read = Callable[[Picture], float]
Begin = Callable[[Sequence[Picture]], Read]


def tracking(render: Render) -> Method:
    """Return the method that measures the tracker.

    `render`: returns pictures of so many pixels across with these elongations, mm; marks of `MARK_MM`, 32 mm across.
    """
    return Method(
        "tracking", "Camera: tracker and resolution", "the elongation that the virtual camera rendered", True,
        "a reading of the elongation", 0.01, "mm", "a picture", lambda level: USED, partial(_settings, render=render),
        kept=": it reads a view four times as wide as this one of 32 mm as exactly as 160 px read this one",
    )  # fmt: skip


def _settings(quick: bool, render: Render) -> list[Setting]:
    widths = WIDTHS_PX[1:3] if quick else WIDTHS_PX
    settings = [_setting(f"edges, {width} px", _edges, render, width) for width in widths]
    for name, refine in (("detector", False), ("corners", True)):
        settings.append(_setting(f"{name}, 640 px", partial(_corners, refine=refine), render, 640))
    return settings


def _setting(name: str, begin: Begin, render: Render, width: int) -> Setting:
    @cache
    def prepared() -> tuple[Read, Sequence[Picture]]:
        pictures = render(width, [0.0] * LEARNED_PICTURES + list(TRAVEL_MM))
        return begin(pictures[:LEARNED_PICTURES]), pictures[LEARNED_PICTURES:]

    def call(_: int) -> list[float]:
        read, pictures = prepared()
        return [read(picture) for picture in pictures]

    def error(found: list[float]) -> float:
        return float(np.sqrt(np.mean((np.array(found) - TRAVEL_MM) ** 2)))

    return Setting(name, call, error, work=len(TRAVEL_MM))


def _edges(first: Sequence[Picture]) -> Read:
    """Return the tracker that the program uses, its plane learned."""
    tracker, times = MarkTracker(Optics(MARK_MM)), (number / _RATE_HZ for number in count())
    for picture in first:
        tracker.read(picture, next(times))
    return lambda picture: tracker.read(picture, next(times)).elongation_mm


def _corners(first: Sequence[Picture], *, refine: bool) -> Read:
    """Return a tracker by the detector's corners, refined by OpenCV or not, with the same plane and axis."""
    cv2 = optional("cv2")
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.001)

    def found(picture: Picture) -> tuple[FloatArray, FloatArray]:
        marks = find_marks(picture)
        quads = [marks[n][0] for n in (BASE, TIP)]
        if refine:
            near = [np.ascontiguousarray(quad, np.float32).reshape(-1, 1, 2) for quad in quads]
            quads = [np.asarray(cv2.cornerSubPix(picture, q, (5, 5), (-1, -1), criteria), float)[:, 0] for q in near]
        return quads[0], quads[1]

    learned = np.array([found(picture) for picture in first])
    plane = learn_plane(learned[:, 0], learned[:, 1], MARK_MM, Optics(MARK_MM))

    def read(picture: Picture) -> float:
        base, tip = found(picture)
        back, shift, _ = similarity(project(plane.to_mm, base), square(MARK_MM))
        middle = complex((project(plane.to_mm, tip) @ np.array([1.0, 1.0j])).mean()) * back + shift
        return float((np.array([middle.real, middle.imag]) - plane.tip_mm) @ plane.axis)

    return read
