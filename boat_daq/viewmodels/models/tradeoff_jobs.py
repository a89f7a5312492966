"""What the trade-off page computes in a helper process: methods measured, and the maps of one method swept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from analysis.arrays import FloatArray
from analysis.progress import Progress
from boat_daq.engine.display.ring_buffer import MinMaxPyramid, fold_columns

if TYPE_CHECKING:
    from analysis.tradeoff.decimation import Curve, Paint
    from analysis.tradeoff.measure import Method


def live_plot(paint: Paint | None = None) -> Method:
    """Return the method of the live plot, with what `paint` takes where it is given."""
    from analysis.tradeoff.decimation import decimation

    return decimation(_stored, paint)


def _stored(record: FloatArray) -> Curve:
    from analysis.tradeoff.decimation import WIDTH_PX

    pyramid = MinMaxPyramid(*record.shape)
    pyramid.append(record)
    return lambda end_s, points: fold_columns(pyramid.draw(0.0, end_s, points), end_s / WIDTH_PX)


def measure_methods(
    names: Sequence[str], quick: bool, paint: Paint | None = None, *, progress: Progress | None = None
) -> dict[str, Any]:
    """Measure methods one after the other; return what `boat-daq tradeoff --json` prints.

    Parameters
    ----------
    names : of methods, as the command takes them.
    quick : fewer settings and repeats.
    paint : paints a curve of the live plot; without it the curve is fetched only.
    progress : is called with what is done and the total.
    """
    from analysis.tradeoff.measure import measure_all
    from analysis.tradeoff.methods import METHODS
    from analysis.tradeoff.report import report_json

    known = METHODS | {"decimation": live_plot(paint)}
    results = measure_all([known[name] for name in names], quick=quick, progress=progress)
    return report_json(results, quick=quick)


def sweep_method(name: str, *, progress: Progress | None = None) -> dict[str, Any]:
    """Sweep every map of a method; return what `boat-daq atlas --json` prints.

    Raises
    ------
    RequestError : there is no such method.
    """
    from analysis.atlas.methods import chosen_studies
    from analysis.atlas.report import atlas_json
    from analysis.atlas.sweep import sweep_all

    return atlas_json(sweep_all(chosen_studies([name]), progress))
