"""Mesh files: written, read back, rejected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

from analysis.shadow.fem.mesh import Mesh
from analysis.shadow.fem.mesh_files import PARTS, from_meshio, read_mesh, to_meshio, write_state
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.full import FullModel
from protocol.base.errors import FileError, RequestError, StorageError


@pytest.mark.parametrize("kind", ["vtu", "msh"])
def test_written_meshes_are_read_back_unchanged(actuator: FullModel, tmp_path: Path, kind: str) -> None:
    """Nodes, elements, materials, wetted edges, base and tip; and the states of both are the same."""
    path = tmp_path / f"actuator.{kind}"
    write(actuator, actuator.solve(pressure_kpa=30.0), path, kind)
    mesh = read_mesh(path)
    again = FullModel(actuator.parameters, mesh=mesh)
    assert again.solver.solve(pressure_kpa=30.0).elongation_mm == pytest.approx(
        actuator.solve(pressure_kpa=30.0).elongation_mm, rel=1e-9
    )
    assert len(mesh.cavity) == len(actuator.mesh.cavity)


def test_vtu_carries_the_state(actuator: FullModel, tmp_path: Path) -> None:
    """Displacements of each node, in mm."""
    state = actuator.solve(pressure_kpa=30.0)
    write(actuator, state, tmp_path / "state.vtu", "vtu")
    found = meshio.read(tmp_path / "state.vtu").point_data["displacement_mm"]
    np.testing.assert_allclose(found[:, :2], state.displacement_mm, atol=1e-12)


def test_foreign_meshes_are_put_right(actuator: FullModel) -> None:
    """Clockwise elements, wetted edges in reverse, unused nodes and a base not at zero are taken."""
    made = to_meshio(actuator.mesh)
    points = np.vstack([made.points + np.array([0, 17.0, 0]), [[1e3, 1e3, 0]]])
    turned = [
        (block.type, block.data[:, [0, 3, 2, 1, 7, 6, 5, 4]] if block.type == "quad8" else block.data[:, [1, 0, 2]])
        for block in made.cells
    ]
    mesh = from_meshio(meshio.Mesh(points, turned, cell_data=made.cell_data), Path("foreign.vtu"))
    assert mesh.nodes[:, 1].min() == 0.0
    same = FullModel(actuator.parameters, mesh=mesh).solver.solve(pressure_kpa=-20.0)
    assert same.elongation_mm == pytest.approx(actuator.solve(pressure_kpa=-20.0).elongation_mm, rel=1e-8)


def test_what_is_no_mesh_is_refused(actuator: FullModel, tmp_path: Path) -> None:
    """No file, no mesh, another suffix, a missing part, no parts at all, an edge of no element."""
    for name, text in (
        ("none.vtu", None),
        ("torn.vtu", "<VTKFile"),
        ("torn.msh", "$MeshFormat\n2.2 0 8\n"),
        ("a.stl", ""),
    ):
        path = tmp_path / name
        if text is not None:
            path.write_text(text)
        with pytest.raises(FileError) as refusal:
            read_mesh(path)
        assert refusal.value.remedy
    made = to_meshio(actuator.mesh)
    keep = [i for i, label in enumerate(made.cell_data["part"]) if label[0] != 3]
    fewer = meshio.Mesh(
        made.points, [made.cells[i] for i in keep], cell_data={"part": [made.cell_data["part"][i] for i in keep]}
    )
    with pytest.raises(FileError, match="cavity"):
        from_meshio(fewer, tmp_path / "fewer.vtu")
    with pytest.raises(FileError, match="does not mark"):
        from_meshio(meshio.Mesh(made.points, made.cells), tmp_path / "bare.vtu")


def test_msh_of_version_4_is_read(tmp_path: Path) -> None:
    """A point, in one block; it marks no parts."""
    nodes, elements = (
        "$Nodes\n1 1 1 1\n0 1 0 1\n1\n0 0 0\n$EndNodes\n",
        "$Elements\n1 1 1 1\n0 1 15 1\n1 1\n$EndElements\n",
    )
    (path := tmp_path / "m.msh").write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n" + nodes + elements)
    with pytest.raises(FileError, match="does not mark which cells"):
        read_mesh(path)


@pytest.mark.parametrize(
    "section",
    [
        b"$Entities\n99998 1 1 1\n", b"$Nodes\n100001 5 1 5\n",
        b"$Elements\n60000 1 1 1\n$EndElements\n$Nodes \n40001\n",
        b"$PhysicalNames\n100001\n", b"$Periodic\n100001\n",
    ],
)  # fmt: skip
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_msh_of_too_many_blocks_is_refused(tmp_path: Path, section: bytes, end: bytes) -> None:
    """By what its sections state, before they are read one by one; a file of 32 MiB may have three million."""
    (path := tmp_path / "m.msh").write_bytes((b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n" + section).replace(b"\n", end))
    with pytest.raises(FileError, match="has 100,001 entities, blocks and names of groups, 100,000 can be read"):
        read_mesh(path)


def test_binary_msh_of_too_many_blocks_is_refused(tmp_path: Path) -> None:
    """Its numbers are of eight bytes."""
    numbers = np.array([1, 100_000, 0, 0], np.uint64).tobytes()
    (path := tmp_path / "m.msh").write_bytes(b"$MeshFormat\n4.1 1 8\n\1\0\0\0\n$EndMeshFormat\n$Entities\n" + numbers)
    with pytest.raises(FileError, match="has 100,001 entities"):
        read_mesh(path)


def write(model: FullModel, solution: Solution, path: Path, kind: str) -> None:
    """Write a model's state."""
    write_state(path, kind, model.parameters, model.mesh, solution)


