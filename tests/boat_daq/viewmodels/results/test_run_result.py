"""The analysis of a run in a helper process."""

from __future__ import annotations

import dataclasses
import pickle
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from analysis.figures.figure import SENSOR_FIGURES
from boat_daq.viewmodels.results.run_result import analyse_run, sample_run
from tests.boat_daq.viewmodels.helpers import SAMPLE


def test_analysis_returns_what_the_page_draws(result):
    """Points, curve and loops of both sensors, near the unit's own figures."""
    assert (result.unit, result.cycles, result.simulated, result.calibrated) == ("SA1", 2, True, True)
    for sensor, expected in zip(result.sensors, (39.3, 29.2), strict=True):
        fit = sensor.fit
        assert sensor.x.size == sensor.y.size == fit.residuals.size == sensor.loading.size
        assert np.all(np.diff(fit.grid) > 0)
        assert np.all(fit.band_95[0] <= fit.band_68[0])
        assert np.all(fit.band_68[0] <= fit.curve)
        assert sensor.record.figures["sensitivity_mv_per_mm"] == pytest.approx(expected, rel=0.05)
    labels = {name.partition(", limit ")[0] for (name, _), *_ in result.figures}
    assert labels <= {f"{d.label}\n{d.unit}" for d in SENSOR_FIGURES.values()} | {"Curve"}
    verdicts = next(cells for (name, _), *cells in result.figures if name == "Curve")
    assert {text for text, _ in verdicts} <= {"adequate", "doubtful", "inadequate"}
    assert all(u.shape == (41, 2) and (u[:, 1] > 0).all() for u in result.u_elongation)
    assert len(labels) > 9


def test_result_is_taken_without_the_libraries_of_the_analysis(result, tmp_path):
    """SciPy and pandas would take seconds of the window's thread, which a run under pressure does not survive."""
    stored = tmp_path / "result.pickle"
    stored.write_bytes(pickle.dumps(result))
    code = (
        "import pickle, sys; from pathlib import Path; from boat_daq.viewmodels import app_model; "
        f"pickle.loads(Path({str(stored)!r}).read_bytes()); "
        "print([name for name in ('scipy', 'pandas', 'numba') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_first_result_has_the_same_curve():
    """The curve that is shown at once is that of the whole analysis; its intervals are marked as rough."""
    firsts = []
    result = analyse_run(str(SAMPLE), first=firsts.append)
    (first,) = firsts
    assert (first.preliminary, result.preliminary) == (True, False)
    assert first.sensors[0].fit.curve == pytest.approx(result.sensors[0].fit.curve)
    assert first.verdict.headline == result.verdict.headline


def test_sampled_curve_is_that_of_the_fit(result):
    """One model, computed in two ways: equal curves and widths, without the loop; a suspect one keeps its misfit."""
    sensor = result.sensors[0]
    bent = dataclasses.replace(sensor.record, signal_mv=1650.0 + 8.0 * np.round(sensor.y / 8.0 - 1650.0 / 8.0))
    found, suspect = sample_run([sensor.record, bent], "draft")
    fit = sensor.record.fit
    assert found.sampler["coefficients"]["sd"] == pytest.approx(fit["std_errors_with_reading"], rel=0.2)
    assert found.curve == pytest.approx(sensor.fit.curve, abs=0.05)
    assert 0.0 < found.sampler["band_error_percent_fso"] <= 1.0
    assert found.residuals == pytest.approx(sensor.y - np.interp(sensor.x, found.grid, found.curve))
    known = bent.calibration()
    assert known.deviation(suspect.grid).any()
    inner = known.band(suspect.grid, 0.95)
    assert np.all((suspect.band_95[0] <= inner[0]) & (inner[1] <= suspect.band_95[1]))
    bands = (found.new_reading_95, found.band_95, found.band_68, (found.curve, found.curve))
    for outer, inner in pairwise(bands):
        assert np.all((outer[0] <= inner[0]) & (inner[1] <= outer[1]))


def test_table_of_figures_names_unit_and_limit_below_each_figure(result):
    """The intervals and limits are the product: they were on hover only."""
    texts = {cells[0][0]: [text for text, _ in cells[1:]] for cells in result.figures}
    hysteresis = texts["Hysteresis, system\n% FSO, limit \u2264 5"]
    assert [" to " in text for text in hysteresis] == [True, True]
    assert "Noise, rms\nmV" in texts


def test_uncertainty_names_what_was_not_assessed_and_the_published_limits(result):
    """Components with their share, those without a value, U, traceability, and a statement for each limit."""
    rows = {name: cells for (name, _), *cells in result.uncertainty}
    assert {"Parallax", "Temperature", "Traceable"} <= rows.keys()
    assert {text for text, _ in rows["Parallax"]} == {"not assessed"}
    assert {text for text, _ in rows["Traceable"]} == {"no"}
    assert all("no uncertainty is given for scale of grid or photograph" in tip for _, tip in rows["Traceable"])
    assert all(text.endswith(" mm") and "% of the variance" in tip for text, tip in rows["Noise"])
    limit = rows["Hysteresis, system\n\u2264 5 % FSO"]
    whole, partly = {"\u25cf pass", "\u25b2 fail"}, {"\u25d0 pass\nconditional", "\u25b3 fail\nconditional"}
    assert {text for text, _ in limit} <= whole | partly
    assert all("ILAC-G8" in tip for _, tip in limit)
    assert result.sensors[0].record.type_b == {}
