"""A sweep's and a search's results for the command line and files, and figures of scenes and sweeps.

Rules: nothing is computed here; axes have units; the actuator lies along the page, from the emitter on the left to the
receiver on the right, wherever its axis points in the data.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from analysis import figure_style as style
from analysis.numbers import finite
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.outline import laid, outline
from analysis.optics.scene.parameters import PAPER_OPTIMUM, STEPS_MM, By, Design, Light, Waveguide
from analysis.optics.sweep.fans import FanResult, compare_fans, count_errors
from analysis.optics.sweep.figure_of_merit import PARTING, Merit, pareto
from analysis.optics.sweep.optimise import BETTER, PATIENCE, Optimum
from analysis.optics.sweep.race import Race
from analysis.optics.sweep.sweep import SweepResult
from analysis.optics.tracer.simulation import ray_paths
from analysis.version import program_version
from protocol.base.arrays import FloatArray
from protocol.base.errors import writing
from protocol.base.whole_file import write_whole, written_whole


def race_json(race: Race, by: By) -> dict[str, Any]:
    """Return the object of `optics sweep --confidence C --json`."""
    rows = [_row(race, i) for i in race.candidates]
    return {
        "confidence": race.confidence,
        "by": by,
        "best": rows[0],
        "candidates": rows,
        "winner": rows[0] if len(rows) == 1 else None,
        "tied": rows if len(rows) > 1 else [],
        "finished": race.finished,
        "designs": len(race.designs),
        "rays": [{"rays": rays, "designs": int(np.sum(race.level > number))} for number, rays in enumerate(race.rays)],
        "rays_total": race.work,
        "rays_equal_precision": race.equal_work,
        "times_less_work": race.saving,
        "history": [{"work_rays": work, "candidates": left} for work, left in race.history],
        "seed": race.seed,
        "version": program_version(),
    }


def _row(race: Race, i: int) -> dict[str, Any]:
    """Return a design with its P, the bounds of P, and the rays it was traced with; null where it was not."""
    bounds = {"p": race.p[i], "p_low": race.low[i], "p_high": race.high[i]}
    rays = race.rays[race.level[i] - 1] if race.level[i] else 0
    return {**asdict(race.designs[i]), **finite(bounds), "rays": rays}


def race_text(race: Race, by: By) -> str:
    found, many = race.candidates, len(race.designs)
    if len(found) == 1:
        head = f"the best of {many} designs, at {100 * race.confidence:g} % confidence:"
    else:
        head = f"{len(found)} of {many} designs cannot be told apart; the best is one of them at "
        head += f"{100 * race.confidence:g} % confidence:"
    lines = [head]
    for i in found[:_SHOWN]:
        bounds = f"P {race.p[i]:.3f} by {by}, {race.low[i]:.3f} to {race.high[i]:.3f}"
        lines.append(f"  {design_label(race.designs[i])}: {bounds}")
    if len(found) > _SHOWN:
        lines.append(f"  and {len(found) - _SHOWN} more")
    equal = f"{race.equal_rays} for every design"
    lines.append(f"{race.work} rays in each state, {times_fewer(race.saving)} than {equal}")
    if not race.finished:
        lines.append("the time ran out: with more of it fewer designs are left")
    return "\n".join(lines)


def times_fewer(saving: float) -> str:
    """Return `1.4 times fewer` for a saving of 1.4, and `1.4 times more` for one of 0.7."""
    return f"{saving:.1f} times fewer" if saving >= 1.0 else f"{1.0 / saving:.1f} times more"


def design_label(design: Design) -> str:
    """Return number of cavities, width, depth and spacing, mm, in brackets."""
    return f"({design.cavities}, {design.width_mm:.4g}, {design.depth_mm:.4g}, {design.spacing_mm:.4g})"


BLUE, VERMILLION = style.SENSOR_COLOURS[:2]
RESIN, GREEN = "#E3EDF5", style.PRESSURE_COLOUR
_RING: Any = {"markerfacecolor": "none", "markeredgewidth": 1.6}
_DPI = 160
_FAINT, _STRONG = 0.01, 0.22
_MOST_DRAWN = 400
_SHOWN = 3
RANKS_ALIKE = 0.05  # tolerance of a ranking: of 1 - its rank correlation, as in the trade-off
SEVERAL = {"count": "counts", "power": "powers"}
_UNITS = {"count": "rays of 250", "power": "power of 250 rays"}
_GROUPS = {"all": "designs", "same_cavities": "with as many cavities", "paper_map": "in its map"}


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file's suffix: PNG, SVG or PDF."""
    with writing(path):
        style.save_picture(figure, path, dpi=_DPI)


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


