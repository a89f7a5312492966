"""The report of a measurement: JSON as the surface has it, a CSV of all points, charts as PNG and SVG.

Rules: the JSON has all that the charts show; an error that is infinite (the method failed) is null in it.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import matplotlib as mpl

from analysis import figure_style as style
from analysis.fidelity import LEVELS, MARGINS
from analysis.machine import machine
from analysis.tradeoff.chart import method_chart, overview_chart
from analysis.tradeoff.measure import MARGIN, CostPoint, Measured, Method

MAY_BE_INFINITE = ("error", "error_spread")
NO_DATE: dict[str, dict[str, Any]] = {"png": {}, "svg": {"Date": None}}
TIMING = (
    "seconds: median by the clock of a call, spread: greatest less smallest; cpu_seconds: median processor time, which "
    "front and choice compare, cpu_spread likewise; error: root mean square over the repeats; first_seconds: the first "
    "call, which prepares and compiles and is in no median"
)


def report_json(results: Sequence[Measured], *, quick: bool) -> dict[str, Any]:
    """Return what `tradeoff --json` prints."""
    return {
        "machine": machine(),
        "quick": quick,
        "timing": TIMING,
        "margin": MARGIN,
        "margins": MARGINS,
        "methods": [_method_json(m) for m in results],
    }


def measured_from(content: Mapping[str, Any], methods: Mapping[str, Method]) -> list[Measured]:
    """Return the results that a report was written from, compared with the methods as they are now.

    Parameters
    ----------
    content : of tradeoff.json; methods that are unknown now are left out.
    """
    kept = [(methods[m["name"]], m["points"]) for m in content["methods"] if m["name"] in methods]
    return [Measured.of(method, [_point_from(p) for p in points]) for method, points in kept]


def _point_from(row: Mapping[str, Any]) -> CostPoint:
    infinite = {name: math.inf for name in MAY_BE_INFINITE if row[name] is None}
    return CostPoint(**{**row, **infinite})


def _method_json(measured: Measured) -> dict[str, Any]:
    method = measured.method
    return {
        "name": method.name,
        "title": method.title,
        "reference": f"{method.reference}; {'independent' if method.independent else 'not independent'}",
        **{name: getattr(method, name) for name in ("independent", "consumer", "tolerance", "unit", "per")},
        "points": [_point_json(p) for p in measured.points],
        "front": list(measured.front),
        "default": method.default,
        "chosen": measured.chosen,
        "default_is_chosen": measured.default_is_chosen,
        "fidelity": {k: {"chosen": measured.levels[k], "in_code": method.in_code[k]} for k in LEVELS},
        "verdict": measured.verdict,
    }


def _point_json(point: CostPoint) -> dict[str, Any]:
    row = asdict(point)
    return row | {name: row[name] if math.isfinite(row[name]) else None for name in MAY_BE_INFINITE}


def write_report(results: Sequence[Measured], folder: Path, *, quick: bool) -> list[Path]:
    """Write tradeoff.json, tradeoff.csv and the charts; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    content = report_json(results, quick=quick)
    files = [folder / "tradeoff.json", folder / "tradeoff.csv"]
    files[0].write_text(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False), encoding="utf-8")
    _write_csv(content, files[1])
    where = "{processor}, {cores} cores, Python {python}, {date_utc}".format(**content["machine"])
    with mpl.rc_context(style.RC):
        charts = {measured.method.name: method_chart(measured, where) for measured in results}
        charts["overview"] = overview_chart(results, where)
        for name, figure in charts.items():
            for kind in ("png", "svg"):
                files.append(folder / f"{name}.{kind}")
                figure.savefig(files[-1], dpi=110, metadata=NO_DATE[kind])
    return files


def _write_csv(content: dict[str, Any], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        columns = [column.name for column in fields(CostPoint)]
        table.writerow(["method", *columns, "unit", "tolerance", "on_front", "default", "chosen"])
        for method in content["methods"]:
            for point in method["points"]:
                name = point["setting"]
                marks = (name in method["front"], name == method["default"], name == method["chosen"])
                row = [point[c] for c in columns]
                table.writerow([method["name"], *row, method["unit"], method["tolerance"], *map(int, marks)])
