"""The published figures of the two sensors of unit SA1, for analysis, reports and studies.

The virtual board has its own truth (`protocol.simulator.specimens`); a test compares the two.
"""

from __future__ import annotations

from dataclasses import dataclass

UNIT = "SA1"
RANGE_MM = (-2.7, 3.8)  # of elongation: the only one whose end points give both published sensitivities
SYSTEM_SENSITIVITY_MV_PER_MM = 34.2
LOOP_HALF_WIDTH_MM = 0.35
"""How far from its nominal elongation the hysteresis of a healthy actuator may take it (decision 0083)."""


@dataclass(frozen=True, slots=True)
class PublishedSensor:
    """One sensor: its cubic y(x), mV over mm, b0 first, and its figures."""

    coefficients: tuple[float, float, float, float]
    r2: float
    sensitivity_mv_per_mm: float
    snr_db: float
    system_hysteresis_percent_fso: float


SENSORS = (
    PublishedSensor((1651.9842, 46.4413, -2.6934, -0.36251), 0.99971, 39.3, 44.7, 4.95),
    PublishedSensor((1624.5567, 33.37911, -2.3102, -0.14139), 0.99991, 29.2, 45.2, 4.46),
)
NOISE_MV = (1.49, 1.04)  # derived: full-scale output / 10^(SNR / 20)