@style.styled
def draw_scene(frame: SceneFrame, design: Design, guide: Waveguide, light: Light, title: str = "") -> Figure:
    """Draw the resin, the emitter, the receiver and the rays of one design in one state."""
    figure = _figure(9.0, 3.9)
    axes = figure.add_subplot()
    shape = outline(frame, design)
    rings = [laid(frame, contour.sampled()) for contour in shape.contours]
    codes = np.concatenate([[Outline.MOVETO, *[Outline.LINETO] * (len(r) - 1), Outline.CLOSEPOLY] for r in rings])
    ring = np.concatenate([np.concatenate([r, r[:1]]) for r in _opposed(rings)])
    axes.add_patch(PathPatch(Outline(ring, codes), facecolor=RESIN, edgecolor=style.SOFT, linewidth=0.6))
    paths = ray_paths(frame, design, guide, light)
    for secondary, colour in ((False, BLUE), (True, VERMILLION)):
        chosen = [p for p in paths if p.secondary == secondary]
        step = max(1, len(chosen) // _MOST_DRAWN)
        lines = [laid(frame, p.points) for p in chosen[::step]]
        strength = [min(_STRONG, max(_FAINT, _STRONG * float(p.power[-1]))) for p in chosen[::step]]
        if lines:
            axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.4, alpha=strength))
    if np.isfinite(shape.receiver[0, 0]):
        axes.plot(*laid(frame, shape.receiver).T, color=GREEN, linewidth=3.0, solid_capstyle="butt", label="receiver")
    axes.plot([0], [0], "o", color=style.ELONGATION_COLOUR, markersize=4, label="emitter")
    axes.plot([], [], color=BLUE, linewidth=1, label="released")
    axes.plot([], [], color=VERMILLION, linewidth=1, label="secondary")
    axes.set_aspect("equal")
    axes.margins(0.02, 0.06)
    axes.set(xlabel="along the actuator, mm", ylabel="across, mm", title=title)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _opposed(rings: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the outside turning left and the holes turning right, so that holes stay empty."""
    out = []
    for number, ring in enumerate(rings):
        x, y = ring.T
        left = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0
        out.append(ring if left == (number == 0) else ring[::-1])
    return out


@style.styled
def draw_response(result: SweepResult, chosen: Sequence[Design]) -> Figure:
    """Draw NDR with its standard deviation, and aNDR, over the states, as in the paper's figures 3B and 3C."""
    figure = _figure(5.6, 3.6)
    several = colormaps["viridis"](np.linspace(0.0, 0.9, len(chosen)))
    colours = (BLUE, VERMILLION) if len(chosen) <= 2 else several
    axes = figure.add_subplot()
    merit, states, (value, sd) = result.merit(), np.arange(result.ndr.shape[1]), result.response
    for design, colour in zip(chosen, colours, strict=False):
        i = result.designs.index(design)
        name = (
            f"{design.cavities} x {design.width_mm:g} x {design.depth_mm:g}, spacing {design.spacing_mm:g} mm: "
            f"P {merit.p[i]:.2f}"
        )
        axes.errorbar(states, value[i], yerr=sd[i], fmt="o", markersize=3.5, linewidth=0.7, color=colour)
        axes.plot(states, merit.andr[i], color=colour, label=name)
    axes.set(
        xlabel=f"state: 0 most compressed to {len(states) - 1} most elongated",
        ylabel=f"detected {_UNITS[result.request.by]}",
    )
    axes.legend()
    return figure


def p_grid(result: SweepResult, cavities: int, width_mm: float) -> FloatArray:
    """Return P over the sweep's maximum, (6 depths, 6 spacings); NaN where a design was not simulated."""
    p = result.merit().p_normalised
    out = np.full((len(STEPS_MM), len(STEPS_MM)), np.nan)
    for i, design in enumerate(result.designs):
        if design.cavities == cavities and design.width_mm == width_mm:
            out[STEPS_MM.index(design.depth_mm), STEPS_MM.index(design.spacing_mm)] = p[i]
    return out


@style.styled
def draw_maps(result: SweepResult, cavities: int) -> Figure:
    """Draw P over depth and spacing for each width, as in the paper's figure 3D, with both optima marked."""
    figure = _figure(9.0, 5.6)
    best = result.designs[int(np.argmax(result.merit().p))]
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    image = None
    for axes, width in zip(grid.flat, STEPS_MM, strict=True):
        image = axes.imshow(p_grid(result, cavities, width), origin="lower", cmap="viridis", vmin=0.0, vmax=1.0)
        axes.set(title=f"width {width:g} mm")
        axes.grid(visible=False)
        axes.set_xticks(range(6), [f"{s:g}" for s in STEPS_MM])
        axes.set_yticks(range(6), [f"{s:g}" for s in STEPS_MM])
        for design, mark in ((best, "*"), (PAPER_OPTIMUM, "o")):
            if (design.cavities, design.width_mm) == (cavities, width):
                place = STEPS_MM.index(design.spacing_mm), STEPS_MM.index(design.depth_mm)
                axes.plot(*place, mark, markersize=11, markeredgecolor="white", **_RING)
    if image is not None:
        figure.colorbar(image, ax=grid, shrink=0.8).set_label("P / largest P of the sweep")
    figure.supxlabel("spacing, mm")
    figure.supylabel("depth, mm")
    figure.suptitle(f"{cavities} cavities   (star: our best, circle: the paper's optimum)")
    return figure


@style.styled
def draw_pareto(result: SweepResult) -> Figure:
    """Draw Delta against RMSE, n_sign as colour; the Pareto front is ringed, both optima are named."""
    figure = _figure(5.6, 4.2)
    axes = figure.add_subplot()
    merit = result.merit()
    front = pareto(merit.delta, merit.rmse, merit.n_sign)
    dots = axes.scatter(merit.rmse, merit.delta, c=merit.n_sign, cmap="viridis", s=14, linewidths=0)
    rings: Any = {"facecolors": "none", "edgecolors": style.INK, "linewidths": 0.8}
    axes.scatter(merit.rmse[front], merit.delta[front], s=46, label="Pareto-optimal", **rings)
    for i, name, colour in ((int(np.argmax(merit.p)), "our best", BLUE), (result.find(), "paper's", VERMILLION)):
        if i is not None:
            axes.plot(merit.rmse[i], merit.delta[i], "D", markersize=8, markeredgecolor=colour, label=name, **_RING)
    figure.colorbar(dots).set_label("n_sign: increases of NDR")
    unit = _UNITS[result.request.by]
    axes.set(xlabel=f"RMSE about aNDR, {unit}", ylabel=f"Delta, {unit}")
    axes.legend()
    return figure


OF_SEARCH = (
    "gain", "paper_p", "evaluations", "seconds", "rays", "checked_rays", "finished", "by", "error",
    "work_rays",
)  # fmt: skip
_TABLE = (
    "rank", "tied", "p", "p_low", "p_high", "p_printed", "delta", "n_sign", "rmse", "monotone", "rmse_floored",
)  # fmt: skip


def _columns(result: SweepResult) -> dict[str, Any]:
    """Return the columns of every design: response, figures of merit, rank and ties, (n, ...) each."""
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
        "power_sd": result.power_sd,
        "p_power": result.merit_of_power().p,
    }


