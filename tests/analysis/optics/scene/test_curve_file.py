"""Curve files in the forms a lab writes them, and those that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.optics.scene.curve_file import read_curves
from analysis.optics.scene.curves import parametric_elongations
from protocol.base.errors import FileError


def pairs(guide: np.ndarray, separator: str = ",") -> list[str]:
    return [f"{x:.7f}{separator}{z:.7f}" for x, z in guide]


def named(c: np.ndarray) -> str:
    rows = [f"{s},{g + 1},{p}" for s in range(15) for g in range(2) for p in pairs(c[s, g])]
    return "\n".join(["state,guide,x_mm,z_mm", *rows])


def by_elongation(c: np.ndarray) -> str:
    rows = [
        f"{e:.4f},{name},{p}"
        for e, state in zip(parametric_elongations(), c, strict=True)
        for name, guide in zip(("left", "right"), state, strict=True)
        for p in pairs(guide)
    ]
    return "\n".join(["elongation_mm,waveguide,x,z", *rows[::-1][:0], *rows])


def side_by_side(c: np.ndarray) -> str:
    rows = [f"{s - 7},{a},{b}" for s in range(15) for a, b in zip(pairs(c[s, 0]), pairs(c[s, 1]), strict=True)]
    return "\n".join(["state,x1,z1,x2,z2", *rows])


def plain(c: np.ndarray) -> str:
    return "\n".join(["x,z", *(p for state in c for guide in state for p in pairs(guide))])


def headless(c: np.ndarray) -> str:
    return plain(c).split("\n", 1)[1]


def blank_lines(c: np.ndarray) -> str:
    return "# from the simulation\nx (mm);z (mm)\n" + "\n\n".join("\n".join(pairs(g, ";")) for s in c for g in s)


def decimal_commas(c: np.ndarray) -> str:
    return "\n".join(p.replace(".", ",") for s in c for g in s for p in pairs(g, ";"))


@pytest.mark.parametrize("write", [named, by_elongation, side_by_side, plain, headless, blank_lines, decimal_commas])
def test_fifteen_states_are_read_from_any_form(write: object, curves: np.ndarray, tmp_path: Path) -> None:
    """Named columns, side by side, plain, with blank lines or decimal commas: all give the same array."""
    path = tmp_path / "curves.csv"
    path.write_text(write(curves), encoding="utf-8")  # type: ignore[operator]
    np.testing.assert_allclose(read_curves(path), curves, atol=1e-6)


def test_one_state_is_read(curves: np.ndarray, tmp_path: Path) -> None:
    """Fourteen points are one state of two guides; a guide listed backwards is still one."""
    path = tmp_path / "one.csv"
    path.write_text("x,z\n" + "\n".join(pairs(curves[3, 0]) + pairs(curves[3, 1])))
    np.testing.assert_allclose(read_curves(path), curves[3:4], atol=1e-6)
    path.write_text("x,z\n" + "\n".join(pairs(curves[3, 0]) + pairs(curves[3, 1][::-1])))
    np.testing.assert_allclose(read_curves(path)[0, 1], curves[3, 1][::-1], atol=1e-6)


def test_one_guide_is_mirrored(curves: np.ndarray, tmp_path: Path) -> None:
    """A single bowed guide is completed by its mirror image."""
    path = tmp_path / "guide.csv"
    path.write_text("x,z\n" + "\n".join(pairs(curves[3, 0])))
    np.testing.assert_allclose(read_curves(path), curves[3:4], atol=1e-6)


def test_a_folder_of_states_is_read_in_order(curves: np.ndarray, tmp_path: Path) -> None:
    """Fifteen files are fifteen states, 10 after 9."""
    for s, state in enumerate(curves):
        (tmp_path / f"state{s}.csv").write_text(plain(state[None]))
    np.testing.assert_allclose(read_curves(tmp_path), curves, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "no points"),
        ("x,z\n", "no points"),
        ("x,z\n1,2\n2,3\n", "2 points"),
        ("hello\nworld\n", "no x and z"),
        ("x,z\n" + "1,nan\n" * 9, "not 2 numbers"),
        ("x,z\n" + "1,two\n" * 9, "not 2 numbers"),
        ("x_m,z_m\n1,2\n", "not in mm"),
        ("x,z\n" + "0,1\n" * 14, "guide"),
        ("x,z\n" + "\n".join(f"0,{i}" for i in range(9)), "straight"),
        ("state,guide,x,z\n" + "\n".join(f"0,{g},{g},{i}" for g in (1, 2, 3) for i in range(7)), "3 guides"),
        (
            "state,guide,x,z\n" + "\n".join(f"{s},{g},{g},{i}" for s in (0, 1) for g in (1, 2) for i in range(7)),
            "2 states",
        ),
        ("state,guide,x,z\n" + "\n".join(f"0,{g},{g},{i}" for g in (1, 2) for i in range(6 + g)), "points"),
    ],
)
def test_unreadable_files_are_rejected_with_cause_and_remedy(text: str, word: str, tmp_path: Path) -> None:
    """Each is refused with a cause that names it and a remedy."""
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=word) as refused:
        read_curves(path)
    assert refused.value.remedy


def test_missing_and_binary_files_are_refused(tmp_path: Path) -> None:
    """No file, a file that is no text, a folder with too few files."""
    with pytest.raises(FileError, match="no curve file"):
        read_curves(tmp_path / "absent.csv")
    (tmp_path / "image.bin").write_bytes(bytes(range(256)))
    with pytest.raises(FileError, match="text"):
        read_curves(tmp_path / "image.bin")
    with pytest.raises(FileError, match="0 CSV files"):
        read_curves(tmp_path)
