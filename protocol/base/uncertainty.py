"""The coverage factor of every expanded uncertainty (GUM, JCGM 100:2008, 6.2)."""

from __future__ import annotations

COVERAGE_FACTOR = 2.0  # about 95 % of a normal distribution
