"""`boat-daq fit`: certified coefficients, shared positions, incomplete rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from protocol.base.errors import BoatDaqError
from tests.analysis.calibration.test_fit import DIGITS, certified, digits
from tests.boat_daq.commands.calls import call, exit_code, shown_progress, text

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


def test_equal_positions_share_their_reading_error(tmp_path: Path) -> None:
    """Four positions read twice, named by text or number: no row is omitted, and the shared error is not averaged."""
    words, path = ("low", "mid", "up", "high"), tmp_path / "positions.csv"
    rows = [
        f"{x},{10 * x + 0.1 * (-1) ** (x + again)},{words[x]},{x + 1},{4 * again + x}"
        for again in (0, 1)
        for x in range(4)
    ]
    path.write_text("\n".join(["x,y,text,number,own", *rows]))
    options = ("--x", "x", "--y", "y", "--degree", 1, "--x-resolution", 1.0, "--position")
    with shown_progress("fit") as shown:
        by_text, by_number, each = (call("fit", path, *options, name) for name in ("text", "number", "own"))
    assert shown["samples"][-1] == 1.0
    for shared in (by_text, by_number):
        assert (shared["n"], shared["masked"]) == (8, 0)
        assert shared["std_errors_with_reading"][1] > 1.2 * each["std_errors_with_reading"][1]
    half_width = max(by_text["std_errors_with_reading"])
    assert 0.0 < by_text["posterior"]["band_error"] < half_width
    assert "Monte-Carlo error of the 95 % band" in text("fit", path, *options, "text")


def test_incomplete_rows_are_counted_and_impossible_fits_refused(tmp_path: Path) -> None:
    """A row without a number is omitted and counted; an unknown column and too few distinct x are errors."""
    (tmp_path / "a.csv").write_text("x,y\n0,0\n1,1\n2,4\n3,\n4,16\n5,25\n")
    assert call("fit", tmp_path / "a.csv", "--x", "x", "--y", "2", "--degree", "2")["masked"] == 1
    with pytest.raises(BoatDaqError, match="no column"):
        call("fit", tmp_path / "a.csv", "--x", "z", "--y", "y")
    (tmp_path / "b.csv").write_text("x,y\n0,0\n1,1\n0,4\n1,5\n")
    with pytest.raises(BoatDaqError, match="2 different positions"):
        call("fit", tmp_path / "b.csv", "--x", "x", "--y", "y")
    assert exit_code("fit", tmp_path / "a.csv", "--x", "x", "--y", "y", "--degree", "11") == 2


def table(folder: Path, **columns: np.ndarray) -> Path:
    """Write columns as a CSV."""
    pd.DataFrame(columns).to_csv(folder / "t.csv", index=False)
    return folder / "t.csv"


XY = ("--x", "x", "--y", "y")


def test_stated_uncertainty_gives_the_errors_and_is_tested(tmp_path: Path) -> None:
    """A line with u = 0.5: errors by (A^T A / u^2)^-1, whatever the scatter; three times too small is named."""
    rng = np.random.default_rng(1)
    x = np.linspace(0, 10, 30)
    path = table(tmp_path, x=x, y=2 * x + 0.5 * rng.standard_normal(30), u=np.full(30, 0.5), v=np.full(30, 0.15))
    found = call("fit", path, *XY, "--degree", 1, "--u", "u")
    design = np.vander(x, 2, increasing=True)
    expected = 0.5 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    np.testing.assert_allclose(found["std_errors"], expected, rtol=1e-9)
    assert found["stated_uncertainty"]["verdict"] == "consistent"
    assert found["residual_sd"] == pytest.approx(0.5 * found["stated_uncertainty"]["ratio"])
    small = call("fit", path, *XY, "--degree", 1, "--u", "v")
    assert small["stated_uncertainty"]["verdict"] == "too_small"
    assert "stated_uncertainty" in {w["code"] for w in small["warnings"]}
    assert "stated uncertainty: too small, chi-square" in text("fit", path, *XY, "--degree", 1, "--u", "v")


def test_options_of_a_fit_are_in_its_result(tmp_path: Path) -> None:
    """Through zero and monotone: a constant of zero without error, and a curve that does not turn."""
    x = np.linspace(0.2, 10, 40)
    y = 100 * (1 - np.exp(-x)) + 2 * np.random.default_rng(0).standard_normal(40)
    path = table(tmp_path, x=x, y=y)
    assert not call("fit", path, *XY, "--degree", 5)["monotone"]
    found = call("fit", path, *XY, "--degree", 5, "--monotone", "--through-zero", "--bands")
    assert found["monotone"]
    assert found["through_zero"]
    assert found["constrained_monotone"]
    assert found["coefficients"][0] == found["std_errors"][0] == 0.0
    assert exit_code("fit", path, *XY, "--through-zero", "--x-resolution", 0.1) == 2


def test_wrong_point_is_left_out_and_named(tmp_path: Path) -> None:
    """Row 8 of 30 is 20 off: named in JSON and text; the line is that of the others."""
    x = np.linspace(0, 10, 30)
    y = 3 * x + 0.1 * np.random.default_rng(3).standard_normal(30)
    y[7] += 20.0
    path = table(tmp_path, x=x, y=y)
    found = call("fit", path, *XY, "--degree", 1, "--leave-out")
    assert found["coefficients"][1] == pytest.approx(3.0, abs=0.03)
    assert [one["row"] for one in found["left_out"]] == [7]
    assert found["n"] == 29
    assert "point_left_out" in {w["code"] for w in found["warnings"]}
    assert "row 8: x = 2.41379" in text("fit", path, *XY, "--degree", 1, "--leave-out")


def test_columns_without_a_relation_are_named(tmp_path: Path) -> None:
    """Noise against a ramp: a warning, with and without --json."""
    path = table(tmp_path, x=np.arange(40.0), y=np.random.default_rng(0).standard_normal(40))
    found = call("fit", path, *XY, "--degree", 1)
    assert {w["code"] for w in found["warnings"]} == {"nothing_explained"}
    assert found["residual_tests"]["explanation"]["p"] > 0.05
