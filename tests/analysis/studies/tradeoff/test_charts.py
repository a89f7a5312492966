"""The quick run's report: keys of the surface, files, and defaults that the program really uses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.studies.tradeoff.charts import report_json, write_report
from analysis.studies.tradeoff.jobs import METHODS
from analysis.studies.tradeoff.measure import Measured, measure


@pytest.fixture(scope="module")
def inverse() -> Measured:
    """The cheapest method, measured."""
    return measure(METHODS["inverse"], quick=True)


def test_newton_is_exact_and_tables_are_not(inverse: Measured) -> None:
    """Newton has its error of 1e-10 mm or less; a table errs more, and less with four times the nodes."""
    errors = {p.setting: p.error for p in inverse.points}
    assert errors["Newton"] < 1e-10 < errors["table of 65"] < errors["table of 17"]


def test_the_verdict_names_a_default_that_the_rule_does_not_choose(inverse: Measured) -> None:
    """The verdict names both settings, and only the default where they agree."""
    other = replace(inverse, chosen="table of 65")
    assert "the rule chooses table of 65, the default is Newton" in other.verdict
    assert "is the cheapest" in replace(inverse, chosen="Newton").verdict


def test_files_and_keys(inverse: Measured, tmp_path: Path) -> None:
    """JSON with the surface's keys, CSV with a row a point, and every chart twice."""
    files = write_report([inverse], tmp_path, quick=True)
    content = json.loads((tmp_path / "tradeoff.json").read_text())
    assert {"machine", "methods"} <= content.keys()
    method = content["methods"][0]
    assert {"name", "reference", "consumer", "tolerance", "unit", "points", "front", "default"} <= method.keys()
    assert all({"setting", "seconds", "error", "spread"} <= p.keys() for p in method["points"])
    assert method["default"] in {p["setting"] for p in method["points"]}
    assert len((tmp_path / "tradeoff.csv").read_text().splitlines()) == len(inverse.points) + 1
    assert {f.suffix for f in files} == {".json", ".csv", ".png", ".svg"}
    assert all(f.stat().st_size > 0 for f in files)


def test_a_failed_setting_is_null(inverse: Measured) -> None:
    """JSON has no infinity: the error of a setting that failed is null."""
    failed = replace(inverse, points=(replace(inverse.points[0], error=float("inf")),))
    assert report_json([failed], quick=True)["methods"][0]["points"][0]["error"] is None
