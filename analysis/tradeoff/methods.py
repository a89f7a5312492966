"""The methods that the analysis can measure, by name; the program adds its own (see the command)."""

from __future__ import annotations

from analysis.tradeoff.jobs import CALIBRATION, REPORT, SHADOW, SWEEP
from analysis.tradeoff.measure import Method
from analysis.tradeoff.mechanics import BASIS, MESH
from analysis.tradeoff.metrology import BOOTSTRAP, INVERSE, SEGMENTATION
from analysis.tradeoff.optics import RANKING, TRACER
from analysis.tradeoff.posterior import POSTERIOR

STEPS = (TRACER, RANKING, MESH, BASIS, POSTERIOR, INVERSE, SEGMENTATION, BOOTSTRAP)
JOBS = (CALIBRATION, REPORT, SWEEP, SHADOW)
METHODS: dict[str, Method] = {m.name: m for m in (*STEPS, *JOBS)}
