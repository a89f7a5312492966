"""Effective modulus from compression tests, and what is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.shadow.model.modulus import CompressionTest, effective_modulus, read_compression_test, specimen_modulus
from protocol.base.errors import DataError, FileError, RequestError

HEIGHT, AREA = 50.0, 2500.0


def specimen(modulus_kpa: float, *, toe_mm: float = 0.4, noise_n: float = 0.0, seed: int = 0) -> CompressionTest:
    """A linear specimen with a toe."""
    way = np.linspace(0, 9, 400)
    force = modulus_kpa * 1e-3 * AREA * np.clip(way - toe_mm, 0, None) / HEIGHT
    return CompressionTest(
        "made", force + noise_n * np.random.default_rng(seed).standard_normal(400), way, HEIGHT, AREA
    )


@given(st.floats(0.5, 5000.0), st.floats(0.0, 1.0), st.sampled_from([-1.0, 1.0]), st.sampled_from([-1.0, 1.0]))
def test_slope_is_the_modulus_whatever_toe_and_signs(modulus: float, toe: float, way: float, force: float) -> None:
    """A linear specimen gives its modulus, with a toe and with compression recorded negative or positive."""
    made = specimen(modulus, toe_mm=toe)
    turned = CompressionTest("turned", force * made.force_n, way * made.displacement_mm, HEIGHT, AREA)
    assert specimen_modulus(turned).modulus_kpa == pytest.approx(modulus, rel=1e-6)


def test_three_specimens_as_in_the_paper() -> None:
    """Mean and standard deviation over specimens, Student's t interval of the mean."""
    values = np.array([16.4, 18.5, 20.12])
    found = effective_modulus([specimen(v, noise_n=0.002, seed=i) for i, v in enumerate(values)])
    assert found.mean_kpa == pytest.approx(values.mean(), rel=2e-3)
    assert found.sd_kpa == pytest.approx(values.std(ddof=1), rel=2e-2)
    reach = 4.302653 * found.sd_kpa / np.sqrt(3)
    np.testing.assert_allclose(found.interval_kpa, [found.mean_kpa - reach, found.mean_kpa + reach], rtol=1e-6)


def test_unloading_is_left_out() -> None:
    """Only the way to the greatest displacement counts; a hysteretic return does not."""
    made = specimen(18.0)
    back = CompressionTest(
        "loop",
        np.concatenate([made.force_n, 0.5 * made.force_n[::-1]]),
        np.concatenate([made.displacement_mm, made.displacement_mm[::-1]]),
        HEIGHT,
        AREA,
    )
    assert specimen_modulus(back).modulus_kpa == pytest.approx(18.0, rel=1e-6)


def test_one_specimen_has_no_spread() -> None:
    """One test gives its own slope's error, and NaN for what needs several."""
    found = effective_modulus([specimen(18.0, noise_n=0.01)])
    assert np.isnan(found.sd_kpa)
    assert np.isnan(found.interval_kpa).all()
    assert 0 < found.standard_error_kpa < 0.2


def bad(force: np.ndarray, way: np.ndarray) -> CompressionTest:
    return CompressionTest("bad", force, way, HEIGHT, AREA)


WAY = np.linspace(0, 9, 200)


@pytest.mark.parametrize(
    "test",
    [
        bad(np.zeros(200), WAY),
        bad(np.full(200, 3.0), WAY),
        bad(5 - 0.1 * WAY, WAY),
        bad(np.random.default_rng(0).standard_normal(200), WAY),
        bad(WAY, np.zeros(200)),
        bad(np.full(200, np.nan), WAY),
        bad(WAY[:3], WAY[:3]),
        bad(WAY, WAY / 20),
        bad(WAY, 10 * WAY),
    ],
    ids=["no force", "constant", "falling", "noise", "no way", "nan", "short", "too little", "beyond its height"],
)
def test_what_is_no_compression_test_is_refused(test: CompressionTest) -> None:
    """Each with its cause, the specimen's name and a remedy."""
    with pytest.raises(DataError) as refusal:
        specimen_modulus(test)
    assert "bad" in refusal.value.cause
    assert refusal.value.remedy


def test_impossible_requests_are_rejected() -> None:
    """No file, no height, no area."""
    with pytest.raises(RequestError):
        effective_modulus([])
    made = specimen(18.0)
    for height, area in ((0.0, AREA), (HEIGHT, np.nan)):
        with pytest.raises(RequestError):
            specimen_modulus(CompressionTest("x", made.force_n, made.displacement_mm, height, area))


@pytest.mark.parametrize(
    "header",
    ["displacement_mm,force_n", "Extension (mm),Load (N)", "Displacement [m],Force [mN]", "force,displacement"],
)
def test_files_of_several_makers(tmp_path: Path, header: str) -> None:
    """Names and units of common testing machines are understood."""
    made = specimen(18.0)
    columns = [made.displacement_mm, made.force_n]
    if "[m]" in header:
        columns = [columns[0] / 1e3, columns[1] * 1e3]
    if header.startswith("force"):
        columns.reverse()
    path = tmp_path / "s1.csv"
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.10g")
    assert specimen_modulus(read_compression_test(path, HEIGHT, AREA)).modulus_kpa == pytest.approx(18.0, rel=1e-4)
    chosen = read_compression_test(path, HEIGHT, AREA, *(("1", "2") if header.startswith("force") else ("2", "1")))
    assert specimen_modulus(chosen).modulus_kpa == pytest.approx(18.0, rel=1e-4)


def test_unsuitable_files_are_rejected(tmp_path: Path) -> None:
    """A table without such columns, an unknown unit, no table at all."""
    path = tmp_path / "s1.csv"
    for text in ("time_s,x\n1,2\n2,3\n3,4\n", "displacement_mm,force (furlong)\n1,2\n2,3\n3,4\n", "hello"):
        path.write_text(text)
        with pytest.raises(FileError):
            read_compression_test(path, HEIGHT, AREA)
