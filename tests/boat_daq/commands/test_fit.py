"""`boat-daq fit`: certified coefficients, shared positions, incomplete rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.errors import AnalysisError
from tests.analysis.calibration.test_fit import DIGITS, certified, digits
from tests.boat_daq.commands.calls import call, exit_code

FIT_KEYS = {
    "degree", "n", "coefficients", "std_errors", "covariance", "r2", "rmse", "range", "turning_points", "monotone",
}  # fmt: skip


@pytest.mark.parametrize("name", DIGITS)
def test_fit_meets_certified_digits_and_gives_bands(shared_data: Path, tmp_path: Path, name: str) -> None:
    """NIST's data sets give the certified digits, the documented keys, and bands on request."""
    x, y, coefficients, deviations = certified(shared_data / "nist_strd" / f"{name}.dat")
    pd.DataFrame({"load": x, "deflection": y}).to_csv(tmp_path / "p.csv", index=False)
    degree = str(coefficients.size - 1)
    found = call("fit", tmp_path / "p.csv", "--x", "load", "--y", "deflection", "--degree", degree, "--bands")
    assert set(found) >= FIT_KEYS
    assert digits(np.asarray(found["coefficients"]), coefficients) >= DIGITS[name]
    assert digits(np.asarray(found["std_errors"]), deviations) >= 5.0
    assert len(found["bands"]["curve_95"][0]) == len(found["bands"]["x"])


@pytest.mark.parametrize("names", [("low", "mid", "up", "high"), ("1", "2", "3", "4")])
def test_equal_positions_share_their_reading_error(tmp_path: Path, names: tuple[str, ...]) -> None:
    """Four positions read twice, named by text or number: no row is omitted, and the shared error is not averaged."""
    rows = [f"{x},{10 * x + 0.1 * (-1) ** (x + again)},{names[x]}" for again in (0, 1) for x in range(4)]
    path = tmp_path / "positions.csv"
    path.write_text("\n".join(["x,y,p", *rows]))
    own = [f"{row},{number}" for number, row in enumerate(rows)]
    (tmp_path / "own.csv").write_text("\n".join(["x,y,p,q", *own]))
    options = ("--x", "x", "--y", "y", "--degree", 1, "--x-resolution", 1.0)
    shared = call("fit", path, *options, "--position", "p")
    each = call("fit", tmp_path / "own.csv", *options, "--position", "q")
    assert (shared["n"], shared["masked"]) == (8, 0)
    assert shared["std_errors_with_reading"][1] > 1.2 * each["std_errors_with_reading"][1]


def test_incomplete_rows_are_counted_and_impossible_fits_refused(tmp_path: Path) -> None:
    """A row without a number is omitted and counted; an unknown column and too few distinct x are errors."""
    (tmp_path / "a.csv").write_text("x,y\n0,0\n1,1\n2,4\n3,\n4,16\n5,25\n")
    assert call("fit", tmp_path / "a.csv", "--x", "x", "--y", "2", "--degree", "2")["masked"] == 1
    with pytest.raises(AnalysisError, match="no column"):
        call("fit", tmp_path / "a.csv", "--x", "z", "--y", "y")
    (tmp_path / "b.csv").write_text("x,y\n0,0\n1,1\n0,4\n1,5\n")
    with pytest.raises(AnalysisError, match="2 distinct x"):
        call("fit", tmp_path / "b.csv", "--x", "x", "--y", "y")
    assert exit_code("fit", tmp_path / "a.csv", "--x", "x", "--y", "y", "--degree", "11") == 2
