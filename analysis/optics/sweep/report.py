"""A sweep's and a search's results for the command line, files and other programs; nothing is computed here."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from analysis.optics.scene.parameters import Design
from analysis.optics.sweep import drawings as figures
from analysis.optics.sweep.figure_of_merit import PARTING, Merit
from analysis.optics.sweep.optimise import BETTER, PATIENCE, Optimum
from analysis.optics.sweep.sweep import SweepResult
from analysis.version import program_version


def sweep_json(result: SweepResult) -> dict[str, Any]:
    """Return the object of `optics sweep --json`."""
    merit, spread, ranks = result.merit(), result.uncertainty(), result.ranks()
    power = result.merit_of_power()
    designs = [
        {
            **asdict(d),
            "ndr": result.ndr[i],
            "andr": merit.andr[i],
            "delta": merit.delta[i],
            "n_sign": int(merit.n_sign[i]),
            "rmse": merit.rmse[i],
            "p": merit.p[i],
            "p_printed": merit.p_printed[i],
            "p_normalised": merit.p_normalised[i],
            "p_ci": spread.p_ci[i],
            "monotone": bool(merit.monotone[i]),
            "rmse_floored": bool(merit.floored[i]),
            "rank": int(ranks[i]),
            "tied": bool(spread.tied[i]),
            "power": result.power[i],
            "p_power": power.p[i],
        }
        for i, d in enumerate(result.designs)
    ]
    best = int(np.argmax(merit.p))
    paper = result.find()
    return {
        "simulations": result.ndr.size,
        "simulated_now": result.simulated,
        "seconds": result.seconds,
        "hits": result.hits,
        "rays": result.request.light.rays,
        "version": program_version(),
        "designs": designs,
        "best": designs[best],
        "tied_with_best": [asdict(d) for i, d in enumerate(result.designs) if spread.tied[i]],
        "paper_optimum": None
        if paper is None
        else {
            "rank": int(ranks[paper]),
            "p": merit.p[paper],
            "p_ci": spread.p_ci[paper],
            "tied": bool(spread.tied[paper]),
            "rank_by_power": int(1 + np.sum(power.p > power.p[paper])),
        },
        "printed_and_repaired": PARTING,
    }


def _line(label: str, design: Design, merit: Merit, i: int) -> str:
    return (
        f"{label}: {design.cavities} cavities, width {design.width_mm:g}, depth {design.depth_mm:g}, "
        f"spacing {design.spacing_mm:g} mm: P {merit.p[i]:.3f}, Delta {merit.delta[i]:.1f}, "
        f"n_sign {merit.n_sign[i]:.0f}, RMSE {merit.rmse[i]:.2f}"
    )


def sweep_text(result: SweepResult) -> str:
    """Return the same as a few lines of text."""
    merit, spread = result.merit(), result.uncertainty()
    best, paper = int(np.argmax(merit.p)), result.find()
    lines = [
        f"{result.ndr.size} simulations, {result.simulated} now, in {result.seconds:.2f} s, {result.hits} hits",
        _line("best", result.designs[best], merit, best),
        f"95 % interval of its P: {spread.p_ci[best, 0]:.3f} to {spread.p_ci[best, 1]:.3f}; "
        f"{int(spread.tied.sum())} of {len(result.designs)} designs equal within noise",
    ]
    if paper is not None:
        lines += [
            _line(f"paper's optimum, rank {result.ranks()[paper]}", result.designs[paper], merit, paper),
            f"it is {'' if spread.tied[paper] else 'not '}equal to the best within noise",
        ]
    return "\n".join(lines)


def write_sweep(result: SweepResult, folder: Path) -> list[Path]:
    """Write `designs.csv` and the figures (PNG and SVG) beside the results file; returns the paths."""
    table = folder / "designs.csv"
    _write_table(result, table)
    best = result.designs[int(np.argmax(result.merit().p))]
    counts = sorted({d.cavities for d in result.designs})
    drawn = {
        "response": figures.draw_response(result, list(dict.fromkeys([best, *_paper(result)]))),
        "pareto": figures.draw_pareto(result),
        **{f"p_maps_{n}_cavities": figures.draw_maps(result, n) for n in counts},
    }
    paths = [table]
    for name, figure in drawn.items():
        for suffix in (".png", ".svg"):
            paths.append(folder / f"{name}{suffix}")
            figures.save(figure, paths[-1])
    return paths


def _paper(result: SweepResult) -> list[Design]:
    found = result.find()
    return [] if found is None else [result.designs[found]]


def _write_table(result: SweepResult, path: Path) -> None:
    """One row per design; parameters and version in comment lines at the head."""
    merit, spread, ranks = result.merit(), result.uncertainty(), result.ranks()
    states = range(result.ndr.shape[1])
    with path.open("w", newline="", encoding="utf-8") as file:
        parameters = json.dumps(result.request.described(), sort_keys=True)
        file.write(f"# boat-daq {program_version()}, parameters {parameters}\n")
        rows = csv.writer(file)
        for i, design in enumerate(result.designs):
            row = {
                **asdict(design),
                "rank": ranks[i],
                "tied": int(spread.tied[i]),
                "p": merit.p[i],
                "p_low": spread.p_ci[i, 0],
                "p_high": spread.p_ci[i, 1],
                "p_printed": merit.p_printed[i],
                "delta": merit.delta[i],
                "n_sign": int(merit.n_sign[i]),
                "rmse": merit.rmse[i],
                "monotone": int(merit.monotone[i]),
                "rmse_floored": int(merit.floored[i]),
                **{f"ndr_{s}": result.ndr[i, s] for s in states},
                **{f"power_{s}": result.power[i, s] for s in states},
            }
            if i == 0:
                rows.writerow(row)
            rows.writerow(row.values())


def optimum_json(found: Optimum) -> dict[str, Any]:
    """Return the object of `optics optimise --json`."""
    return {
        "start": {**asdict(found.start), "p": found.start_p, "p_range": list(found.start_range)},
        "best": {**asdict(found.best), "p": found.best_p, "p_range": list(found.best_range)},
        "gain": found.gain,
        "paper_p": found.paper_p,
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "rays": found.rays,
        "checked_rays": found.checked_rays,
        "finished": found.finished,
        "start_power": found.start_power.tolist(),
        "best_power": found.power.tolist(),
    }


def optimum_text(found: Optimum) -> str:
    """Return the same as a few lines of text."""
    lines = [
        f"{label}: {d.cavities} cavities in the {d.face} face, width {d.width_mm:.3f}, depth {d.depth_mm:.3f}, "
        f"spacing {d.spacing_mm:.3f} mm: P {p:.3f} on power, {low:.3f} to {high:.3f} with the fan turned"
        for label, d, p, (low, high) in (
            ("grid's best", found.start, found.start_p, found.start_range),
            ("found", found.best, found.best_p, found.best_range),
        )
    ]
    lines.append(
        f"gain {found.gain:.2f} times at {found.checked_rays} rays; {found.evaluations} designs in "
        f"{found.seconds:.1f} s; the paper's optimum has P {found.paper_p:.3f} here"
    )
    if found.finished:
        lines.append(f"converged: {PATIENCE} generations in a row improved by less than {100 * BETTER:g} %")
    else:
        lines.append("the time ran out before the search converged: allow more seconds for a better design")
    return "\n".join(lines)
