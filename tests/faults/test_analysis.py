"""Faults of data that the other tests of the analysis do not inject."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import fit_calibration, load_recording, sample_posterior
from analysis.calibration.checks import calibration_warnings
from analysis.optics.scene.curves import default_curves, frames_of
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import trace
from analysis.segmentation.loops import loop_width
from tests.analysis.boat_builder import PAPER

X = np.tile(np.linspace(-2.7, 3.8, 10), 9)
TRUTH = np.polynomial.Polynomial(PAPER[0])


@pytest.mark.fault(42, how="branches that do not overlap, and branches that overlap in part", times=2)
def test_loop_width_is_undefined_without_overlap() -> None:
    """The loop width is undefined, with the reason; where they overlap it is their distance there."""
    low, high = np.array([-40.0, -20.0, -10.0]), np.array([10.0, 30.0, 50.0])
    apart = loop_width(np.array([[low], [high]]), np.array([[low], [high + 3.0]]), np.ones((5, 1)))
    assert np.isnan(apart.mean_loop)
    assert "share no stretch" in apart.void
    wide = np.array([-20.0, 0.0, 30.0])
    some = loop_width(np.array([[wide], [high]]), np.array([[wide], [high + 3.0]]), np.ones((5, 1)))
    assert some.mean_loop == pytest.approx(3.0)
    assert some.shared == pytest.approx(20.0 / 70.0)


@pytest.mark.fault(43, how="two of 90 points 40 standard deviations off", times=1)
def test_outliers_widen_the_band_and_are_named() -> None:
    """The band is several times wider, as wide as the scatter of the data; the worst point is named."""
    y = TRUTH(X) + 1.3 * np.random.default_rng(0).standard_normal(X.size)
    spoiled = y.copy()
    spoiled[[14, 61]] += 52.0
    clean, wide = (sample_posterior(X, values, seed=0, max_steps=600) for values in (y, spoiled))
    widths = [np.subtract(*p.curve_band(np.array([0.5]), 0.95)[::-1])[0] for p in (clean, wide)]
    # both scatters are known: 1.3 mV, and 1.3 mV with two of 90 points 52 mV off
    assert widths[1] / widths[0] == pytest.approx(np.hypot(1.3, 52.0 * np.sqrt(2 / 90)) / 1.3, rel=0.25)
    assert any(w.code == "outlier" for w in calibration_warnings(fit_calibration(X, spoiled)))
    assert not any(w.code == "outlier" for w in calibration_warnings(fit_calibration(X, y)))


def table(path: Path, **spoiled: str) -> Path:
    """Write a CSV of 40 samples in two segments; the named columns hold the given text in row 10."""
    rows = np.arange(40)
    columns = {
        "index": rows, "time_s": rows * 0.01, "pressure_kpa": 50.0 - rows, "target_kpa": 50.0 - rows,
        "s1_lit": 2000 + rows, "s1_dark": 100 + rows % 2, "state": 1 + rows // 20, "flags": 0 * rows,
        "segment": 1 + rows // 20,
    }  # fmt: skip
    text = {name: [f"{value:g}" for value in values] for name, values in columns.items()}
    for name, cell in spoiled.items():
        text[name][10] = cell
    lines = ["# vref_mv: 3300", "# adc_bits: 12", ",".join(text), *map(",".join, zip(*text.values(), strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.fault(37, how="NaN, Inf and an empty cell in each column of a table", times=32)
@pytest.mark.parametrize("cell", ["nan", "inf", "-inf", ""])
@pytest.mark.parametrize(
    ("column", "counted"),
    [
        ("time_s", "repeated_times"), ("pressure_kpa", "pressure_not_finite"), ("s1_lit", "signal_not_finite"),
        ("s1_dark", "signal_not_finite"), ("state", "implausible"), ("flags", "implausible"),
        ("segment", "implausible"), ("index", "import_notes"),
    ],
)  # fmt: skip
def test_cell_without_number_excludes_only_its_row(tmp_path: Path, column: str, counted: str, cell: str) -> None:
    """It is left out and counted; every other row keeps its state, flags and segment."""
    whole = load_recording(table(tmp_path / "whole.csv"))
    run = load_recording(table(tmp_path / "run.csv", **{column: cell}))
    count = {**run.meta, **run.masked}[counted]
    assert count == 1 or "index" in count[0]
    rows = np.delete(np.arange(40), 10) if column == "time_s" else np.arange(40)
    assert run.n == rows.size
    others = np.flatnonzero(rows != 10)
    for name in ("state", "flags", "segment"):
        assert (getattr(run, name)[others] == getattr(whole, name)[rows[others]]).all(), name
    assert run.usable[others].all()
    if column not in ("time_s", "index"):
        assert not (run.usable[10, 0] and run.pressure_usable[10])


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.fault(45, how="one scene with a million rays", times=1_000_000)
def test_million_rays_close_the_power_balance() -> None:
    """The power balance closes over every ray, and NDR agrees with that of a thousandth of the rays."""
    guide = Waveguide()
    frame = frames_of(default_curves(), guide)[7]
    many, few = (trace(frame, Design(5, 1.0, 0.5, 0.9), guide, Light(rays=rays)) for rays in (1_000_000, 1_000))
    for out, rays in ((many, 1_000_000), (few, 1_000)):
        ends = {name: count for name, count in out.ledger.items() if name != "released"}
        assert sum(ends.values()) == out.ledger["released"] >= rays
        assert np.isfinite(out.ndr)
    assert many.ledger["detected"] / 1e6 == pytest.approx(few.ledger["detected"] / 1e3, abs=0.05)
