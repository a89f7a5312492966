"""Meshes and states as files: VTU for ParaView, MSH for Gmsh, INP for CalculiX; and meshes back from VTU and MSH.

Parts are cells with a number (`part`, in MSH also a physical group with its name): lattice 1 and wall 2 are eight-node
quadrilaterals, cavity 3, base 4 and tip 5 three-node lines. Coordinates are (r, axis, 0) in mm.
"""

from __future__ import annotations

import base64
import re
import zlib
from collections.abc import Iterable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from meshio.vtu._vtu import VtuReader, vtu_to_numpy_type

from analysis.shadow.fem.element import EDGES
from analysis.shadow.fem.mesh import LATTICE, WALL, Mesh, check_quality
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import ChoiceError, FileError, writing
from protocol.base.whole_file import written_whole

_MAX_BYTES = 32 << 20  # a hundred thousand elements take 20 MB
MAX_EXPANDED_BYTES = 128 << 20  # of compressed arrays, which may shrink to a thousandth
MOST_BLOCKS = 100_000  # entities, blocks and names of a Gmsh file, each read on its own: 4 s
PARTS = {"lattice": 1, "wall": 2, "cavity": 3, "base": 4, "tip": 5}
FLAT_SHARE = 1e-6  # distance of a node from its flat end that is accepted, as a share of the length
FARTHEST_MM = 1e6  # of a point: beyond, areas overflow
_SECTION = re.compile(rb"\$(Entities|Nodes|Elements|PhysicalNames|Periodic)[ \t\r]*\n")
_REVERSED = [0, 3, 2, 1, 7, 6, 5, 4]


def write_state(path: Path, file_format: str, parameters: ActuatorParameters, mesh: Mesh, solution: Solution) -> None:
    """Write a state (VTU), the mesh at rest (MSH) or the whole problem at the state's pressure (INP)."""
    if file_format not in ("vtu", "msh", "inp"):
        raise ChoiceError(f"'{file_format}' is not a mesh format of this program", "choose vtu, msh or inp")
    with writing(path), written_whole(path) as part:
        if file_format == "inp":
            part.write_text(calculix_deck(parameters, mesh, solution.pressure_kpa), encoding="ascii")
        elif file_format == "msh":
            meshio.write(part, to_meshio(mesh, named=True), file_format="gmsh22", binary=False)
        else:
            meshio.write(part, to_meshio(mesh, solution.displacement_mm), file_format="vtu")


def to_meshio(mesh: Mesh, displacement_mm: FloatArray | None = None, *, named: bool = False) -> meshio.Mesh:
    """Return a mesh with its parts, and displacements [n, 2] in mm, for meshio; `named`: as Gmsh's physical groups."""
    lines = [("base", line_cells(mesh, mesh.base)), ("tip", line_cells(mesh, mesh.tip)), ("cavity", mesh.cavity)]
    quads = [("lattice", mesh.quads[mesh.material == LATTICE]), ("wall", mesh.quads[mesh.material == WALL])]
    cells = [("quad8", c) for _, c in quads] + [("line3", c[:, [0, 2, 1]]) for _, c in lines]
    part = [np.full(len(c), PARTS[name]) for name, c in quads + lines]
    points = np.column_stack([mesh.nodes, np.zeros(len(mesh.nodes))])
    if named:
        groups = {name: np.array([n, 2 if n <= 2 else 1]) for name, n in PARTS.items()}
        return meshio.Mesh(points, cells, None, {"gmsh:physical": part, "gmsh:geometrical": part}, groups)
    flat = np.zeros(len(points))
    state = {} if displacement_mm is None else {"displacement_mm": np.column_stack([displacement_mm, flat])}
    return meshio.Mesh(points, cells, state, {"part": part})


def line_cells(mesh: Mesh, members: IntArray) -> IntArray:
    """Return the element edges whose three nodes are all members, shape (k, 3): start, middle, end."""
    edges = mesh.quads[:, EDGES].reshape(-1, 3)
    chosen: IntArray = edges[np.isin(edges, members).all(axis=1)]
    return chosen


def read_mesh(path: Path) -> Mesh:
    """Read a mesh with parts lattice, wall, cavity, base and tip."""
    kind = {".vtu": "vtu", ".msh": "gmsh"}.get(path.suffix.lower())
    refusal = FileError(f"{path} is not a mesh that can be read here", "give a .vtu or .msh file")
    if kind is None or not path.is_file():  # a pipe would be waited for
        raise refusal
    if path.stat().st_size > _MAX_BYTES:
        raise FileError(f"{path} is larger than {_MAX_BYTES >> 20} MB", "give a coarser mesh")
    try:
        blocks = _stated_blocks(path.read_bytes()) if kind == "gmsh" else 0
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # meshio prints, and exits
            found = None if blocks > MOST_BLOCKS else _Vtu(path).mesh if kind == "vtu" else meshio.read(path, kind)
    except (Exception, SystemExit) as error:
        raise refusal from error
    if found is None:
        cause = f"{path} has {blocks:,} entities, blocks and names of groups, {MOST_BLOCKS:,} can be read"
        raise FileError(cause, "save one group for each part, without the geometry")
    return from_meshio(found, path)


