"""Detected light over elongation, traced once for an actuator and then kept.

It falls in steps, where rays pass from one cavity's wall to the next: intervals are halved, their neighbours too, until
the light in the middle is that between their ends, and once more. Light with a loss, as a share of that without, hardly
jumps: it is traced at the first elongations, and interpolated between.

The table of the default actuator, with its cavities in the outer face, comes with the program (`light.csv`); others are
kept in the user's cache. Work that was stopped continues from what is kept.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from analysis.optics.scene.parameters import PAPER_OPTIMUM, Face, Waveguide, light_by
from analysis.optics.sweep.sweep import SweepRequest, run_sweep
from analysis.progress import Progress
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.guides import both_guides
from analysis.shadow.model.table import cache_folder, keep_arrays, load_arrays
from analysis.version import program_version
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import RequestError

LOSSES_DB_PER_CM = (0.0, 0.5, 1.0)
"""Bounds and nodes of the guide's loss: clear printed resins have 0.1 to 1 dB/cm in the near infrared."""
_PRESSURES_KPA = (-40.0, 50.0)
_SHAPES = 91  # solved, over the pressures
FIRST = 105  # elongations, before the refinement
_STATES = 15  # of one sweep
_MOST = 1500
_TOLERANCE = 1e-3  # of the light's range, in the middle of an interval; one that fails it and its neighbours are split
LEAST_RAYS = 10.0  # that the middle must be off by: fewer are the chance of a fan
NARROWEST_MM = 5e-4
_RAYS = 20_000
_ARRAYS = ("losses_db_per_cm", "elongation_mm", "light_percent")
_PART = ("loss_db_per_cm", "elongation_mm", "light_percent")


@dataclass(frozen=True, slots=True)
class LightTable:
    """Detected light over elongation: percent of the emitted [losses, n] at elongations [n], mm."""

    losses_db_per_cm: FloatArray
    elongation_mm: FloatArray
    light_percent: FloatArray

    def light(self, elongation_mm: FloatArray, loss_db_per_cm: float) -> FloatArray:
        """Return the light [n] at elongations [n]; a parabola in the loss, through the logarithms."""
        rows = [np.log(np.interp(elongation_mm, self.elongation_mm, row)) for row in self.light_percent]
        a, b, c = self.losses_db_per_cm
        at = loss_db_per_cm
        weights = (
            (at - b) * (at - c) / ((a - b) * (a - c)),
            (at - a) * (at - c) / ((b - a) * (b - c)),
            (at - a) * (at - b) / ((c - a) * (c - b)),
        )
        return np.asarray(np.exp(sum(w * row for w, row in zip(weights, rows, strict=True))))


@lru_cache(maxsize=1)
def stored_light() -> LightTable:
    """Return the light of the paper's pattern in the default guide and actuator, as it comes with the program."""
    text = (resources.files("analysis.signal_prediction") / "light.csv").read_text(encoding="utf-8")
    rows = np.asarray([[float(v) for v in line.split(",")] for line in text.splitlines() if line[:1] not in "#e"])
    return LightTable(np.asarray(LOSSES_DB_PER_CM), rows[:, 0], np.ascontiguousarray(rows[:, 1:].T))


def light_of(
    actuator: ActuatorParameters,
    face: Face = "outer",
    *,
    build: bool = True,
    progress: Progress | None = None,
    folder: Path | None = None,
) -> LightTable | None:
    """Return an actuator's table: the program's, the kept one, or a new one; None where it is not to be traced."""
    if actuator == ActuatorParameters() and face == "outer":
        return stored_light()
    path = (folder or cache_folder()) / f"light_{_digest(actuator, face)}.npz"
    kept = load_arrays(path, _ARRAYS)
    if kept is not None:
        return LightTable(**kept)
    if not build:
        return None
    table = build_light(GuideShapes(actuator), face, progress=progress, part=path.with_suffix(".part.npz"))
    keep_arrays(path, {name: getattr(table, name) for name in _ARRAYS})
    path.with_suffix(".part.npz").unlink(missing_ok=True)
    return table


def _digest(actuator: ActuatorParameters, face: Face) -> str:
    """Return the hash of all that a table depends on."""
    design = asdict(replace(PAPER_OPTIMUM, face=face))
    chosen = _PRESSURES_KPA, _SHAPES, FIRST, _TOLERANCE, LEAST_RAYS, _RAYS
    content = [asdict(actuator), design, *chosen, program_version()]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]


class GuideShapes:
    """The tracked points of both guides over elongation: solved at even pressures, and a spline between."""

    def __init__(self, actuator: ActuatorParameters, shapes: int = _SHAPES) -> None:
        full, solved = FullModel(actuator), list[Solution]()
        for kpa in np.linspace(*_PRESSURES_KPA, shapes).tolist():
            solved.append(full.solve(pressure_kpa=kpa, start=solved[-1] if solved else None))
        curves = [both_guides(full.guides.tracked.positions(one.displacement_mm)) for one in solved]
        x = np.asarray([one.elongation_mm for one in solved])
        if not (np.diff(x) > 0).all():
            cause = "this actuator does not lengthen with every step of pressure"
            raise RequestError(cause, "check its parameters: walls and neck")
        self.range_mm = float(x[0]), float(x[-1])
        self.at = CubicSpline(x, np.asarray(curves))


