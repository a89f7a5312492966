"""What accuracy costs: time against error of every method, on this machine."""

from __future__ import annotations

from analysis.tradeoff.measure import Measured, Method, Point, Setting, choose, front_of, measure
from analysis.tradeoff.methods import METHODS
from analysis.tradeoff.report import measured_from, report_json, write_report

__all__ = [
    "METHODS",
    "Measured",
    "Method",
    "Point",
    "Setting",
    "choose",
    "front_of",
    "measure",
    "measured_from",
    "report_json",
    "write_report",
]
