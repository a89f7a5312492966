"""The reduced model: its error, its edges, its cache."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from analysis.errors import RequestError
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model import chebyshev
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import ReducedModel, TableSettings
from analysis.shadow.model.table import build_table, load_table, read_table, table_digest, write_table

SMALL = TableSettings(pressures=4, elongations=4, modes=6, held_out=8)


def test_chebyshev_points_carry_polynomials() -> None:
    """A cubic over an interval, and a product over a rectangle, come back exactly."""
    ends, sides = np.array([-3.0, 5.0]), np.array([0.5, 2.0])
    cubic, line = Polynomial([1.0, -2.0, 0.3, 0.1]), Polynomial([4.0, -1.0])
    at, across = chebyshev.points(ends, 4), chebyshev.points(sides, 2)
    x, y = np.array([-2.2, 0.0, 4.9]), np.array([0.6, 1.0, 1.9])
    found = chebyshev.basis(x, ends, 4) @ chebyshev.coefficients(cubic(at))
    np.testing.assert_allclose(found, cubic(x), atol=1e-12)
    both = chebyshev.tensor_coefficients(np.outer(cubic(at), line(across)))
    value = np.einsum("ni,ij,nj->n", chebyshev.basis(x, ends, 4), both, chebyshev.basis(y, sides, 2))
    np.testing.assert_allclose(value, cubic(x) * line(y), atol=1e-12)


def test_fresh_states_keep_the_stated_bound(actuator: FullModel, table: ReducedModel) -> None:
    """Tracked points of states that neither built nor judged the table lie within its bound, far below 0.1 %."""
    rng = np.random.default_rng(7)
    (p0, p1), (q0, q1) = table.pressure_range_kpa, table.elongation_range_mm
    for p, q in zip(rng.uniform(p0, p1, 12), rng.uniform(q0, q1, 12), strict=True):
        full = actuator.tracked(actuator.solve(pressure_kpa=float(p), elongation_mm=float(q)))
        assert np.linalg.norm(table.tracked(p, q)[0] - full, axis=1).max() <= table.error_bound_mm
    assert table.error_bound_mm < 1e-3 * 3.8


def test_field_force_and_points_belong_together(actuator: FullModel, table: ReducedModel) -> None:
    """Nodal displacements give the same tracked points, and the plate's force is the full model's."""
    u, force = table.displacement(20.0, 0.5)
    np.testing.assert_allclose(actuator.guides.tracked.positions(u), table.tracked(20.0, 0.5)[0], atol=1e-12)
    assert force == pytest.approx(actuator.solve(pressure_kpa=20.0, elongation_mm=0.5).tip_force_mn, rel=2e-4)


def test_nominal_curve_and_its_inverse(actuator: FullModel, table: ReducedModel) -> None:
    """x_nom(p) is the full model's, p_nom undoes it, and the band is what a change of E by one sd does."""
    pressures = np.array([-40.0, -10.0, 0.0, 30.0, 50.0])
    nominal, spread = table.nominal_elongation(pressures)
    full = [actuator.solve(pressure_kpa=float(p)).elongation_mm for p in pressures]
    np.testing.assert_allclose(nominal, full, atol=1e-6)
    np.testing.assert_allclose(table.nominal_pressure(nominal), pressures, atol=1e-4)
    stiff, soft = (
        FullModel(replace(ActuatorParameters(), lattice_modulus_kpa=18.34 + s * 1.86)).solver.solve(pressure_kpa=50.0)
        for s in (1, -1)
    )
    assert spread[-1] == pytest.approx((soft.elongation_mm - stiff.elongation_mm) / 2, rel=1e-4)


def test_more_shapes_less_error(table: ReducedModel) -> None:
    """The error falls by a thousand from one shape to all."""
    assert table.errors_mm[-1] < 1e-3 * table.errors_mm[0]
    assert len(table.truncated(3).errors_mm) == 3


@pytest.mark.fault(46, how="states outside the table, and NaN", times=4)
@pytest.mark.parametrize(("p", "q"), [(60.0, 1.0), (0.0, 9.0), (np.nan, 0.0), (0.0, np.nan)])
def test_outside_the_rectangle(table: ReducedModel, p: float, q: float) -> None:
    """A state outside, or NaN, is refused with the range; nominal values there are NaN."""
    with pytest.raises(RequestError, match="outside the table"):
        table.tracked(p, q)
    assert np.isnan(table.nominal_elongation(np.array(60.0))[0])
    assert np.isnan(table.nominal_pressure(np.array(9.0)))


def test_cache_is_used_mended_and_done_without(short: ActuatorParameters, tmp_path: Path) -> None:
    """The second call builds nothing; a torn file is built again; a folder that cannot be made does not matter."""
    calls: list[float] = []

    def count(done: float, total: float) -> None:
        calls.append(done / total)

    first = load_table(short, SMALL, progress=count, folder=tmp_path)
    assert calls[-1] == 1.0
    built = len(calls)
    again = load_table(short, SMALL, progress=count, folder=tmp_path)
    assert len(calls) == built
    np.testing.assert_array_equal(again.amplitudes, first.amplitudes)
    kept = tmp_path / f"{table_digest(short, SMALL)}.npz"
    kept.write_bytes(kept.read_bytes()[:1000])
    assert read_table(kept) is None
    np.testing.assert_array_equal(load_table(short, SMALL, folder=tmp_path).errors_mm, first.errors_mm)
    blocked = tmp_path / "file"
    blocked.write_text("")
    np.testing.assert_array_equal(load_table(short, SMALL, folder=blocked / "sub").errors_mm, first.errors_mm)
    write_table(first, tmp_path / "new" / "table.npz")
    assert read_table(tmp_path / "new" / "table.npz") is not None


def test_digest_depends_on_parameters_and_settings(short: ActuatorParameters) -> None:
    """Another actuator or another grid is another table."""
    names = {
        table_digest(short, SMALL),
        table_digest(ActuatorParameters(), SMALL),
        table_digest(short, TableSettings()),
    }
    assert len(names) == 3


def test_building_can_be_cancelled(short: ActuatorParameters) -> None:
    """What the progress callback raises comes through."""

    def stop(done: float, total: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_table(short, SMALL, stop)
