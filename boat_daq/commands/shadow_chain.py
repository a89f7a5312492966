"""`boat-daq shadow chain`: the paper's whole chain, from pressure to the best pattern."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar, show
from boat_daq.commands.optics import cavity_counts
from boat_daq.commands.shadow_options import ParametersOption

if TYPE_CHECKING:
    from analysis.optics.sweep.sweep import SweepResult


def chain(
    rays: Annotated[int, typer.Option(help="Rays of each simulation.", min=1)] = 250,
    cavities: Annotated[str, typer.Option(help="Numbers of cavities, as 3,5,7.")] = "3,5,7",
    parameters: ParametersOption = None,
    out: Annotated[Path | None, typer.Option(help="Write the shadow's curves into this CSV.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute pressure, guides, detected light and the best pattern, and compare with the parametric curves.

    Example: boat-daq shadow chain --rays 1000 --out curves.csv
    """
    from analysis.optics.scene.curves import parametric_curves
    from analysis.optics.scene.parameters import Light
    from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep
    from analysis.shadow.model.full import FullModel
    from analysis.shadow.model.parameter_files import read_parameters
    from analysis.shadow.model.states import guide_states, write_states

    designs = tuple(paper_grid(cavity_counts(cavities)))
    states = guide_states(FullModel(None if parameters is None else read_parameters(parameters)))
    if out is not None:
        write_states(states, out)
        notify(f"wrote {out}")
    found: dict[str, Any] = {}
    for name, curves in (("shadow", states.curves_mm), ("parametric", parametric_curves())):
        with progress_bar(f"sweep over the {name} curves") as progress:
            result = run_sweep(SweepRequest(designs, light=Light(rays=rays), curves=curves), progress=progress)
        found[name] = _outcome(result)
    found["bow_mm"], found["curvature_per_mm"] = states.bow_mm(), states.curvature_per_mm()
    found["elongation_mm"] = states.elongation_mm
    found["same_best"] = found["shadow"]["best"] == found["parametric"]["best"]
    if as_json:
        emit_json(found)
        return
    for name in ("shadow", "parametric"):
        one = found[name]
        design = "{cavities} cavities {width_mm:.1f} wide, {depth_mm:.1f} deep, {spacing_mm:.1f} apart"
        show(
            f"{name}: best {design.format(**one['best'])}, P {one['p']:.3g}, tied with {one['tied']}; "
            f"NDR {one['ndr'][0]:.0f} compressed, {one['ndr'][7]:.0f} at rest, {one['ndr'][-1]:.0f} elongated; "
            f"the paper's optimum has rank {one['paper_optimum_rank']}"
        )
    straighter = found["curvature_per_mm"][-1] < found["curvature_per_mm"][0]
    show(f"the shadow's guides get {'straighter' if straighter else 'more bent'} as the actuator lengthens")


def _outcome(result: SweepResult) -> dict[str, Any]:
    """Return a sweep's best design, the number tied with it, and the rank of the paper's optimum."""
    import numpy as np

    p = result.merit().p
    best, paper = int(np.argmax(p)), result.find()
    design = asdict(result.designs[best])
    del design["face"]  # the same of all designs
    return {
        "best": design,
        "p": float(p[best]),
        "tied": int(np.sum(result.uncertainty().tied)),
        "ndr": result.ndr[best],
        "paper_optimum_rank": None if paper is None else int(result.ranks()[paper]),
        "seconds": result.seconds,
        "simulations": result.simulated,
    }