def sweep_json(result: SweepResult, fans: FanResult | None = None, seconds: float | None = None) -> dict[str, Any]:
    """Return the object of `optics sweep --json`.

    `fans`: the same sweep with its fan turned. `seconds`: time for all that was done; of the sweep alone where None.
    """
    columns, found = _columns(result), fans or compare_fans(result, 1)
    designs = [
        {**asdict(d), **{name: column[i] for name, column in columns.items()}} for i, d in enumerate(result.designs)
    ]
    paper, optimum = result.find(), None
    if paper is not None:
        optimum = {name: designs[paper][name] for name in ("rank", "p", "p_ci", "tied")}
        optimum["rank_by_power"] = int(1 + np.sum(columns["p_power"] > columns["p_power"][paper]))
        optimum["ranks"] = {name: asdict(rank) for name, rank in found.paper_ranks().items()}
    return {
        "simulations": result.ndr.size,
        "simulated_now": result.simulated,
        "seconds": result.seconds if seconds is None else seconds,
        "hits": result.hits,
        "rays": result.request.light.rays,
        "secondary": result.request.light.secondary,
        "phase": result.request.light.phase,
        "jitter": result.request.light.jitter,
        "by": result.request.by,
        "error": count_errors(result),
        "rank_error": result.uncertainty().rank_error,
        "not_followed": _not_followed(result),
        "version": program_version(),
        "designs": designs,
        "best": designs[int(np.argmax(columns["p"]))],
        "tied_with_best": [asdict(d) for d, tied in zip(result.designs, columns["tied"], strict=True) if tied],
        "paper_optimum": optimum,
        "fans": len(found.p),
        "winners": [{**asdict(design), "share": share} for design, share in found.winners()],
        "printed_and_repaired": PARTING,
    }


