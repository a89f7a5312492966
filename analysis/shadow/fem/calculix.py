"""A complete CalculiX deck of the actuator: the same mesh, energy, supports and pressure, ready to run.

Strategy: CAX8R elements in (r, axis) as (x, y), NEO HOOKE with our C10 and D1, the base clamped, the tip's axial
displacements tied by equations to one node, pressure on the wetted faces as a distributed load that follows the
surface, and its thrust on the tip plate as a force at that node (the plate's hole does not change its radius, so the
thrust is p pi r^2). CalculiX counts an axisymmetric nodal force over the whole circle, as we do.

Rules: units mm, kPa, mN (kPa mm^2 = mN). At most 16 entries on a data line, numbers with 10 digits.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from analysis.arrays import IntArray
from analysis.shadow.fem.element import EDGES
from analysis.shadow.fem.mesh import LATTICE, WALL, Mesh
from analysis.shadow.fem.parameters import ActuatorParameters

INCREMENTS = 10


def calculix_deck(parameters: ActuatorParameters, mesh: Mesh, pressure_kpa: float) -> str:
    """Return the text of the input file.

    Parameters
    ----------
    parameters : materials.
    mesh : the actuator's mesh.
    pressure_kpa : gauge pressure reached at the end of the one static step, kPa.
    """
    names = {LATTICE: "LATTICE", WALL: "WALL"}
    lines = ["*HEADING", "boat-daq, axisymmetric actuator; mm, kPa, mN", "*NODE, NSET=ALL"]
    lines += [f"{i}, {r:.10e}, {z:.10e}" for i, (r, z) in enumerate(mesh.nodes, 1)]
    for value, name in names.items():
        lines.append(f"*ELEMENT, TYPE=CAX8R, ELSET={name}")
        lines += [", ".join(map(str, [e + 1, *(mesh.quads[e] + 1)])) for e in np.flatnonzero(mesh.material == value)]
    for name, members in (("BASE", mesh.base), ("TIP", mesh.tip), ("PLATE", mesh.tip[:1])):
        lines += [f"*NSET, NSET={name}", *rows(members + 1)]
    for value, name in names.items():
        material = parameters.lattice if value == LATTICE else parameters.wall
        lines += [
            f"*MATERIAL, NAME={name}",
            "*HYPERELASTIC, NEO HOOKE",
            f"{material.c10_kpa:.10e}, {material.d1_per_kpa:.10e}",
            f"*SOLID SECTION, ELSET={name}, MATERIAL={name}",
        ]
    lines += ["*BOUNDARY", "BASE, 1, 2", "TIP, 1, 1", *tie(mesh.tip)]
    lines += ["*STEP, NLGEOM, INC=1000", "*STATIC", f"{1 / INCREMENTS}, 1.0, 1e-6, {1 / INCREMENTS}", "*DLOAD"]
    lines += [f"{element + 1}, P{face + 1}, {pressure_kpa:.10e}" for element, face in wetted_faces(mesh)]
    hole = float(mesh.nodes[mesh.tip, 0].min())
    lines += ["*CLOAD", f"{mesh.tip[0] + 1}, 2, {pressure_kpa * np.pi * hole**2:.10e}"]
    lines += ["*NODE FILE", "U", "*EL FILE", "S", "*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U", "*END STEP"]
    return "\n".join(lines) + "\n"


def rows(members: IntArray) -> Iterable[str]:
    """Yield data lines of at most 16 numbers."""
    for start in range(0, len(members), 16):
        yield ", ".join(map(str, members[start : start + 16]))


def tie(members: IntArray) -> Iterable[str]:
    """Yield equations that give every node the first one's axial displacement."""
    for node in members[1:]:
        yield "*EQUATION"
        yield "2"
        yield f"{node + 1}, 2, 1.0, {members[0] + 1}, 2, -1.0"


def wetted_faces(mesh: Mesh) -> list[tuple[int, int]]:
    """Return (element, face from 0) of each wetted edge."""
    faces = {tuple(edge): (e, f) for e, quad in enumerate(mesh.quads) for f, edge in enumerate(quad[EDGES].tolist())}
    return [faces[tuple(edge)] for edge in mesh.cavity.tolist()]
