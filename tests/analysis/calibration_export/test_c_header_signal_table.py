"""Tables over the signal keep to the bound that was chosen."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest

from analysis.calibration_export.c_header import signal_table, table_csv
from protocol.base.errors import RequestError
from tests.analysis.calibration_export.calibrations import expected, file_of


def test_table_interpolates_within_its_bound() -> None:
    """Over signals that are none of its own, rising or falling; fewer rows where more error is allowed."""
    rows = []
    for bound_mm in (0.1, 0.001):
        calibration = file_of("falling cubic")
        lines = [line for line in table_csv(calibration, bound_mm).splitlines() if not line.startswith("#")]
        read = [
            (float(row["signal_mv"]), float(row["elongation_mm"]), float(row["u_mm"])) for row in csv.DictReader(lines)
        ]
        signal, x, u = np.asarray(read).T
        rows.append(signal.size)
        at = np.random.default_rng(0).uniform(signal[0], signal[-1], 5000)
        true, true_u, _ = expected(calibration, at[:, None])
        assert np.abs(np.interp(at, signal, x) - true).max() <= bound_mm
    np.testing.assert_allclose(np.interp(at, signal, u), true_u, rtol=0.01)
    assert rows[0] < rows[1]


@pytest.mark.parametrize("bound_mm", [0.0, -1.0, float("nan"), 1e-9])
def test_bound_that_no_table_keeps_is_refused(bound_mm: float) -> None:
    """Zero and below, and what single precision cannot carry."""
    with pytest.raises(RequestError):
        signal_table(file_of("line").reader().inverses[0], bound_mm, single=True)


@pytest.mark.parametrize(("curve", "single"), [("line", True), ("falling cubic", True), ("falling cubic", False)])
def test_refused_bound_names_the_least_that_is_kept(curve: str, single: bool) -> None:
    """The value that the refusal proposes is accepted, and a tenth less is not."""
    inverse = file_of(curve).reader().inverses[0]
    with pytest.raises(RequestError) as refused:
        signal_table(inverse, 1e-12, single=single)
    least_mm = float(re.findall(r"Allow (\S+) mm or more", refused.value.remedy)[0])
    signal_table(inverse, least_mm, single=single)
    with pytest.raises(RequestError):
        signal_table(inverse, 0.9 * least_mm, single=single)