def _not_followed(result: SweepResult) -> dict[str, float]:
    """Return median and maximum of the power that was not followed to an end, emitted = 1."""
    return {"median": float(np.median(result.given_up)), "greatest": float(np.max(result.given_up))}


def power_text(result: SweepResult) -> str:
    """Return the errors of the detected power in a line: of the number of rays, and of reflections not followed."""
    sd, lost = 100 * float(np.median(result.power_sd)), {k: 100 * v for k, v in _not_followed(result).items()}
    return (
        f"by power: of the light of a state, {sd:.2g} % standard deviation, {lost['median']:.2g} % not followed "
        f"(at most {lost['greatest']:.2g} %)"
    )


def error_text(result: SweepResult) -> str:
    """Return the stated errors of a sweep's counts, or powers, in a line."""
    errors = count_errors(result)
    return (
        f"{SEVERAL[result.request.by]} of 250 rays have errors of at most {errors['of_95_percent']:.2g} "
        f"in 95 % of the simulations, {errors['greatest']:.2g} in all (k = 2)"
    )


def _line(label: str, design: Design, merit: Merit, i: int) -> str:
    return (
        f"{label}: {design.cavities} cavities, width {design.width_mm:g}, depth {design.depth_mm:g}, "
        f"spacing {design.spacing_mm:g} mm: P {merit.p[i]:.3f}, Delta {merit.delta[i]:.1f}, "
        f"n_sign {merit.n_sign[i]:.0f}, RMSE {merit.rmse[i]:.2f}"
    )


def sweep_text(result: SweepResult, fans: FanResult | None = None, seconds: float | None = None) -> str:
    found = fans or compare_fans(result, 1)
    merit, spread = result.merit(), result.uncertainty()
    best, paper = int(np.argmax(merit.p)), result.find()
    lines = [
        f"{result.ndr.size} simulations, {result.simulated} now, {result.hits} hits",
        _line("best", result.designs[best], merit, best),
        f"95 % interval of its P: {spread.p_ci[best, 0]:.3f} to {spread.p_ci[best, 1]:.3f}; "
        f"{int(spread.tied.sum())} of {len(result.designs)} designs cannot be told from it",
    ]
    if result.request.by == "power":
        lines.append(power_text(result))
    lines.append(f"{result.request.light.rays} rays: {error_text(result)}")
    if paper is not None:
        lines += [
            _line(f"paper's optimum, rank {result.ranks()[paper]}", result.designs[paper], merit, paper),
            f"it {'cannot' if spread.tied[paper] else 'can'} be told from the best; its rank: {rank_text(found)}",
        ]
    if len(found.p) > 1:
        most = [f"{design_label(d)} {share:.0%}".replace("%", " %") for d, share in found.winners()[:_SHOWN]]
        number = f"{len(found.winners())} designs win one of {len(found.p)} turns of the fan"
        lines.append(f"{number}; share of the leading ones: {', '.join(most)}")
    if spread.rank_error > RANKS_ALIKE:
        lines.append(
            f"{result.request.light.rays} rays cannot rank these designs (1 - rank correlation {spread.rank_error:.2g} "
            f"or more, by the scatter of the rays; tolerance {RANKS_ALIKE:g}): use --confidence 0.95, "
            "or --fidelity normal"
        )
    if seconds is not None:
        lines.append(f"{len(found.p) * result.ndr.size} simulations with all turns, in {seconds:.1f} s in all")
    return "\n".join(lines)


def rank_text(fans: FanResult) -> str:
    """Return the ranks of the paper's optimum in its groups, each with its range over the fans."""
    parts = []
    for name, rank in fans.paper_ranks().items():
        turns = f" ({rank.low} to {rank.high})" if len(fans.p) > 1 else ""
        parts.append(f"{rank.rank} of {rank.of} {_GROUPS[name]}{turns}")
    return ", ".join(parts)


def write_sweep(result: SweepResult, folder: Path) -> list[Path]:
    """Write `designs.csv` and the figures (PNG and SVG) beside the results file; returns the paths."""
    table = folder / "designs.csv"
    _write_table(result, table)
    shown = dict.fromkeys((int(np.argmax(result.merit().p)), result.find()))  # best, and the paper's where it is in it
    counts = sorted({d.cavities for d in result.designs})
    drawn = {
        "response": draw_response(result, [result.designs[i] for i in shown if i is not None]),
        "pareto": draw_pareto(result),
        **{f"p_maps_{n}_cavities": draw_maps(result, n) for n in counts},
    }
    paths = [table]
    for name, figure in drawn.items():
        for suffix in (".png", ".svg"):
            paths.append(folder / f"{name}{suffix}")
            save(figure, paths[-1])
            figure.set_layout_engine("none")  # laid out once for both formats
    return paths


