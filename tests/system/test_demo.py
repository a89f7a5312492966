"""`boat-daq demo`: a session on the virtual board over a real port, its figures within bounds of the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.boat_daq.commands.calls import call
from tests.conftest import mostly_at_night

# |measured - truth|, by the end of the figure's name
BOUNDS = {
    "b0": 1.0,  # mV
    "sensor hysteresis": 0.5,  # % FSO
    "system hysteresis": 0.5,
    "SNR": 0.5,  # dB
}
SENSITIVITY = 0.01  # of the truth


def demo(folder: Path, *arguments: str) -> dict[str, Any]:
    """Run the demo without a window and return its object."""
    content: dict[str, Any] = call("demo", "--headless", "--out", folder, *arguments)
    return content


def check_against_truth(content: dict[str, Any]) -> None:
    """Check every figure of the comparison against its bound."""
    rows = {row["figure"]: row for row in content["comparison"]}
    for name, row in rows.items():
        kind = name.partition(" ")[2]
        if kind in BOUNDS:
            assert abs(row["measured"] - row["truth"]) < BOUNDS[kind], name
        elif kind == "sensitivity":
            assert row["measured"] == pytest.approx(row["truth"], rel=SENSITIVITY), name
        elif kind == "R²":
            assert row["measured"] > 0.999, name
    assert sum(name.partition(" ")[2] in (*BOUNDS, "sensitivity", "R²") for name in rows) == 13


@pytest.mark.parametrize(("fidelity", "cycles"), mostly_at_night(("draft", 3), ("normal", 5)))
def test_demo_agrees_with_the_truth_and_writes_reports(fidelity: str, cycles: int, tmp_path: Path) -> None:
    """One seed: no sample lost, every cycle, every figure within its bound, reports marked SIMULATED."""
    content = demo(tmp_path, "--seed", "11", "--fidelity", fidelity, "--cycles", str(cycles))
    assert content["simulated"] is True
    assert content["lost_samples"] == 0
    assert content["cycles"] == {"complete": cycles, "partial": 0, "with_gap": 0}
    check_against_truth(content)
    assert all(sensor["posterior"]["converged"] for sensor in content["sensors"])
    assert content["truth"]["sensors"][0]["snr_db"] == pytest.approx(44.7, abs=0.1)
    assert content["shadow"]["largest_deviation_mm"] < 0.5
    for name in content["reports"]:
        assert Path(name).stat().st_size > 50_000
    verdict = call("verify", content["recording"])
    assert (verdict["identical"], verdict["results"]) == (True, 1)
    html = next(Path(name) for name in content["reports"] if name.endswith(".html"))
    assert "SIMULATED" in html.read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.parametrize("unit", ["SA2-falling", "SA3"])
def test_demo_agrees_for_other_specimens_and_polarity(unit: str, tmp_path: Path) -> None:
    """Specimens with other cubics, and one whose signal falls with elongation, within the same bounds."""
    content = demo(tmp_path, "--unit", unit, "--seed", "5", "--cycles", "2", "--no-mcmc", "--no-report")
    check_against_truth(content)
    rising = content["sensors"][0]["calibration"]["coefficients"][1] > 0
    assert rising is not unit.endswith("falling")


@pytest.mark.nightly
def test_demo_agrees_for_twenty_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Twenty seeds, every one within the bounds; the spread is printed."""
    errors: dict[str, list[float]] = {}
    for seed in range(20):
        content = demo(tmp_path, "--seed", str(seed), "--no-mcmc", "--no-report")
        check_against_truth(content)
        for row in content["comparison"]:
            errors.setdefault(row["figure"], []).append(row["measured"] - (row["truth"] or 0.0))
    with capsys.disabled():
        for name, values in errors.items():
            e = np.array(values)
            print(f"{name:26s} mean {e.mean():+9.4f}  sd {e.std(ddof=1):8.4f}  {e.min():+9.4f} .. {e.max():+9.4f}")