def _stated_blocks(content: bytes) -> int:
    """Return how many entities, blocks and names the sections of a Gmsh file state."""
    version, binary, *_ = content.split(b"\n", 2)[1].split()
    total = 0
    for section in _SECTION.finditer(content):
        name, at = section[1], section.end()
        if version < b"4" and name != b"PhysicalNames":  # nodes and elements one after another, in no blocks
            continue
        numbers = 4 if name == b"Entities" else 1
        if binary == b"1" and name != b"PhysicalNames":
            total += sum(np.frombuffer(content, np.uint64, numbers, at).tolist())
        else:
            total += sum(int(number) for number in content[at : at + 200].split(b"\n", 1)[0].split()[:numbers])
    return total


class _Vtu(VtuReader):  # type: ignore[misc]
    """Meshio's reader of VTU, with a bound on what compressed arrays expand to."""

    _left = MAX_EXPANDED_BYTES

    @property
    def mesh(self) -> meshio.Mesh:
        """The data read."""
        return meshio.Mesh(self.points, self.cells, self.point_data, self.cell_data, self.field_data)

    def read_compressed_binary(self, data: str, dtype: np.dtype[Any]) -> Any:
        """Return an array, after its blocks were expanded one by one, and no further than the bound."""
        if self.compression != "vtkZLibDataCompressor":
            raise ValueError(f"unknown compression {self.compression}")
        order = ">" if self.byte_order == "BigEndian" else "<"
        for block in _blocks(data, np.dtype(vtu_to_numpy_type[self.header_type]).newbyteorder(order)):
            self._left -= len(zlib.decompressobj().decompress(block, self._left + 1))
            if self._left < 0:
                raise ValueError(f"its arrays expand to more than {MAX_EXPANDED_BYTES >> 20} MB")
        return super().read_compressed_binary(data, dtype)


