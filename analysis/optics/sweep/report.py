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

OF_SEARCH = ("gain", "paper_p", "evaluations", "seconds", "rays", "checked_rays", "finished")
TABLE = (
    "rank", "tied", "p", "p_low", "p_high", "p_printed", "delta", "n_sign", "rmse", "monotone", "rmse_floored",
)  # fmt: skip


def _columns(result: SweepResult) -> dict[str, Any]:
    """Return what is given of every design: its response, figures of merit, rank and ties, (n, ...) each."""
    merit, spread = result.merit(), result.uncertainty()
    names = ("andr", "delta", "n_sign", "rmse", "p", "p_printed", "p_normalised", "p_ci", "monotone")
    return {
        "ndr": result.ndr,
        **{name: getattr(spread if name == "p_ci" else merit, name) for name in names},
        "n_sign": merit.n_sign.astype(int),
        "rmse_floored": merit.floored,
        "rank": result.ranks(),
        "tied": spread.tied,
        "power": result.power,
        "p_power": result.merit_of_power().p,
    }


def sweep_json(result: SweepResult) -> dict[str, Any]:
    """Return the object of `optics sweep --json`."""
    columns = _columns(result)
    designs = [
        {**asdict(d), **{name: column[i] for name, column in columns.items()}} for i, d in enumerate(result.designs)
    ]
    paper, optimum = result.find(), None
    if paper is not None:
        optimum = {name: designs[paper][name] for name in ("rank", "p", "p_ci", "tied")}
        optimum["rank_by_power"] = int(1 + np.sum(columns["p_power"] > columns["p_power"][paper]))
    return {
        "simulations": result.ndr.size,
        "simulated_now": result.simulated,
        "seconds": result.seconds,
        "hits": result.hits,
        "rays": result.request.light.rays,
        "version": program_version(),
        "designs": designs,
        "best": designs[int(np.argmax(columns["p"]))],
        "tied_with_best": [asdict(d) for d, tied in zip(result.designs, columns["tied"], strict=True) if tied],
        "paper_optimum": optimum,
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
    columns = _columns(result)
    columns["p_low"], columns["p_high"] = columns["p_ci"].T
    states = {f"{name}_{s}": column for name in ("ndr", "power") for s, column in enumerate(columns[name].T)}
    shown = {name: columns[name] for name in TABLE} | states
    with path.open("w", newline="", encoding="utf-8") as file:
        parameters = json.dumps(result.request.described(), sort_keys=True)
        file.write(f"# boat-daq {program_version()}, parameters {parameters}\n")
        rows = csv.writer(file)
        rows.writerow([*asdict(result.designs[0]), *shown])
        for i, design in enumerate(result.designs):
            rows.writerow([*asdict(design).values(), *(1 * column[i] for column in shown.values())])  # flags as 0 and 1


def optimum_json(found: Optimum) -> dict[str, Any]:
    """Return the object of `optics optimise --json`."""
    winners = {"start": found.start, "best": found.best}
    return {
        **{name: {**asdict(w.design), "p": w.p, "p_range": list(w.p_range)} for name, w in winners.items()},
        **{name: getattr(found, name) for name in OF_SEARCH},
        **{f"{name}_power": w.power.tolist() for name, w in winners.items()},
    }


def optimum_text(found: Optimum) -> str:
    """Return the same as a few lines of text."""
    lines = [
        f"{label}: {d.cavities} cavities in the {d.face} face, width {d.width_mm:.3f}, depth {d.depth_mm:.3f}, "
        f"spacing {d.spacing_mm:.3f} mm: P {w.p:.3f} on power, {w.p_range[0]:.3f} to {w.p_range[1]:.3f} with the fan "
        "turned"
        for label, w, d in (("grid's best", found.start, found.start.design), ("found", found.best, found.best.design))
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
