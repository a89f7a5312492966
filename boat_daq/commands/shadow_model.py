"""The model that a command of the digital shadow uses, by its options, and a state solved with it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import notify, progress_bar

if TYPE_CHECKING:
    from analysis.fidelity import Level
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.fem.solver import Solution
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.model.full import FullModel
    from analysis.shadow.model.reduced import ReducedModel

ParametersOption = Annotated[Path | None, typer.Option("--parameters", help="TOML file of actuator parameters.")]
MeshOption = Annotated[Path | None, typer.Option("--mesh", help="A .vtu or .msh mesh in place of the parametric one.")]


def note_unused(fidelity: Level | None) -> None:
    if fidelity is not None:
        notify("not used here: --fidelity; mesh and table are the same at each")


def chosen_parameters(path: Path | None) -> ActuatorParameters:
    from analysis.shadow.fem.parameters import ActuatorParameters, read_parameters

    return ActuatorParameters() if path is None else read_parameters(path)


def chosen_model(parameters: Path | None, mesh: Path | None) -> FullModel:
    from analysis.shadow.fem.mesh_files import read_mesh
    from analysis.shadow.model.full import FullModel

    return FullModel(chosen_parameters(parameters), mesh=None if mesh is None else read_mesh(mesh))


def chosen_table(actuator: ActuatorParameters) -> ReducedModel:
    from analysis.shadow.model.table import load_table

    with progress_bar("building the table") as progress:
        return load_table(actuator, progress=progress)


def chosen_shadow(parameters: Path | None) -> Shadow:
    from analysis.shadow.model.frames import Shadow

    actuator = chosen_parameters(parameters)
    return Shadow(actuator, chosen_table(actuator))


@dataclass(frozen=True, slots=True)
class SolvedState:
    """A state, and how it was found: `used` is the name of the model."""

    model: FullModel
    solution: Solution
    used: str
    seconds: float
    default: bool = True  # whether the actuator is the default one, on its mesh

    @property
    def measured(self) -> bool:
        """Return whether the error by the mesh was measured on this actuator, at such pressures."""
        from analysis.shadow.model.full import FITTED_KPA

        return self.default and FITTED_KPA[0] <= self.solution.pressure_kpa <= FITTED_KPA[1]

    @property
    def error_mm(self) -> float:
        """Return the error of the elongation by the mesh: measured, or of 95 % of actuators; NaN on another mesh."""
        from analysis.shadow.fem.parameters import ActuatorParameters
        from analysis.shadow.model.full import MESH_ERROR_MM, MESH_ERROR_PERCENT

        if not self.model.parametric or self.model.parameters.elements != ActuatorParameters().elements:
            return math.nan
        return MESH_ERROR_MM if self.measured else MESH_ERROR_PERCENT / 100.0 * abs(self.solution.elongation_mm)


def solved_state(
    pressure: float | None, elongation: float | None, model: str, parameters: Path | None, mesh: Path | None
) -> SolvedState:
    """Return the state at a pressure (kPa), at an elongation (mm) or at both, by the chosen model.

    Raises RequestError: outside the limits of the model.
    """
    default = parameters is None and mesh is None
    if model == "full":
        full = chosen_model(parameters, mesh)
        full.check_limits(pressure, elongation)  # finds the limits, once for all states: not timed
        begun = time.perf_counter()
        solution = full.solve(pressure_kpa=pressure, elongation_mm=elongation)
        return SolvedState(full, solution, "full", time.perf_counter() - begun, default)
    shadow = chosen_shadow(parameters)
    begun = time.perf_counter()
    solution, used = shadow.solution(elongation_mm=elongation, pressure_kpa=pressure)
    return SolvedState(shadow.model, solution, used, time.perf_counter() - begun, default)
