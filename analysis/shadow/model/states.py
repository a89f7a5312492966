"""The fifteen states of the two guides that the optical model starts from, the most compressed first.

Coordinates are (x, z) in mm, z along the actuator from the base; guide 1 is at x > 0. The files are CSV with one row a
point, or NPZ with the array `curves_mm` [15][2][n][2].
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.guides import both_guides
from analysis.shadow.model.table import cache_folder, keep_arrays, load_arrays, write_arrays
from analysis.version import program_version
from protocol.base.arrays import FloatArray
from protocol.base.errors import ChoiceError, RequestError, writing
from protocol.base.whole_file import write_whole

_FORMAT = 1
_STEPS = 7
_LOWEST_KPA = -40.0
_ARRAYS = ("curves_mm", "pressure_kpa", "elongation_mm")
PAPER_LOWEST_KPA = -50.0
STIFFER_WALL = ActuatorParameters(wall_mm=2.4, wall_modulus_kpa=1253.559, neck_radius_mm=4.09375)
"""The paper simulated -50 to +50 kPa. The default wall of 2.2 mm buckles at -43.3 kPa; one of 2.4 mm, fitted to the
same elongations, at -54.4 kPa."""
HEADER = "state,guide,point,x_mm,z_mm,pressure_kpa,elongation_mm"


@dataclass(frozen=True, slots=True)
class GuideStates:
    """The fifteen states."""

    curves_mm: FloatArray  # shape (15, 2, n, 2), (x, z)
    pressure_kpa: FloatArray  # with elongation_mm: shape (15,)
    elongation_mm: FloatArray
    parameters: str  # hash of the actuator's parameters

    @property
    def arrays(self) -> dict[str, Any]:
        """Return the arrays by their names in a file."""
        return {name: getattr(self, name) for name in _ARRAYS}

    def bow_mm(self) -> FloatArray:
        """Return half the greatest distance of the guides in each state, shape (15,)."""
        return np.asarray(np.ptp(self.curves_mm[..., 0], axis=(1, 2)) / 2.0)

    def curvature_per_mm(self) -> FloatArray:
        """Return the curvature in the middle of guide 1 in each state, 1/mm, by a circle through ends and middle."""
        a, c = self.curves_mm[:, 0, 0], self.curves_mm[:, 0, -1]
        b = self.curves_mm[:, 0, self.curves_mm.shape[2] // 2]
        u, v = b - a, c - a
        twice_area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        sides = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1) * np.linalg.norm(c - b, axis=1)
        return np.asarray(2.0 * twice_area / sides)


def guide_states(model: FullModel | None = None, *, lowest_kpa: float = _LOWEST_KPA) -> GuideStates:
    """Solve the fifteen states, up to +50 kPa."""
    if not lowest_kpa < 0.0:
        raise RequestError(f"{lowest_kpa:g} kPa is not a compression", "give a lowest pressure below zero")
    full = model or FullModel()
    pressures = np.concatenate([np.linspace(lowest_kpa, 0.0, _STEPS + 1), np.linspace(0.0, 50.0, _STEPS + 1)[1:]])
    carried = full.guides.tracked
    curves, elongations = [], []
    state: Solution | None = None
    for pressure in pressures:
        state = full.solve(pressure_kpa=float(pressure), start=state)
        curves.append(both_guides(carried.positions(state.displacement_mm)))
        elongations.append(state.elongation_mm)
    return GuideStates(np.array(curves), pressures, np.array(elongations), full.parameters.digest)


def kept_states(
    parameters: ActuatorParameters | None = None, *, lowest_kpa: float = _LOWEST_KPA, folder: Path | None = None
) -> GuideStates:
    """Return the fifteen states of an actuator from the cache, or solve and keep them there."""
    chosen = parameters or ActuatorParameters()
    reach = "" if lowest_kpa == _LOWEST_KPA else f" {lowest_kpa:g}"
    name = hashlib.sha256(f"{chosen.digest} {_FORMAT} {program_version()}{reach}".encode()).hexdigest()[:20]
    path = (folder or cache_folder()) / f"states_{name}.npz"
    kept = load_arrays(path, _ARRAYS)
    if kept and kept["curves_mm"].shape == (2 * _STEPS + 1, 2, 7, 2) and np.isfinite(kept["curves_mm"]).all():
        return GuideStates(**kept, parameters=chosen.digest)
    states = guide_states(FullModel(chosen), lowest_kpa=lowest_kpa)
    keep_arrays(path, states.arrays)
    return states


def write_states(states: GuideStates, path: Path) -> None:
    """Write the states as CSV or, by the suffix .npz, as arrays."""
    check_suffix(path)
    with writing(path):
        if path.suffix.lower() == ".npz":
            write_arrays(path, states.arrays)
        else:
            write_whole(path, "\n".join([*_origin(states), HEADER, *_lines(states)]) + "\n")


def check_suffix(path: Path) -> None:
    """Reject the name of a file that would not be what it says."""
    if path.suffix.lower() not in (".csv", ".npz"):
        raise ChoiceError(f"{path} ends neither in .csv nor in .npz", "choose one of these formats")


def _origin(states: GuideStates) -> list[str]:
    """Return comment lines with content and origin of the file."""
    low, high = states.pressure_kpa[[0, -1]]
    return [
        "# SIMULATED: the two guides in 15 states, most compressed first, by the digital shadow of boat-daq",
        f"# boat-daq shadow states --lowest {low:g} --highest {high:g}, version {program_version()}, "
        f"actuator parameters {states.parameters}",
        "# x across, z along the actuator from its base",
    ]


def _lines(states: GuideStates) -> list[str]:
    lines = []
    for (state, guide, point), _ in np.ndenumerate(states.curves_mm[..., 0]):
        (x, z), p, q = states.curves_mm[state, guide, point], states.pressure_kpa[state], states.elongation_mm[state]
        lines.append(f"{state},{guide + 1},{point + 1},{x:.9g},{z:.9g},{p:.6g},{q:.9g}")
    return lines
