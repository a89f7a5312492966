"""Drawings of a report without anything to draw."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas

from analysis import Analysis, analyse
from analysis import figure_style as style
from analysis.calibration.type_b import contributions
from analysis.figures.uncertainty import middle_budgets
from analysis.reports import drawings
from analysis.reports.build import build_report, write_report
from analysis.reports.document import ReportDrawing
from analysis.reports.drawings import AXES_RIGHT, as_svg, set_drawing
from tests.analysis.boat_builder import Plant, triangle


@pytest.mark.parametrize("vented", [False, True])
def test_a_continuous_run_whose_sensors_see_nothing_draws_without_a_warning(tmp_path: Path, vented: bool) -> None:
    """No full scale, or no cycle at all: no curve, so nothing that a legend could name."""
    pressure, loading, cycle = triangle(4, 10)
    recording = Plant(cubics=((1650.0,),) * 2).run(0.0 * pressure if vented else pressure, loading, cycle)
    from analysis import Recording

    signal = np.full_like(recording.signal_mv, 1650.0)
    analysis = analyse(Recording.from_arrays(recording.time_s, recording.pressure_kpa, signal), mcmc=False)
    for draw in (partial(drawings.loop_difference, analysis, None), partial(drawings.drift_of_levels, analysis, 0)):
        assert as_svg(ReportDrawing((draw,), ""), 7.0)[0].startswith("<svg")
    write_report([analysis], tmp_path / "r.html")
    assert "<svg" in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_the_trace_is_broken_at_a_gap() -> None:
    """Samples lost from 3 to 6 s, the pressure 0 kPa before and 40 kPa after: two pieces, of one value each."""
    time = np.r_[0.0:3.0:0.01, 6.0:9.0:0.01]
    recording = SimpleNamespace(
        n=600, time_s=time, pressure_kpa=np.where(time < 4.0, 0.0, 40.0), gaps=(SimpleNamespace(row=299),), meta={}
    )
    ax = Canvas().add_subplot()
    drawings.trace(SimpleNamespace(recording=recording, cycles=SimpleNamespace(used=(), partial=())), ax)
    drawn = [path.get_extents() for path in ax.collections[0].get_paths()]
    assert [(piece.y0, piece.y1) for piece in drawn] == [(0.0, 0.0), (40.0, 40.0)]
    assert drawn[0].x1 < 3.0 < 6.0 <= drawn[1].x0


def test_no_legend_covers_data_and_no_label_leaves_its_drawing(calibration: Analysis) -> None:
    """Every drawing of a calibration report, at the widths of PDF and HTML: legends above, labels beside their axes."""
    given = contributions({"scale": {"u_percent": 1.0}, "parallax": {"u_mm": 0.2}})
    stated = replace(calibration, options=replace(calibration.options, type_b=given))
    calibration = replace(calibration, budgets=middle_budgets(stated))
    drawn = [part for s in build_report([calibration]).sections for part in s.parts if isinstance(part, ReportDrawing)]
    seen = labels = 0
    for drawing in drawn:
        for width in (6.8, 5.4):
            canvas = Canvas(figsize=(width, drawing.height))
            FigureCanvasAgg(canvas)
            with mpl.rc_context(style.RC):
                set_drawing(canvas, drawing, 0.0, 0.0, width)
                canvas.draw_without_rendering()
            for ax in canvas.axes:
                for label in (*ax.get_yticklabels(), *ax.texts):
                    labels += bool(label.get_text())
                    assert label.get_window_extent().x0 >= -1.0
                    right = ax.get_window_extent().x1 + 72.0 * AXES_RIGHT if label in ax.texts else canvas.bbox.x1
                    assert label.get_window_extent().x1 <= right + 1.0
                legend = ax.get_legend()
                if legend is not None:
                    seen += 1
                    box = legend.get_window_extent()
                    assert box.y0 >= ax.get_window_extent().y1 - 1.0
                    assert box.x1 <= canvas.bbox.x1 + 1.0
                    assert box.y1 <= ax._left_title.get_window_extent().y0 + 1.0  # type: ignore[attr-defined]
    assert seen >= 8
    assert labels > 90
