"""Building the reduced model from full solutions, and its cache: an npz file named by a hash of all it depends on.

The table of the default actuator comes with the program (`default_table.npz`, by
`tests/analysis/shadow/make_default_table.py`), with its unstable held states.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from analysis.progress import Progress
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution, Solver
from analysis.shadow.model import chebyshev
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import ReducedModel, TableSettings
from protocol.base.arrays import FloatArray
from protocol.base.whole_file import written_whole

# what zipfile, zlib and numpy raise of a damaged cache: other versions, other methods, passwords, sizes beyond memory
UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, MemoryError, zlib.error, struct.error,
               zipfile.BadZipFile)  # fmt: skip


def cache_folder() -> Path:
    """Return the folder in which arrays are kept."""
    return platformdirs.user_cache_path("boat-daq") / "shadow"


def load_arrays(path: Path, names: tuple[str, ...]) -> dict[str, FloatArray] | None:
    """Return the named arrays of a file; None if there is none or it cannot be read."""
    with suppress(*UNREADABLE), path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
        return {name: kept[name] for name in names}
    return None


def keep_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write arrays, where the folder can be written, so that a reader sees all of them or nothing."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_arrays(path, arrays)


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write arrays by their names, whole or not at all."""
    with written_whole(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)


_FORMAT = 1
CRITICAL_SHARE = 0.96
_LOWEST_KPA = -90.0
NOMINAL_POINTS = 16
"""The lower side is this share of the critical pressure, never below the second; points of the nominal curve."""
_ARRAYS = tuple(field.name for field in fields(ReducedModel))
DEFAULT_TABLE = Path(__file__).with_name("default_table.npz")


Count = Callable[[], None]


def _counter(total: int, progress: Progress | None) -> Count:
    """Return what counts a full solution and reports how many of how many are done."""
    done = itertools.count(1)
    return lambda: None if progress is None else progress(next(done), total)


def build_table(
    parameters: ActuatorParameters | None = None,
    settings: TableSettings | None = None,
    progress: Progress | None = None,
) -> ReducedModel:
    """Build the reduced model of an actuator."""
    chosen = settings or TableSettings()
    model = FullModel(parameters)
    count = _counter(chosen.pressures * chosen.elongations + chosen.held_out + 3 * NOMINAL_POINTS, progress)
    low = max(CRITICAL_SHARE * model.vacuum_limit.pressure_kpa, _LOWEST_KPA)
    pressures = np.array([low, min(chosen.highest_pressure_kpa, 0.95 * model.inflation_limit.pressure_kpa)])
    ends = [model.solve(pressure_kpa=float(p)).elongation_mm for p in pressures]
    reach = np.array([ends[0] - chosen.margin_mm, ends[1] + chosen.margin_mm])
    points = chebyshev.points(pressures, chosen.pressures), chebyshev.points(reach, chosen.elongations)
    displacement, force = _grid(model, *points, count)
    nominal = _nominal_curves(model, pressures, count)
    compressed = _compress(model, displacement, force, chosen.modes)
    critical = np.array(model.vacuum_limit.pressure_kpa)
    table = ReducedModel(pressures, reach, *compressed, *nominal, np.zeros(chosen.modes), critical)
    return replace(table, errors_mm=_held_out_errors(model, table, chosen.held_out, count))


def _grid(
    model: FullModel, pressures: FloatArray, elongations: FloatArray, count: Count
) -> tuple[FloatArray, FloatArray]:
    """Return full solutions over a grid: displacements (a, b, 2 nodes) and plate forces (a, b)."""
    found = np.empty((len(pressures), len(elongations), 2 * len(model.mesh.nodes)))
    force = np.empty(found.shape[:2])
    state: Solution | None = None
    for i, j in _alternating(len(pressures), len(elongations)):
        state = model.solve(pressure_kpa=float(pressures[i]), elongation_mm=float(elongations[j]), start=state)
        found[i, j], force[i, j] = state.displacement_mm.ravel(), state.tip_force_mn
        count()
    return found, force


def _alternating(rows: int, columns: int) -> Iterator[tuple[int, int]]:
    return ((i, j if i % 2 == 0 else columns - 1 - j) for i, j in np.ndindex(rows, columns))


