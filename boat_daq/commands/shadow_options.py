"""Options and helpers that the shadow's commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import notify, progress_bar, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.fidelity import Level
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.model.full import FullModel
    from analysis.shadow.model.reduced import ReducedModel

ParametersOption = Annotated[Path | None, typer.Option("--parameters", help="TOML file of actuator parameters.")]
MeshOption = Annotated[Path | None, typer.Option("--mesh", help="A .vtu or .msh mesh in place of the parametric one.")]


def chosen_parameters(path: Path | None, level: Level = "normal") -> ActuatorParameters:
    """Return the parameters of a file, or the defaults, on the mesh of a fidelity; normal keeps a file's own mesh."""
    from analysis.fidelity import fidelity
    from analysis.shadow.model.fidelity import actuator
    from analysis.shadow.model.parameter_files import read_parameters

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
    level : fidelity of the parametric mesh.
    """
    from analysis.shadow.fem.mesh_files import read_mesh
    from analysis.shadow.model.full import FullModel

    return FullModel(chosen_parameters(parameters, level), mesh=None if mesh is None else read_mesh(mesh))


def chosen_table(actuator: ActuatorParameters, level: Level | None = None) -> ReducedModel:
    """Return the reduced model of an actuator, of the fidelity's size where one is given."""
    from analysis.fidelity import fidelity
    from analysis.shadow.model.fidelity import table_settings
    from analysis.shadow.model.table import load_table

    settings = None if level is None else table_settings(fidelity(level))
    with progress_bar("building the table") as progress:
        return load_table(actuator, settings, progress=progress)


def chosen_shadow(parameters: Path | None, level: Level = "normal") -> Shadow:
    """Return the shadow of the chosen parameters, its table of the fidelity's size."""
    from analysis.shadow.model.frames import Shadow

    actuator = chosen_parameters(parameters, level)
    return Shadow(actuator, chosen_table(actuator, level))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of its suffix."""
    with writing(path):
        figure.savefig(path, dpi=144)
    notify(f"wrote {path}")
