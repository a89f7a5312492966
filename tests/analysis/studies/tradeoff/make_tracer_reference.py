"""Makes `references/tracer.json`: counts by the second tracer, which shares no line with ours.

Run as `python make_tracer_reference.py`; about ten minutes. Of one design at several states
with many
rays, and of every 27th design of the paper's grid at all states; guides bowed by the parametric sines; secondaries in
proportion to the rays.
"""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

import numpy as np

from analysis.optics.scene.curves import frames_of, parametric_curves
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.outline import outline
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sweep.sweep import paper_grid
from tests.analysis.optics.second_tracer import detected, read

STATES = (0, 3, 7, 11, 14)
RAYS, RANKING_RAYS = 1_000_000, 50_000
EVERY = 27
PHASE = 0.47


def ndr(frame: SceneFrame, design: Design, rays: int, phase: float = PHASE) -> float:
    """Return the rays that reach the receiver, scaled to 250."""
    shape, light = outline(frame, design), Light()
    budget = round(light.secondary * rays / light.rays)
    return 250.0 * detected(read(shape), shape, rays, budget, phase=phase) / rays


def made() -> dict[str, object]:
    """Return the table."""
    curves = np.round(parametric_curves(), 6)
    frames = frames_of(curves, Waveguide())
    designs = paper_grid()[::EVERY]
    return {
        "method": "tests/analysis/optics/second_tracer.py: every segment of the outline, textbook circles, a heap",
        "made": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
        "phase": PHASE,
        "curves_mm": curves.tolist(),
        "states": list(STATES),
        "rays": RAYS,
        "ndr": [ndr(frames[s], PAPER_OPTIMUM, RAYS) for s in STATES],
        "every": EVERY,
        "ranking_rays": RANKING_RAYS,
        "ranking_ndr": [[round(ndr(frame, design, RANKING_RAYS), 6) for frame in frames] for design in designs],
    }


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "analysis/studies/tradeoff/references/tracer.json")
    target.write_text(json.dumps(made()) + "\n", encoding="utf-8")
