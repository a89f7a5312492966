"""A sweep's results as JSON, text, table and figures."""

from __future__ import annotations

from pathlib import Path

from analysis.optics.scene.parameters import PAPER_OPTIMUM, Light
from analysis.optics.sweep.report import sweep_json, sweep_text, write_sweep
from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep


def test_results_have_the_keys_of_the_surface(tmp_path: Path) -> None:
    """JSON, text, table and figures all name the best, the ties and the paper's optimum."""
    result = run_sweep(SweepRequest((PAPER_OPTIMUM, *paper_grid((5,))[::60]), light=Light(rays=100)))
    content = sweep_json(result)
    assert content["simulations"] == 75
    assert {
        "cavities",
        "width_mm",
        "depth_mm",
        "spacing_mm",
        "ndr",
        "andr",
        "delta",
        "n_sign",
        "rmse",
        "p",
        "p_ci",
        "monotone",
    } <= set(content["designs"][0])
    assert content["best"]["p"] == max(d["p"] for d in content["designs"])
    assert content["paper_optimum"]["rank"] == content["designs"][0]["rank"]
    assert {k: content["best"][k] for k in ("cavities", "width_mm", "depth_mm", "spacing_mm", "face")} in content[
        "tied_with_best"
    ]
    assert "paper's optimum" in sweep_text(result)
    written = write_sweep(result, tmp_path)
    assert {path.name for path in written} >= {"p_maps_5_cavities.png", "p_maps_5_cavities.svg", "pareto.svg"}
    assert all(path.stat().st_size > 1000 for path in written)
    assert (tmp_path / "designs.csv").read_text().count("\n") == 2 + len(result.designs)
