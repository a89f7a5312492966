"""Makes `references/calculix.json`: the actuator by CalculiX, which shares no line with ours.

Run as `python make_calculix_reference.py`; it takes minutes and needs `ccx` (Debian's
calculix-ccx).
The mesh is far finer than the default; wall modulus and neck are fitted on that very mesh to the paper's two
elongations, as they are for the default. CalculiX turns the pressure with the surface once an increment: with steps of
10 kPa its elongation is off by 2e-3 mm at 50 kPa, with 5 kPa by 5e-4, so that steps of 1 kPa are taken.
"""

from __future__ import annotations

import datetime
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.shadow.fem.mesh_files import INCREMENTS, calculix_deck
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from tests.analysis.shadow.geometry_fit import fit_geometry

MESH = (24, 5, 10)
STEP_KPA, KEPT_KPA = 1.0, 10.0
ENDS_KPA = (-40.0, 50.0)


def states(model: FullModel, end_kpa: float) -> list[np.ndarray]:
    """Run the exported deck in equal steps to one end; return the nodes' displacements (n, 2) at each kept pressure."""
    count = round(abs(end_kpa) / STEP_KPA)
    deck = calculix_deck(model.parameters, model.mesh, end_kpa)
    step = f"{1 / count:.12g}"
    deck = deck.replace(
        f"*STATIC\n{1 / INCREMENTS}, 1.0, 1e-6, {1 / INCREMENTS}", f"*STATIC, DIRECT\n{step}, 1.0, {step}, {step}"
    ).replace("FREQUENCY=1000", f"FREQUENCY={round(KEPT_KPA / STEP_KPA)}")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "deck.inp").write_text(deck, encoding="ascii")
        subprocess.run(["ccx", "deck"], cwd=folder, check=True, capture_output=True, timeout=3000)
        lines = [line.split() for line in (Path(folder) / "deck.dat").read_text(encoding="ascii").splitlines()]
    rows = np.array([[float(v) for v in line[1:3]] for line in lines if len(line) == 4 and line[0].isdigit()])
    return list(rows.reshape(-1, len(model.mesh.nodes), 2))


def made(mesh: tuple[int, int, int] = MESH, parameters: ActuatorParameters | None = None) -> dict[str, object]:
    """Return the table: pressures, elongations, tracked points, and where they come from."""
    axial, wall, lattice = mesh
    start = replace(ActuatorParameters(), axial_elements=axial, wall_elements=wall, lattice_elements=lattice)
    chosen = parameters or fit_geometry(start).parameters
    model = FullModel(chosen)
    pressures, elongations, tracked = [], [], []
    for end in ENDS_KPA:
        found = states(model, end)
        for number, moved in enumerate(found, 1):
            pressures.append(end * number / len(found))
            elongations.append(float(moved[model.mesh.tip[0], 1]))
            tracked.append(np.round(model.guides.tracked.positions(moved), 6).tolist())
    version = subprocess.run(["ccx", "-v"], capture_output=True, text=True).stdout.split()[-1]
    return {
        "method": f"CalculiX {version}, CAX8R elements, the deck of `shadow export --format inp`",
        "made": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
        "mesh": list(mesh),
        "wall_modulus_kpa": chosen.wall_modulus_kpa,
        "neck_radius_mm": chosen.neck_radius_mm,
        "pressures_kpa": pressures,
        "elongations_mm": elongations,
        "tracked_mm": tracked,
    }


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "analysis/studies/tradeoff/references/calculix.json")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(made()) + "\n", encoding="utf-8")