def _blocks(data: str, kind: np.dtype[Any]) -> Iterator[bytes]:
    """Yield the blocks of a compressed array: after a header (number, sizes), the two in base64 each."""

    def head(size: int) -> IntArray:
        return np.frombuffer(base64.b64decode(data[: -(-size // 3) * 4])[:size], kind)

    size = kind.itemsize * (3 + int(head(kind.itemsize)[0]))
    body, end = base64.b64decode(data[-(-size // 3) * 4 :]), 0
    for length in head(size)[3:].tolist():
        yield body[end : end + length]
        end += length


def from_meshio(found: meshio.Mesh, path: Path) -> Mesh:
    """Return our mesh from meshio's."""
    cells = by_part(found, path)
    missing = [name for name in ("lattice", "cavity", "base", "tip") if not len(cells[name])]
    if missing:
        cause = f"{path.name} has no part named {', '.join(missing)}"
        raise FileError(cause, "mark lattice and wall as quad8, cavity, base and tip as line3, as `shadow export` does")
    quads = np.concatenate([cells["lattice"], cells["wall"]])
    used, flat = np.unique(quads, return_inverse=True)
    rank = np.full(len(found.points), -1)
    rank[used] = np.arange(len(used))
    quads = flat.reshape(quads.shape)
    nodes = np.asarray(found.points, dtype=float)[used, :2]
    if not (np.abs(nodes) < FARTHEST_MM).all():
        remedy = "export the mesh again"
        raise FileError(f"{path.name} has a point that is not finite, or beyond {FARTHEST_MM:g} mm", remedy)
    nodes[:, 1] -= nodes[:, 1].min()
    mesh = Mesh(
        nodes,
        anticlockwise(nodes, quads),
        np.repeat([LATTICE, WALL], [len(cells["lattice"]), len(cells["wall"])]),
        rank[cells["cavity"][:, [0, 2, 1]]],
        np.unique(rank[cells["base"]]),
        np.unique(rank[cells["tip"]]),
    )
    if min(mesh.cavity.min(), mesh.base.min(), mesh.tip.min()) < 0:
        raise FileError(f"{path.name} has a cavity, base or tip that is not on the mesh", "export the mesh again")
    mesh = replace(mesh, cavity=directed(mesh, path))
    check_quality(mesh)
    check_ends(mesh, path)
    check_chain(mesh, path)
    return mesh


def check_ends(mesh: Mesh, path: Path) -> None:
    """Reject a base or a tip that is not the whole flat end: nodes left out would be free."""
    z = mesh.nodes[:, 1]
    near = FLAT_SHARE * float(z.max())
    for name, members, end in (("base", mesh.base, 0.0), ("tip", mesh.tip, float(z.max()))):
        missing = len(np.setdiff1d(np.flatnonzero(np.abs(z - end) <= near), members))
        astray = int((np.abs(z[members] - end) > near).sum())
        if missing or astray:
            raise FileError(
                f"{path.name}: the {name} is not the mesh's flat end at z = {end:g} mm ({missing} of its nodes left "
                f"out, {astray} elsewhere)",
                "mark the whole lower end as base and the whole upper end as tip, r first and z second",
            )


def check_chain(mesh: Mesh, path: Path) -> None:
    """Reject a cavity that is not one chain of edges from base (or axis) to tip: its volume would be wrong."""
    nodes, times = np.unique(mesh.cavity[:, [0, 2]], return_counts=True)
    ends = nodes[times == 1]
    on_axis = np.flatnonzero(mesh.nodes[:, 0] <= FLAT_SHARE * mesh.nodes[:, 0].max())
    closed = np.isin(ends, np.concatenate([mesh.base, mesh.tip, on_axis]))
    if times.max() > 2 or len(np.unique(mesh.cavity[:, 1])) < len(mesh.cavity):
        raise FileError(f"{path.name} has a wetted edge twice, or edges that fork", "mark each wetted edge once")
    if len(ends) != 2 or not closed.all():
        open_ends = int((~closed).sum())
        raise FileError(
            f"{path.name}: the cavity is not one chain of edges from base to tip ({len(ends)} ends, {open_ends} "
            "of them neither on base, tip nor axis)",
            "mark every edge between the pressure and the wall as cavity",
        )


def by_part(found: meshio.Mesh, path: Path) -> dict[str, IntArray]:
    """Return the cells of each part, identified by physical names, else by the number in `part`."""
    numbers = {name: int(data[0]) for name, data in found.field_data.items() if name in PARTS} or PARTS
    labels = found.cell_data.get("gmsh:physical") or found.cell_data.get("part")
    if labels is None:
        cause = f"{path.name} does not mark which cells are lattice, wall, cavity, base and tip"
        raise FileError(cause, "give it physical groups (Gmsh) or a cell array 'part'")
    parts: dict[str, IntArray] = {}
    for name in PARTS:
        kind, width = ("quad8", 8) if name in ("lattice", "wall") else ("line3", 3)
        blocks = [
            block.data[np.asarray(label) == numbers.get(name, -1)]
            for block, label in zip(found.cells, labels, strict=True)
            if block.type == kind
        ]
        parts[name] = np.concatenate([np.empty((0, width), dtype=np.int64), *blocks]).astype(np.int64)
    return parts


def anticlockwise(points: FloatArray, quads: IntArray) -> IntArray:
    """Reverse the elements that run clockwise."""
    x, y = points[quads[:, :4], 0], points[quads[:, :4], 1]
    area = (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    return np.where(area[:, None] < 0.0, quads[:, _REVERSED], quads)


def directed(mesh: Mesh, path: Path) -> IntArray:
    """Direct each wetted edge like the element it belongs to: the solid on the left."""
    owned = {frozenset(edge): edge for edge in mesh.quads[:, EDGES].reshape(-1, 3).tolist()}
    try:
        return np.array([owned[frozenset(edge)] for edge in mesh.cavity.tolist()])
    except KeyError as error:
        raise FileError(f"{path.name} has a wetted edge that belongs to no element", "export the mesh again") from error


INCREMENTS = 10


def calculix_deck(parameters: ActuatorParameters, mesh: Mesh, pressure_kpa: float) -> str:
    """Return the text of the input file; the pressure is reached at the end of the one static step.

    CAX8R elements in (r, axis) as (x, y), the base clamped, the tip's axial displacements tied to one node, pressure on
    the wetted faces, and its thrust p pi r^2 on the plate as a force at that node. CalculiX counts an axisymmetric
    nodal force over the whole circle, as we do; at most 16 entries on a data line, numbers with 10 digits.
    """
    names = {LATTICE: "LATTICE", WALL: "WALL"}
    lines = ["*HEADING", "boat-daq, axisymmetric actuator; mm, kPa, mN", "*NODE, NSET=ALL"]
    lines += [f"{i}, {r:.10e}, {z:.10e}" for i, (r, z) in enumerate(mesh.nodes, 1)]
    for value, name in names.items():
        lines.append(f"*ELEMENT, TYPE=CAX8R, ELSET={name}")
        lines += [", ".join(map(str, [e + 1, *(mesh.quads[e] + 1)])) for e in np.flatnonzero(mesh.material == value)]
    for name, members in (("BASE", mesh.base), ("TIP", mesh.tip), ("PLATE", mesh.tip[:1])):
        lines += [f"*NSET, NSET={name}", *data_lines(members + 1)]
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


def data_lines(members: IntArray) -> Iterable[str]:
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