def altered(mesh: Mesh, change: dict[int, Callable[[np.ndarray], np.ndarray]]) -> meshio.Mesh:
    """The mesh as a file has it, with the cells of some parts changed."""
    made = to_meshio(mesh)
    cells, labels = [], []
    for block, label in zip(made.cells, made.cell_data["part"], strict=True):
        part = int(label[0])
        data = change[part](block.data) if part in change else block.data
        cells.append((block.type, data))
        labels.append(np.full(len(data), part))
    return meshio.Mesh(made.points, cells, cell_data={"part": labels})


@pytest.mark.parametrize(
    ("part", "change", "message"),
    [
        ("cavity", lambda e: np.delete(e, len(e) // 2, axis=0), "not one chain of edges from base to tip .4 ends"),
        ("cavity", lambda e: e[1:], "2 ends, 1 of them neither"),
        ("cavity", lambda e: np.concatenate([e, e[:1]]), "wetted edge twice"),
        ("base", lambda e: e[1:], "the base is not the mesh's flat end"),
        ("tip", lambda e: e[:-1], "the tip is not the mesh's flat end"),
    ],
)
def test_parts_that_are_not_whole_are_refused(
    actuator: FullModel, part: str, change: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    """A cavity with a hole, an open end or an edge twice, ends in part: each moved the tip by 1 to 12 % in silence."""
    with pytest.raises(FileError, match=message):
        from_meshio(altered(actuator.mesh, {PARTS[part]: change}), Path("x.vtu"))


def test_exchanged_ends_are_rejected(actuator: FullModel) -> None:
    """Base for tip, and r for z, gave a tip of the other sign; metres put the guides outside the lattice."""
    made = to_meshio(actuator.mesh)
    exchange = np.array([0, 1, 2, 3, 5, 4])
    swapped = meshio.Mesh(made.points, made.cells, cell_data={"part": [exchange[p] for p in made.cell_data["part"]]})
    with pytest.raises(FileError, match="the base is not the mesh's flat end"):
        from_meshio(swapped, Path("x.vtu"))
    turned = meshio.Mesh(made.points[:, [1, 0, 2]], made.cells, cell_data=made.cell_data)
    with pytest.raises(FileError, match="flat end"):
        from_meshio(turned, Path("x.vtu"))
    metres = from_meshio(meshio.Mesh(1e-3 * made.points, made.cells, cell_data=made.cell_data), Path("x.vtu"))
    with pytest.raises(RequestError, match="guide"):
        _ = FullModel(actuator.parameters, mesh=metres).guides


def test_unknown_formats_and_missing_folders_are_rejected(actuator: FullModel, tmp_path: Path) -> None:
    """An unknown format and a folder that is not there."""
    rest = actuator.solver.rest()
    with pytest.raises(RequestError, match="vtk"):
        write(actuator, rest, tmp_path / "x.vtk", "vtk")
    for kind in ("vtu", "msh", "inp"):
        with pytest.raises(StorageError):
            write(actuator, rest, tmp_path / "none" / f"x.{kind}", kind)
