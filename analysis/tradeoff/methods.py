"""The methods that the analysis can measure, by name; the program adds its own (see the command)."""

from __future__ import annotations

from analysis.tradeoff.measure import Method
from analysis.tradeoff.mechanics import BASIS, MESH
from analysis.tradeoff.metrology import INVERSE, POSTERIOR, SEGMENTATION
from analysis.tradeoff.optics import RANKING, TRACER

METHODS: dict[str, Method] = {m.name: m for m in (TRACER, RANKING, MESH, BASIS, POSTERIOR, INVERSE, SEGMENTATION)}