def _write_table(result: SweepResult, path: Path) -> None:
    """One row per design; parameters and version in comment lines at the head."""
    columns = _columns(result)
    columns["p_low"], columns["p_high"] = columns["p_ci"].T
    states = {f"{name}_{s}": column for name in ("ndr", "power") for s, column in enumerate(columns[name].T)}
    shown = {name: columns[name] for name in _TABLE} | states
    with written_whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        parameters = json.dumps(result.request.described(), sort_keys=True)
        file.write(f"# boat-daq {program_version()}, ranked by {result.request.by}, parameters {parameters}\n")
        rows = csv.writer(file)
        rows.writerow([*asdict(result.designs[0]), *shown])
        for i, design in enumerate(result.designs):
            rows.writerow([*asdict(design).values(), *(1 * column[i] for column in shown.values())])  # flags as 0 and 1


@style.styled
def draw_race(race: Race) -> Figure:
    """Draw the designs that may be the best against the work so far, beside equal precision for all."""
    figure = _figure(5.6, 3.9)
    cost = figure.subplots()
    work, candidates = np.array([(0, len(race.designs)), *race.history], dtype=float).T
    cost.step(work, candidates, where="post", color=VERMILLION, label="race")
    cost.step([0.0, race.equal_work, race.equal_work], [len(race.designs), len(race.designs), candidates[-1]],
              where="post", color=BLUE, label=f"{race.equal_rays} rays for every design")  # fmt: skip
    cost.set(xlabel="rays released in each state, all designs", ylabel="designs that may be the best")
    cost.set_xscale("symlog", linthresh=float(race.history[0][0]))
    cost.set_yscale("log")
    cost.set_title(f"{times_fewer(race.saving)} rays")
    cost.legend(loc="lower left")
    return figure


def write_race(race: Race, by: By, folder: Path) -> list[Path]:
    """Write `race.json` and the chart (PNG and SVG) into a folder; returns the paths."""
    paths = [folder / "race.json"]
    write_whole(paths[0], json.dumps(finite(race_json(race, by)), indent=1))
    figure = draw_race(race)
    for suffix in (".png", ".svg"):
        paths.append(folder / f"race{suffix}")
        save(figure, paths[-1])
        figure.set_layout_engine("none")  # laid out once for both formats
    return paths


def optimum_json(found: Optimum) -> dict[str, Any]:
    """Return the object of `optics optimise --json`."""
    winners = {"start": found.start, "best": found.best}
    return {
        **{
            name: {**asdict(w.design), "p": w.p, "p_range": list(w.p_range), "not_followed": w.given_up}
            for name, w in winners.items()
        },
        **{name: getattr(found, name) for name in OF_SEARCH},
        **{f"{name}_power": w.power.tolist() for name, w in winners.items()},
        **{f"{name}_power_sd": w.power_sd.tolist() for name, w in winners.items()},
        "equal_work_rays": None if found.race is None else found.race.equal_work,
        "times_less_work": None if found.race is None else found.saving,
        "race": None if found.race is None else race_json(found.race, found.by),
    }


def optimum_text(found: Optimum) -> str:
    lines = [
        f"{label}: {d.cavities} cavities in the {d.face} face, width {d.width_mm:.3f}, depth {d.depth_mm:.3f}, "
        f"spacing {d.spacing_mm:.3f} mm: P {w.p:.3f} by {found.by}, {w.p_range[0]:.3f} to {w.p_range[1]:.3f} with "
        "the fan turned"
        for label, w, d in (("grid's best", found.start, found.start.design), ("found", found.best, found.best.design))
    ]
    lines.append(
        f"gain {found.gain:.2f} times at {found.checked_rays} rays; {found.evaluations} designs in "
        f"{found.seconds:.1f} s; the paper's optimum has P {found.paper_p:.3f} here"
    )
    lines.append(f"{_UNITS[found.by]} of both within {found.error:.2g} in every state, at k = 2")
    if found.by == "power":
        sd = 100 * float(np.max(found.best.power_sd))
        lines.append(
            f"errors of its power: standard deviation {sd:.2g} % of the light at most, and at most "
            f"{100 * found.best.given_up:.2g} % was not followed"
        )
    if found.race is not None:
        lines.append(race_text(found.race, found.by))
        lines.append(f"with the search {found.work_rays} rays in each state, {times_fewer(found.saving)}")
    if found.finished:
        lines.append(f"converged: {PATIENCE} generations in a row improved by less than {100 * BETTER:g} %")
    else:
        lines.append("the time ran out before the search converged: allow more seconds for a better design")
    return "\n".join(lines)
