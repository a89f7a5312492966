"""`boat-daq shadow chain`: the paper's whole chain, from pressure to the best pattern."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, progress_bar, say

if TYPE_CHECKING:
    from analysis.optics.sweep.sweep import SweepResult


def chain(
    rays: Annotated[int, typer.Option(help="Rays of each simulation.", min=1)] = 250,
    cavities: Annotated[str, typer.Option(help="Numbers of cavities, as 3,5,7.")] = "3,5,7",
    parameters: Annotated[Path | None, typer.Option(help="TOML file of actuator parameters.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write the shadow's curves into this CSV.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Pressure to guides to light to the best pattern, and how it differs from the parametric set of curves.

    Example: boat-daq shadow chain --rays 1000 --out curves.csv
    """
    from analysis.optics.scene.curves import parametric_curves
    from analysis.optics.scene.parameters import Light
    from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep
    from analysis.shadow.model.full import FullModel
    from analysis.shadow.model.parameter_files import read_parameters
    from analysis.shadow.model.states import guide_states, write_states

    try:
        counts = tuple(int(part) for part in cavities.split(","))
    except ValueError:
        raise typer.BadParameter(f"'{cavities}' is not a list as 3,5,7", param_hint="--cavities") from None
    states = guide_states(FullModel(None if parameters is None else read_parameters(parameters)))
    if out is not None:
        write_states(states, out)
        say(f"wrote {out}")
    found: dict[str, Any] = {}
    for name, curves in (("shadow", states.curves_mm), ("parametric", parametric_curves())):
        request = SweepRequest(tuple(paper_grid(counts)), light=Light(rays=rays), curves=curves)
        with progress_bar(f"sweep over the {name} curves") as progress:
            found[name] = outcome(run_sweep(request, progress=progress))
    found["bow_mm"], found["curvature_per_mm"] = states.bow_mm(), states.curvature_per_mm()
    found["elongation_mm"] = states.elongation_mm
    found["same_best"] = found["shadow"]["best"] == found["parametric"]["best"]
    if as_json:
        emit_json(found)
        return
    for name in ("shadow", "parametric"):
        one = found[name]
        say(
            f"{name}: best {describe(one['best'])}, P {one['p']:.3g}, tied with {one['tied']}; NDR {one['ndr'][0]:.0f} "
            f"compressed, {one['ndr'][7]:.0f} at rest, {one['ndr'][-1]:.0f} elongated; the paper's optimum is rank "
            f"{one['paper_optimum_rank']}"
        )
    straighter = found["curvature_per_mm"][-1] < found["curvature_per_mm"][0]
    say(f"the shadow's guides get {'straighter' if straighter else 'more bent'} as the actuator lengthens")


def outcome(result: SweepResult) -> dict[str, Any]:
    """Return a sweep's best design, what ties with it, and where the paper's optimum stands."""
    import numpy as np

    p = result.merit().p
    best, paper = int(np.argmax(p)), result.find()
    design = result.designs[best]
    return {
        "best": {
            "cavities": design.cavities,
            "width_mm": design.width_mm,
            "depth_mm": design.depth_mm,
            "spacing_mm": design.spacing_mm,
        },
        "p": float(p[best]),
        "tied": int(np.sum(result.uncertainty().tied)),
        "ndr": result.ndr[best],
        "paper_optimum_rank": None if paper is None else int(result.ranks()[paper]),
        "seconds": result.seconds,
        "simulations": result.simulated,
    }


def describe(design: dict[str, Any]) -> str:
    """Return a design in words."""
    return (
        f"{design['cavities']} cavities {design['width_mm']:.1f} wide, {design['depth_mm']:.1f} deep, "
        f"{design['spacing_mm']:.1f} apart"
    )
