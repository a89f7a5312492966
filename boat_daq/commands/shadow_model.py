"""The model that a command of the digital shadow uses, by its options, and a state solved with it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import progress_bar

if TYPE_CHECKING:
    from analysis.fidelity import Level
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.fem.solver import Solution
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.model.full import FullModel
    from analysis.shadow.model.reduced import ReducedModel

ParametersOption = Annotated[Path | None, typer.Option("--parameters", help="TOML file of actuator parameters.")]
MeshOption = Annotated[Path | None, typer.Option("--mesh", help="A .vtu or .msh mesh in place of the parametric one.")]


def chosen_parameters(path: Path | None, level: Level = "normal") -> ActuatorParameters:
    """Return the parameters of a file, or the defaults, on the mesh of a precision; normal keeps a file's own mesh."""
    from analysis.fidelity import fidelity
    from analysis.shadow.fem.parameters import read_parameters
    from analysis.shadow.model.frames import actuator

    if path is None:
        return actuator(fidelity(level))
    read = read_parameters(path)
    return read if level == "normal" else actuator(fidelity(level), read)


def chosen_model(parameters: Path | None, mesh: Path | None, level: Level = "normal") -> FullModel:
    """Return the full model.

    Parameters
    ----------
    parameters : TOML file; None for the defaults.
    mesh : mesh file; None for the parametric mesh.
    level : precision of the parametric mesh.
    """
    from analysis.shadow.fem.mesh_files import read_mesh
    from analysis.shadow.model.full import FullModel

    return FullModel(chosen_parameters(parameters, level), mesh=None if mesh is None else read_mesh(mesh))


def chosen_table(actuator: ActuatorParameters, level: Level | None = None) -> ReducedModel:
    """Return the reduced model of an actuator, of the size of a precision level if one is given."""
    from analysis.fidelity import fidelity
    from analysis.shadow.model.frames import table_settings
    from analysis.shadow.model.table import load_table

    settings = None if level is None else table_settings(fidelity(level))
    with progress_bar("building the table") as progress:
        return load_table(actuator, settings, progress=progress)


def chosen_shadow(parameters: Path | None, level: Level = "normal") -> Shadow:
    """Return the shadow of the chosen parameters, its table of the precision's size."""
    from analysis.shadow.model.frames import Shadow

    actuator = chosen_parameters(parameters, level)
    return Shadow(actuator, chosen_table(actuator, level))


@dataclass(frozen=True, slots=True)
class SolvedState:
    """A state, and how it was found.

    Parameters
    ----------
    used : name of the model that solved it.
    error_mm : error of the elongation by the mesh: measured on the default actuator, of another one that of 95 % of
        all actuators; NaN on a mesh that is not the precision's.
    default : whether the actuator is the default one.
    """

    model: FullModel
    solution: Solution
    used: str
    seconds: float
    error_mm: float = math.nan
    default: bool = True


def solved_state(
    pressure: float | None,
    elongation: float | None,
    model: str,
    parameters: Path | None,
    mesh: Path | None,
    level: Level = "normal",
) -> SolvedState:
    """Return the state at a pressure, at an elongation or at both, by the chosen model.

    Parameters
    ----------
    pressure, elongation : kPa, mm; None where it is free.
    parameters, mesh, level : see `chosen_model`.

    Raises
    ------
    RequestError : outside the limits of the model.
    """
    from analysis.fidelity import fidelity

    chosen, default = fidelity(level), parameters is None and mesh is None

    def error_mm(size: ActuatorParameters, elongation_mm: float) -> float:
        if mesh is not None or (size.axial_elements, size.wall_elements, size.lattice_elements) != chosen.mesh:
            return math.nan
        return chosen.mesh_error_mm if default else chosen.mesh_error_percent / 100.0 * abs(elongation_mm)

    if model == "full":
        full = chosen_model(parameters, mesh, level)
        full.check_limits(pressure, elongation)  # finds the limits, once for all states: not timed
        begun = time.perf_counter()
        solution = full.solve(pressure_kpa=pressure, elongation_mm=elongation)
        error = error_mm(full.parameters, solution.elongation_mm)
        return SolvedState(full, solution, "full", time.perf_counter() - begun, error, default)
    shadow = chosen_shadow(parameters, level)
    begun = time.perf_counter()
    solution, used = shadow.solution(elongation_mm=elongation, pressure_kpa=pressure)
    error = error_mm(shadow.model.parameters, solution.elongation_mm)
    return SolvedState(shadow.model, solution, used, time.perf_counter() - begun, error, default)
