"""Makes `references/fits.json`: wall modulus, neck and critical pressure on each mesh measured.

Run as `python make_fits.py`; about a minute.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.studies.tradeoff.mechanics import MESHES
from tests.analysis.shadow.geometry_fit import fit_geometry


def fitted(mesh: tuple[int, int, int]) -> tuple[float, float, float]:
    """Return wall modulus in kPa and neck radius in mm, fitted on a mesh to the paper's two elongations, and where that
    actuator loses its stability under vacuum, kPa.
    """
    axial, wall, lattice = mesh
    start = replace(ActuatorParameters(), axial_elements=axial, wall_elements=wall, lattice_elements=lattice)
    found = fit_geometry(start).parameters
    return found.wall_modulus_kpa, found.neck_radius_mm, FullModel(found).vacuum_limit.pressure_kpa


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "analysis/studies/tradeoff/references/fits.json")
    content = {
        "method": "tests/analysis/shadow/geometry_fit.py on each mesh; "
        "where that actuator loses its stability under vacuum",
        "columns": ["axial", "wall", "lattice", "wall_modulus_kpa", "neck_radius_mm", "critical_kpa"],
    }
    rows = [[*mesh, *fitted(mesh)] for mesh in MESHES]
    target.write_text(json.dumps(content | {"rows": rows}) + "\n", encoding="utf-8")
