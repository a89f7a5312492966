"""The reduced model: its error and its edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import ReducedModel
from protocol.base.errors import RequestError


def test_fresh_states_keep_the_stated_bound(actuator: FullModel, table: ReducedModel) -> None:
    """Tracked points of states that neither built nor tested the table lie within its bound, far below 0.1 %."""
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
