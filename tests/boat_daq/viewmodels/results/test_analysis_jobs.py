"""The analysis of a run in a helper process."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from analysis.figures.acceptance import against_published
from analysis.figures.figure import SENSOR_FIGURES, Figure, Reason
from boat_daq.viewmodels.results.analysis_jobs import figure_text, report_runs, sample_run


def test_analysis_returns_what_the_page_draws(result):
    """Points, curve and loops of both sensors, near the unit's own figures."""
    assert (result.unit, result.cycles, result.simulated, result.calibrated) == ("SA1", 2, True, True)
    for sensor, expected in zip(result.sensors, (39.3, 29.2), strict=True):
        fit = sensor.fit
        assert sensor.x.size == sensor.y.size == fit.residuals.size == sensor.loading.size
        assert np.all(np.diff(fit.grid) > 0)
        assert np.all(fit.band_95[0] <= fit.band_68[0])
        assert np.all(fit.band_68[0] <= fit.curve)
        assert fit.content["figures"]["sensitivity_mv_per_mm"] == pytest.approx(expected, rel=0.05)
    labels = {name.partition(", limit ")[0] for (name, _), *_ in result.figures}
    assert labels <= {f"{d.label}\n{d.unit}" for d in SENSOR_FIGURES.values()} | {"Curve"}
    verdicts = next(cells for (name, _), *cells in result.figures if name == "Curve")
    assert {text for text, _ in verdicts} <= {"adequate", "doubtful", "inadequate"}
    assert all(u.shape == (41, 2) and (u[:, 1] > 0).all() for u in result.u_elongation)
    assert len(labels) > 9


def test_sampled_curve_lies_inside_its_bands(result):
    """The residuals are about the mean of the posterior, near those of the fit; the widest band is a new reading's."""
    sensor = result.sensors[0]
    points = [(sensor.x.tolist(), sensor.y.tolist(), 3, None)]
    (found,) = sample_run(points, result.reading_sd_mm, "draft")
    assert 0.0 < found.content["band_error_percent_fso"] <= 1.0
    assert found.residuals == pytest.approx(sensor.y - np.interp(sensor.x, found.grid, found.curve))
    assert found.residuals == pytest.approx(sensor.fit.residuals, abs=5.0)
    bands = (found.new_reading_95, found.band_95, found.band_68, (found.curve, found.curve))
    for outer, inner in pairwise(bands):
        assert np.all((outer[0] <= inner[0]) & (inner[1] <= outer[1]))


def test_figure_text_has_value_interval_and_conformity():
    """A figure's cell is its value, marked by its conformity, over its interval; definition, count, reason on hover."""
    figure = Figure(39.31, "mV/mm", 5, 39.0, 39.6, definition="end to end")
    text, tip = figure_text(figure, 1)
    assert text == "39.3\n39.0 to 39.6"
    assert tip == "end to end\nsecond line: 95 % confidence interval\nn = 5"
    noise = Figure(44.0, "dB", 5, 43.5, 44.5)
    sensor = SimpleNamespace(calibration=object(), name="s1", figures={"snr_db": noise})
    (stated,) = against_published(sensor)
    text, tip = figure_text(noise, 1, stated)
    assert (text, tip.splitlines()[0][:5]) == ("\u25cf 44.0\n43.5 to 44.5", "pass:")
    assert figure_text(Figure.nothing("dB", Reason.NO_FULL_SCALE, "no span"), 1)[0] == "\u2013"
    assert figure_text(None, 1)[0] == "\u2013"


def test_table_of_figures_names_unit_and_limit_below_each_figure(result):
    """The intervals and limits are the product: they were on hover only."""
    texts = {cells[0][0]: [text for text, _ in cells[1:]] for cells in result.figures}
    hysteresis = texts["Hysteresis, system\n% FSO, limit \u2264 5"]
    assert [" to " in text for text in hysteresis] == [True, True]
    assert "Noise, rms\nmV" in texts


def test_uncertainty_names_what_was_not_assessed_and_the_published_limits(result):
    """Components with their share, those without a value, U, traceability, and a statement for each limit."""
    rows = {name: cells for (name, _), *cells in result.uncertainty}
    assert {"Parallax", "Temperature", "Expanded uncertainty", "Traceable"} <= rows.keys()
    assert {text for text, _ in rows["Parallax"]} == {"not assessed"}
    assert {text for text, _ in rows["Traceable"]} == {"no"}
    assert all("not assessed: scale of grid or photograph" in tip for _, tip in rows["Traceable"])
    assert all(text.endswith(" \u00b5m") and "% of the variance" in tip for text, tip in rows["Noise"])
    limit = rows["Hysteresis, system\n\u2264 5 % FSO"]
    whole, partly = {"\u25cf pass", "\u25b2 fail"}, {"\u25d0 pass\nconditional", "\u25b3 fail\nconditional"}
    assert {text for text, _ in limit} <= whole | partly
    assert all("ILAC-G8" in tip for _, tip in limit)
    assert result.sensors[0].fit.content["type_b"] == {}


def test_report_progress_rises_through_its_parts(monkeypatch, tmp_path):
    """Each run's analysis, then the pages: the fraction rises from part to part and ends at one."""
    seen, levels = [], []

    def in_steps(result):
        def work(*_, progress, options=None, **__):
            levels.extend([options.fidelity] if options is not None else [])
            for step in (1, 2):
                progress(step, 2)
            return result

        return work

    monkeypatch.setattr("analysis.load_recording", lambda path: SimpleNamespace(unit="", simulated=True, identity="a"))
    monkeypatch.setattr("analysis.figures.pipeline.analyse", in_steps("analysed"))
    monkeypatch.setattr("analysis.write_report", in_steps(SimpleNamespace(verdict="PASSES")))
    runs, target = [Path("a.boat"), Path("b.boat")], tmp_path / "r.pdf"
    progress = lambda done, total: seen.append(done / total)  # noqa: E731
    assert report_runs(runs, target, level="draft", progress=progress) == "PASSES"
    assert seen == [0.125, 0.25, 0.375, 0.5, 0.75, 1.0]
    assert levels == ["draft", "draft"]
