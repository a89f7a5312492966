"""Time against error of every method, measured on this machine."""

from __future__ import annotations

from analysis.tradeoff.measure import CostPoint, Measured, Method, Setting, choose, front_of, measure, measure_all
from analysis.tradeoff.methods import METHODS
from analysis.tradeoff.report import measured_from, report_json, write_report

__all__ = [
    "METHODS",
    "CostPoint",
    "Measured",
    "Method",
    "Setting",
    "choose",
    "front_of",
    "measure",
    "measure_all",
    "measured_from",
    "report_json",
    "write_report",
]