def traced_light(
    shapes: GuideShapes, elongation_mm: FloatArray, loss_db_per_cm: float, face: Face = "outer", rays: int = _RAYS
) -> FloatArray:
    """Return the light of the paper's pattern [n], percent of the emitted. `elongation_mm`: [n], at most `_STATES`."""
    at = np.concatenate([elongation_mm, np.repeat(elongation_mm[-1:], _STATES - len(elongation_mm))])
    design, guide = replace(PAPER_OPTIMUM, face=face), Waveguide(attenuation_db_per_cm=loss_db_per_cm)
    request = SweepRequest((design,), guide, light_by("power", rays), np.asarray(shapes.at(at)), "power")
    return np.asarray(100.0 * run_sweep(request).power[0, : len(elongation_mm)])


def build_light(
    shapes: GuideShapes,
    face: Face = "outer",
    *,
    progress: Progress | None = None,
    part: Path | None = None,
) -> LightTable:
    """Trace a table: first elongations and their refinement, losses at the first ones."""
    kept = load_arrays(part, _PART) if part is not None else None
    known: dict[tuple[float, float], float] = {}  # by loss and elongation
    if kept is not None:
        losses, places, lights = (kept[name].tolist() for name in _PART)
        known = dict(zip(zip(losses, places, strict=True), lights, strict=True))

    def light_at(elongation_mm: FloatArray, loss: float = 0.0, *, more: int = 0) -> FloatArray:
        """Return the light, traced where it is not known; `more` is left to trace after it."""
        wanted = elongation_mm.tolist()
        todo = np.asarray([mm for mm in wanted if (loss, mm) not in known])
        for at in range(0, len(todo), _STATES):
            some = todo[at : at + _STATES]
            traced = traced_light(shapes, some, loss, face)
            known.update({(loss, mm): light for mm, light in zip(some.tolist(), traced.tolist(), strict=True)})
            if part is not None:
                rows = np.asarray([(*at, light) for at, light in known.items()])
                keep_arrays(part, dict(zip(_PART, rows.T, strict=True)))
            if progress is not None:
                progress(len(known), len(known) + len(todo) - at - len(some) + more)
        return np.asarray([known[loss, mm] for mm in wanted])

    x = coarse = np.linspace(*shapes.range_mm, FIRST)
    others, suspect = LOSSES_DB_PER_CM[1:], np.ones(FIRST - 1, dtype=bool)
    while True:
        light = light_at(x, more=len(x) + len(others) * len(coarse))
        if not suspect.any() or len(x) >= _MOST:
            break
        off_percent = max(_TOLERANCE * float(np.ptp(light)), 100.0 * LEAST_RAYS / _RAYS)
        middle = 0.5 * (x[:-1] + x[1:])[suspect]
        between = 0.5 * (light[:-1] + light[1:])[suspect]
        away = light_at(middle, more=len(x) + len(middle) + len(others) * len(coarse)) - between
        x, suspect = _halved(x, middle, suspect, np.abs(away) > off_percent)
    x = np.sort(np.concatenate([x, 0.5 * (x[:-1] + x[1:])]))
    rows = [light := light_at(x, more=len(others) * len(coarse))]
    for n, loss in enumerate(others, 1):
        share = light_at(coarse, loss, more=(len(others) - n) * len(coarse)) / light_at(coarse)
        rows.append(light * np.exp(np.interp(x, coarse, np.log(share))))
    return LightTable(np.asarray(LOSSES_DB_PER_CM), x, np.stack(rows))


def _halved(x: FloatArray, middle: FloatArray, suspect: BoolArray, away: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the elongations [n] with the middles of the suspect intervals, and which intervals are suspect then."""
    split = np.zeros(len(x) - 1, dtype=bool)
    split[np.flatnonzero(suspect)[away]] = True
    split = split | np.concatenate([split[1:], [False]]) | np.concatenate([[False], split[:-1]])
    finer = np.sort(np.concatenate([x, middle]))
    inside = np.searchsorted(x, 0.5 * (finer[:-1] + finer[1:])) - 1  # the interval that each new one lies in
    return finer, split[inside] & (np.diff(finer) > 2.0 * NARROWEST_MM)


def light_csv(table: LightTable) -> str:
    """Return a table as the text of `light.csv`."""
    head = "# SIMULATED: detected light of the paper's pattern over elongation, percent of the emitted, by light_csv"
    names = [f"light_percent_at_{loss:g}_db_per_cm" if loss else "light_percent" for loss in table.losses_db_per_cm]
    rows = np.column_stack([table.elongation_mm, table.light_percent.T])
    lines = [",".join([f"{row[0]:.6f}", *(f"{value:.7g}" for value in row[1:])]) for row in rows.tolist()]
    return "\n".join([head, ",".join(["elongation_mm", *names]), *lines]) + "\n"
