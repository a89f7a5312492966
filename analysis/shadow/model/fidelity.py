"""The shadow at a fidelity: mesh with its own fit, and size of the table."""

from __future__ import annotations

from dataclasses import replace

from analysis.fidelity import Fidelity
from analysis.progress import Progress
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import load_table


def actuator(level: Fidelity, base: ActuatorParameters | None = None) -> ActuatorParameters:
    """Return an actuator on the level's mesh.

    Parameters
    ----------
    level : of fidelity.
    base : a caller's own actuator, of which only the mesh is changed; by default the program's, whose two fitted
        numbers are those of the mesh.
    """
    axial, wall, lattice = level.mesh
    meshed = replace(base or ActuatorParameters(), axial_elements=axial, wall_elements=wall, lattice_elements=lattice)
    if base is not None:
        return meshed
    return replace(meshed, wall_modulus_kpa=level.wall_modulus_kpa, neck_radius_mm=level.neck_radius_mm)


def table_settings(level: Fidelity) -> TableSettings:
    """Return the size of the level's reduced model."""
    pressures, elongations, shapes = level.table
    return TableSettings(pressures=pressures, elongations=elongations, modes=shapes)


def shadow_at(level: Fidelity, base: ActuatorParameters | None = None, progress: Progress | None = None) -> Shadow:
    """Return the shadow of the level's actuator, its table from the cache or built.

    Parameters
    ----------
    level, base : as in `actuator`. progress : called as (done, total) while a table is built; raising from it cancels.
    """
    parameters = actuator(level, base)
    return Shadow(parameters, load_table(parameters, table_settings(level), progress=progress))
