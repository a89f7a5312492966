"""The methods that the analysis can measure, by name; the program adds its own (see the command)."""

from __future__ import annotations

from analysis.studies.tradeoff.jobs import CALIBRATION, REPORT, SWEEP
from analysis.studies.tradeoff.measure import Method
from analysis.studies.tradeoff.mechanics import BASIS, MESH
from analysis.studies.tradeoff.metrology import BOOTSTRAP, INVERSE, SEGMENTATION
from analysis.studies.tradeoff.posterior import POSTERIOR
from analysis.studies.tradeoff.rays import RANKING, TRACER

STEPS = (TRACER, RANKING, MESH, BASIS, POSTERIOR, INVERSE, SEGMENTATION, BOOTSTRAP)
JOBS = (CALIBRATION, REPORT, SWEEP)
METHODS: dict[str, Method] = {m.name: m for m in (*STEPS, *JOBS)}
