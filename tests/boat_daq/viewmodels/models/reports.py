"""Results of a trade-off and of an atlas, as their commands write them."""

from __future__ import annotations


def point(setting, seconds, error, **more):
    return {
        "setting": setting, "seconds": seconds, "error": error, "spread": 0.0, "cpu_seconds": seconds,
        "cpu_spread": 0.0, "error_spread": 0.0, "repeats": 2,
    } | more  # fmt: skip


def report(name="inverse", processor="this one", date="2026-01-02T00:00:00", points=None):
    """A result as the command prints it."""
    method = {
        "name": name, "title": "Inverse", "reference": "closed form", "consumer": "the reader", "tolerance": 0.02,
        "unit": "mm", "per": "a value", "points": points or [point("fine", 2.0, 0.001), point("rough", 1.0, 0.1)],
        "front": ["rough", "fine"], "default": "fine", "chosen": "fine", "verdict": "the default is the choice",
    }  # fmt: skip
    return {
        "machine": {"processor": processor, "date_utc": date}, "quick": True, "margin": 2.0, "methods": [method]
    }  # fmt: skip