def _compress(
    model: FullModel, displacement: FloatArray, force: FloatArray, modes: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Decompose the samples and fit the amplitudes; return mean, shapes, amplitudes, force and the tracked points'."""
    flat = displacement.reshape(-1, displacement.shape[-1])
    mean = flat.mean(axis=0)
    _, _, right = np.linalg.svd(flat - mean, full_matrices=False)
    shapes = right[:modes].T
    amplitudes = ((flat - mean) @ shapes).reshape(*force.shape, -1)
    tracked = model.guides.tracked
    moved = np.stack([(tracked.weights @ column.reshape(-1, 2)).ravel() for column in shapes.T], axis=1)
    coefficients = chebyshev.tensor_coefficients(amplitudes), chebyshev.tensor_coefficients(force)
    return mean, shapes, *coefficients, tracked.positions(mean.reshape(-1, 2)).ravel(), moved


def _nominal_curves(model: FullModel, pressures: FloatArray, count: Count) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return coefficients of x_nom(p), of its standard uncertainty, and of p_nom(x)."""
    at = chebyshev.points(pressures, NOMINAL_POINTS)
    p = model.parameters
    curves = []
    for shift in (0.0, -p.lattice_modulus_sd_kpa, p.lattice_modulus_sd_kpa):
        shifted = replace(p, lattice_modulus_kpa=p.lattice_modulus_kpa + shift)
        solver = model.solver if shift == 0.0 else Solver(FullModel(shifted).problem)
        state: Solution | None = None
        curve = []
        for value in at:
            state = solver.solve(pressure_kpa=float(value), start=state)
            curve.append(state.elongation_mm)
            count()
        curves.append(np.array(curve))
    base = chebyshev.coefficients(curves[0])
    spread = chebyshev.coefficients((curves[1] - curves[2]) / 2.0)
    ends = chebyshev.basis(pressures, pressures, NOMINAL_POINTS) @ base
    inverse = [model.solver.solve(elongation_mm=float(x)).pressure_kpa for x in chebyshev.points(ends, NOMINAL_POINTS)]
    return base, spread, chebyshev.coefficients(np.array(inverse))


def _held_out_errors(model: FullModel, table: ReducedModel, number: int, count: Count) -> FloatArray:
    """Return the greatest error of a tracked point over quasi-random states, with 1, 2, ... modes, shape (modes,)."""
    from scipy.stats import qmc  # here: a table that is read needs no SciPy

    unit = qmc.Sobol(2, seed=20260101).random_base2(max(number - 1, 0).bit_length())[:number]
    p0, p1 = table.pressure_range_kpa
    q0, q1 = table.elongation_range_mm
    states = np.stack([p0 + (p1 - p0) * unit[:, 0], q0 + (q1 - q0) * unit[:, 1]], axis=1)
    states = states[np.argsort(states[:, 1])]
    truth, state = [], None
    for p, q in states:
        state = model.solve(pressure_kpa=float(p), elongation_mm=float(q), start=state)
        truth.append(model.tracked(state))
        count()
    modes = range(1, table.shapes.shape[1] + 1)
    return np.array(
        [np.linalg.norm(table.truncated(k).tracked(*states.T) - np.array(truth), axis=2).max() for k in modes]
    )


def table_digest(parameters: ActuatorParameters, settings: TableSettings) -> str:
    """Return the name of a table: a hash of parameters, settings and format."""
    text = json.dumps([parameters.digest, asdict(settings), _FORMAT], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def load_table(
    parameters: ActuatorParameters | None = None,
    settings: TableSettings | None = None,
    *,
    progress: Progress | None = None,
    folder: Path | None = None,
) -> ReducedModel:
    """Return the program's table, that from the cache, or build it and keep it there."""
    p, s = parameters or ActuatorParameters(), settings or TableSettings()
    if (p, s) == (ActuatorParameters(), TableSettings()) and (table := read_table(DEFAULT_TABLE)) is not None:
        return table
    path = (folder or cache_folder()) / f"{table_digest(p, s)}.npz"
    kept = read_table(path)
    if kept is not None:
        return kept
    table = build_table(p, s, progress)
    write_table(table, path)
    return table


def default_unstable() -> frozenset[tuple[int, int]]:
    """Return the places of the default actuator's unstable held states (see held.py)."""
    arrays = load_arrays(DEFAULT_TABLE, ("unstable",)) or {"unstable": np.empty((0, 2))}
    return frozenset((int(p), int(q)) for p, q in arrays["unstable"])


def write_table(table: ReducedModel, path: Path) -> None:
    """Keep a table in a file, where its folder can be written."""
    keep_arrays(path, table_arrays(table))


def table_arrays(table: ReducedModel) -> dict[str, Any]:
    """Return the arrays of a table by their names in a file."""
    return {name: getattr(table, name) for name in _ARRAYS}


def read_table(path: Path) -> ReducedModel | None:
    """Return a kept table; None if there is none or it cannot be read."""
    arrays = load_arrays(path, _ARRAYS)
    return None if arrays is None else ReducedModel(**arrays)
