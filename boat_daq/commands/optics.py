"""`boat-daq optics`: trace one design, write it for another simulator, sweep all designs, search beyond them."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.optics.scene.parameters import ALL, PAPER_RAYS, PAPER_SECONDARY, Design, Light, Waveguide
from analysis.optics.scene.scene_file import OpticalScene, read_scene
from boat_daq.commands.console import JsonOption, emit_json, load, notify, present, progress_bar
from boat_daq.commands.options import AllowRemoteOption, OptionalFidelity
from protocol.base.errors import writing
from protocol.base.whole_file import write_whole

if TYPE_CHECKING:
    from analysis.fidelity import Fidelity, Level
    from analysis.optics.scene.frame import SceneFrame
    from analysis.optics.sweep.sweep import SweepRequest
    from analysis.optics.tracer.tolerance import ToleratedTrace
    from protocol.base.arrays import FloatArray

app = typer.Typer(no_args_is_help=True, help="The optical model: trace, scene, sweep, optimise.")

Cavities = Annotated[int, typer.Option(help="Cavities in each guide, 0 for a plain one.")]
Width = Annotated[float, typer.Option(help="Width of a cavity, mm.")]
Depth = Annotated[float, typer.Option(help="Depth of a cavity, mm.")]
Spacing = Annotated[float, typer.Option(help="Spacing between cavities, mm.")]
State = Annotated[
    int | None,
    typer.Option(help="Deformation state, 0 = most compressed .. 14 = most elongated; default 7 (rest)."),
]
Rays = Annotated[int, typer.Option(help="Rays released.")]
OptionalRays = Annotated[int | None, typer.Option(help="Rays released; default 250, or the precision's.")]
Secondary = Annotated[
    int | None,
    typer.Option(help="Budget of secondary (reflected) rays, -1 for all; default 100 for each 250 rays."),
]
Order = Annotated[str | None, typer.Option(help="Order in which the budget is spent: time (default), bounce or index.")]
Index = Annotated[float | None, typer.Option(help="Refractive index of the resin; default 1.50.")]
Curves = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.csv|parametric|shadow|paper",
        help="Deformed guides: x and z in mm, sines, solved now, or those of the paper (-50 to +50 kPa, stiffer wall); "
        "default the shadow's 15 stored states.",
    ),
]
SceneFile = Annotated[
    Path | None,
    typer.Option(
        "--scene",
        metavar="FILE.toml",
        help="What the paper leaves open: thickness_mm, index, attenuation_db_per_cm, receiver_mm, face, curves, "
        "emission, order, secondary, phase, faintest, rank_by.",
    ),
]
Confidence = Annotated[
    float | None,
    typer.Option(
        help="Race: trace few rays for all designs, and more only for those that may be the best with this "
        "probability, such as 0.95; up to --rays (default 256000)."
    ),
]
RaceSeconds = Annotated[
    float | None,
    typer.Option(
        help="Time limit of the race, s; it then returns the designs left, which contain the best with the same "
        "probability."
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        metavar="RAYS",
        help="Greatest error of a count at 95 %, rays of 250: chooses the rays; the answer states its own error.",
    ),
]
Scheduler = Annotated[str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://HOST:8786.")]


def released_rays(
    rays: int | None, secondary: int | None, level: Level | None, of_level: Callable[[Fidelity], int]
) -> tuple[int, int]:
    """Return the number of rays and the budget of secondaries: those given, else the precision's, else the paper's."""
    from analysis.fidelity import fidelity

    chosen = PAPER_RAYS if level is None else of_level(fidelity(level))
    number = chosen if rays is None else rays
    return number, secondaries_of(number) if secondary is None else secondary


def secondaries_of(rays: int) -> int:
    """Return the budget of secondary rays in proportion to the paper's."""
    return round(PAPER_SECONDARY * rays / PAPER_RAYS)


def _scene_of(
    path: Path | None,
    *,
    index: float | None = None,
    curves: Path | None = None,
    order: str | None = None,
    secondary: int | None = None,
) -> OpticalScene:
    """Return the scene of a file, with the options that were given in place of its values."""
    given = {"index": index, "curves": None if curves is None else str(curves), "order": order, "secondary": secondary}
    return replace(read_scene(path), **{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]  # checked there


def _notify_unused(scene: OpticalScene, *names: str) -> None:
    """Report values of a scene that a command does not use."""
    if unused := scene.stated(*names):
        notify(f"not used here: {', '.join(unused)}")


def curves_of(name: str) -> FloatArray:
    if name == "shadow":
        from analysis.shadow.model.states import kept_states

        return kept_states().curves_mm
    if name == "paper":
        from analysis.shadow.model.states import PAPER_LOWEST_KPA, STIFFER_WALL, kept_states

        return kept_states(STIFFER_WALL, lowest_kpa=PAPER_LOWEST_KPA).curves_mm
    from analysis.optics.scene.curve_file import curves_named

    return curves_named(name)


def _frame(curves: FloatArray, state: int | None, guide: Waveguide) -> tuple[SceneFrame, int]:
    """Return the frame of a state and its number; a file of one state has only that one."""
    from analysis.optics.scene.curves import REST_STATE, frame_of
    from protocol.base.errors import ChoiceError

    if len(curves) == 1:
        if state:
            notify(f"the file holds only one state; it is used for state {state}")
        return frame_of(curves, 0, guide), state or 0
    number = REST_STATE if state is None else state
    if not 0 <= number < len(curves):
        remedy = f"choose 0 (most compressed) to {len(curves) - 1} (most elongated)"
        raise ChoiceError(f"there is no state {number}", remedy)
    return frame_of(curves, number, guide), number


@app.command()
def trace(
    cavities: Cavities = 5,
    width: Width = 1.0,
    depth: Depth = 0.5,
    spacing: Spacing = 0.9,
    state: State = None,
    rays: OptionalRays = None,
    secondary: Secondary = None,
    order: Order = None,
    index: Index = None,
    curves: Curves = None,
    scene: SceneFile = None,
    out: Annotated[Path | None, typer.Option(help="Write an image of the rays: PNG or SVG.")] = None,
    tolerance: Tolerance = None,
    fidelity: OptionalFidelity = None,
    as_json: JsonOption = False,
) -> None:
    """Trace one design in one state: detected rays and power.

    Example: boat-daq optics trace --cavities 5 --width 1.0 --depth 0.5 --spacing 0.9 --state 0
    """
    if tolerance is not None and (rays is not None or fidelity is not None):
        raise typer.BadParameter("chooses the rays: omit --rays and --fidelity", param_hint="--tolerance")
    chosen = _scene_of(scene, index=index, curves=curves, order=order, secondary=secondary)
    if tolerance is not None and chosen.phase is not None:
        raise typer.BadParameter("chooses the turn of the fan: omit phase in the scene", param_hint="--tolerance")
    design, guide = Design(cavities, width, depth, spacing, chosen.face), chosen.guide
    light = chosen.light(*released_rays(rays, chosen.secondary, fidelity, lambda level: level.rays))
    load("analysis.optics.tracer.tolerance")
    from analysis.optics.tracer.tolerance import FEWEST_RAYS

    frame, number = _frame(curves_of(chosen.curves), state, guide)
    traced = _traced(frame, design, guide, light, tolerance)
    if out is not None:
        from analysis.optics.sweep.report import draw_scene, save

        save(draw_scene(frame, design, guide, traced.light), out)
        notify(f"wrote {out}")
    outcome, used = traced.result, traced.light
    result = asdict(design) | {
        "state": number, "rays": used.rays, "phase": used.phase, "jitter": used.jitter, "ndr": outcome.ndr,
        "power": outcome.power, "power_sd": outcome.power_sd, "ledger": outcome.ledger, "hits": outcome.hits,
        "ndr_sd": outcome.ndr_sd, "error": traced.error, "tolerance": tolerance, "work_rays": traced.work,
        "energy": outcome.energy, "secondaries": {"followed": outcome.granted, "refused": outcome.refused},
        "order": used.order, "index": guide.index,
    }  # fmt: skip
    if outcome.granted > used.rays:
        notify("most rays are reflected parts with next to no power: do not compare their number, compare the power")
    if 1 < used.rays < FEWEST_RAYS:
        notify(f"the errors of {used.rays} rays are uncertain themselves: release {FEWEST_RAYS} or more")
    present(result, *_trace_lines(traced, number), as_json=as_json)


def _traced(
    frame: SceneFrame, design: Design, guide: Waveguide, light: Light, tolerance: float | None
) -> ToleratedTrace:
    """Trace a scene with the rays of a light, or with those that a tolerance of the count takes."""
    from analysis.optics.tracer.simulation import trace as trace_scene
    from analysis.optics.tracer.tolerance import ToleratedTrace, stated_error, trace_within

    with progress_bar("rays") as advance:
        if tolerance is not None:
            return trace_within(frame, design, guide, light, tolerance, progress=advance)
        outcome = trace_scene(frame, design, guide, light, progress=advance)
    sd = PAPER_RAYS * outcome.power_sd if light.secondary == ALL else outcome.ndr_sd
    return ToleratedTrace(outcome, light, float(stated_error(sd, light.rays)), math.inf, light.rays)


def _trace_lines(traced: ToleratedTrace, state: int) -> tuple[str, ...]:
    """Return a simulation as lines; `traced` is it with its error, `state` the number of its state."""
    outcome, rays = traced.result, traced.light.rays
    error = f"{traced.error:.2g} rays of {PAPER_RAYS}"
    count = f"NDR {_with_sd(outcome.ndr, outcome.ndr_sd, 1)} of 250"
    k = " (k = 1)" if math.isfinite(outcome.power_sd) else ", errors unknown with a single ray"
    if outcome.granted > rays:
        count, error = f"{outcome.ledger['detected']} detected rays", f"{traced.error / PAPER_RAYS:.2g} of the power"
    return (
        f"state {state}: {count}, power {_with_sd(outcome.power, outcome.power_sd, 4)}{k}, {outcome.hits} hits",
        *([f"error (k = 2): {error}, with {rays} rays from the emitter"] if math.isfinite(traced.error) else []),
        "rays: " + ", ".join(f"{name} {count}" for name, count in outcome.ledger.items()),
        "power: " + ", ".join(f"{name} {part:.4f}" for name, part in outcome.energy.items()),
    )


def _with_sd(value: float, sd: float, decimals: int) -> str:
    """Return a value with its standard deviation, to two significant digits of that (GUM, 7.2.6), where it has one."""
    if not math.isfinite(sd):
        return f"{value:.{decimals}f}"
    from analysis.numbers import decimals_for

    decimals = max(decimals, decimals_for(sd)) if sd > 0 else decimals
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}"


@app.command("scene")
def scene_command(
    cavities: Cavities = 5,
    width: Width = 1.0,
    depth: Depth = 0.5,
    spacing: Spacing = 0.9,
    state: State = None,
    rays: Rays = PAPER_RAYS,
    secondary: Secondary = None,
    order: Order = None,
    index: Index = None,
    curves: Curves = None,
    scene: SceneFile = None,
    out: Annotated[Path | None, typer.Option(help="File to write; default scene.json.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a design as a scene of the 2D simulator 'ray-optics'.

    One state of it; the format is JSON, version 5.

    With --json and without --out the scene itself is printed. With --secondary 0 its glass does not reflect at a
    refraction, so that its detector counts the same rays as `trace --secondary 0`.

    Example: boat-daq optics scene --state 14 --out elongated.json
    """
    chosen = _scene_of(scene, index=index, curves=curves, order=order, secondary=secondary)
    _notify_unused(chosen, "attenuation_db_per_cm", "faintest")
    design, guide = Design(cavities, width, depth, spacing, chosen.face), chosen.guide
    light = chosen.light(rays, secondaries_of(rays) if chosen.secondary is None else chosen.secondary)
    load("analysis.optics.tracer.ray_optics_export")
    from analysis.optics.tracer.ray_optics_export import ray_optics_scene

    frame, number = _frame(curves_of(chosen.curves), state, guide)
    name = f"BOAT n={cavities} w={width:g} d={depth:g} s={spacing:g} mm, state {number}"
    built = ray_optics_scene(frame, design, guide, light, name)
    if as_json and out is None:
        emit_json(built)
        return
    path = out or Path("scene.json")
    with writing(path):
        write_whole(path, json.dumps(built, indent=1))
    content = {**asdict(design), "state": number, "file": str(path), "objects": len(built["objs"])}
    text = f"wrote {path}: open it in ray-optics (https://phydemo.app/ray-optics/simulator/)"
    present(content, text, as_json=as_json)


@app.command()
def sweep(
    cavities: Annotated[str, typer.Option(help="Numbers of cavities.")] = "3,5,7",
    rays: OptionalRays = None,
    scene: SceneFile = None,
    confidence: Confidence = None,
    seconds: RaceSeconds = None,
    tolerance: Tolerance = None,
    scheduler: Scheduler = None,
    allow_remote: AllowRemoteOption = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for results, tables and figures; a stopped sweep is resumed from it.")
    ] = None,
    fidelity: OptionalFidelity = None,
    as_json: JsonOption = False,
) -> None:
    """Simulate the paper's designs in all 15 states; rank them.

    Example: boat-daq optics sweep --cavities 3,5,7 --rays 250 --out sweep
    """
    begun = time.perf_counter()
    if tolerance is not None and (rays, fidelity, confidence) != (None, None, None):
        raise typer.BadParameter("chooses the rays: omit --rays, --fidelity and --confidence", param_hint="--tolerance")
    if seconds is not None and confidence is None:
        raise typer.BadParameter("limits a race: add --confidence", param_hint="--seconds")
    if confidence is not None and fidelity is not None:
        raise typer.BadParameter("chooses the rays itself: omit --fidelity", param_hint="--confidence")
    chosen = read_scene(scene)
    if chosen.phase is not None and (confidence is not None or tolerance is not None):
        raise typer.BadParameter(
            "must have no phase with --confidence or --tolerance, which turn the fan", param_hint="--scene"
        )
    load("analysis.optics.sweep.report")
    from analysis.optics.sweep.fans import light_within
    from analysis.optics.sweep.sweep import SweepRequest

    designs, by, secondary = _grid(cavities, chosen), chosen.rank_by or "count", chosen.secondary
    released, budget = released_rays(rays, secondary, fidelity, lambda level: level.ranking_rays)
    if confidence is not None:  # the model that the race samples more finely
        most, released, budget = rays, PAPER_RAYS, PAPER_SECONDARY if secondary is None else secondary
    light = chosen.light(released, ALL if by == "power" and secondary is None else budget)
    request = SweepRequest(designs, chosen.guide, light, curves_of(chosen.curves), by)
    if tolerance is not None:
        request = replace(request, light=light_within(request, tolerance))
    if out is not None:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
    if confidence is not None:
        within = math.inf if seconds is None else seconds
        _race(request, confidence, most, within, out, scheduler, allow_remote=allow_remote, as_json=as_json)
    else:
        _sweep(request, begun, out, scheduler, allow_remote=allow_remote, as_json=as_json)


def _grid(cavities: str, scene: OpticalScene) -> tuple[Design, ...]:
    """Return the paper's designs that fit the guide of a scene; `cavities` as the option."""
    from analysis.optics.sweep.sweep import paper_grid

    grid = paper_grid(cavity_counts(cavities), scene.face)
    designs = tuple(design for design in grid if scene.face != "both" or design.cut_mm < scene.thickness_mm)
    if len(designs) < len(grid):
        notify(f"{len(grid) - len(designs)} designs whose opposite cavities would meet are left out")
    return designs


def _sweep(
    request: SweepRequest, begun: float, out: Path | None, scheduler: str | None, *, allow_remote: bool, as_json: bool
) -> None:
    """Run a sweep, write its files and print its result; other parameters are those of the command.

    begun : when the command began, before its imports and compilation.
    """
    from analysis.optics.sweep.fans import compare_fans, fans_of
    from analysis.optics.sweep.report import sweep_json, sweep_text, write_sweep
    from analysis.optics.sweep.sweep import FILE_NAME, run_sweep

    file = None if out is None else out / FILE_NAME
    with progress_bar("sweep") as advance:
        result = run_sweep(request, file=file, scheduler=scheduler, allow_remote=allow_remote, progress=advance)
    with progress_bar("turns of the fan") as advance:
        number = fans_of(request.light.rays)
        turned = compare_fans(
            result, number, file=file, scheduler=scheduler, allow_remote=allow_remote, progress=advance
        )
    if out is not None:
        for path in write_sweep(result, out):
            notify(f"wrote {path}")
    seconds = time.perf_counter() - begun
    present(sweep_json(result, turned, seconds), sweep_text(result, turned, seconds), as_json=as_json)


def _race(
    request: SweepRequest, confidence: float, most_rays: int | None, seconds: float, out: Path | None,
    scheduler: str | None, *, allow_remote: bool, as_json: bool,
) -> None:  # fmt: skip
    """Run the race of a sweep, write its files and print its result; parameters are those of the command."""
    from analysis.optics.sweep.race import RACE_MOST_RAYS, race_sweep
    from analysis.optics.sweep.report import race_json, race_text, write_race

    with progress_bar("race") as advance:
        found = race_sweep(
            request, confidence, most_rays=most_rays or RACE_MOST_RAYS, seconds=seconds, folder=out,
            scheduler=scheduler, allow_remote=allow_remote, progress=advance,
        )  # fmt: skip
    for path in write_race(found, request.by, out) if out is not None else ():
        notify(f"wrote {path}")
    present(race_json(found, request.by), race_text(found, request.by), as_json=as_json)


@app.command()
def optimise(
    rays: Annotated[int, typer.Option(help="Rays of each evaluation.")] = 2_000,
    seconds: Annotated[float, typer.Option(help="Time limit of the search, s.")] = 50.0,
    scene: SceneFile = None,
    confidence: Annotated[
        float | None,
        typer.Option(help="Race: find the best of all designs evaluated with this probability, such as 0.95."),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="RAYS",
            help="Greatest error (95 %) of the winners' counts, rays of 250: sets the rays of the final evaluation; "
            "else 10 times --rays.",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the result as JSON.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Search a better design, from the best of the grid.

    Width, depth and spacing are continuous; number of cavities and face vary too.

    Example: boat-daq optics optimise --seconds 50
    """
    Light(rays=rays, secondary=0)  # refuses a number that cannot be traced
    if out is not None:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
    chosen = read_scene(scene)
    _notify_unused(chosen, "emission", "order", "secondary", "phase", "faintest")
    load("analysis.optics.sweep.optimise", "analysis.optics.sweep.report")
    from analysis import numbers
    from analysis.optics.sweep.optimise import optimise as search
    from analysis.optics.sweep.report import optimum_json, optimum_text

    with progress_bar("search") as advance:
        found = search(
            chosen.guide,
            curves_of(chosen.curves),
            rays=rays,
            seconds=seconds,
            first_face=chosen.face,
            by=chosen.rank_by or "power",
            confidence=confidence,
            tolerance=tolerance,
            progress=advance,
        )
    result = optimum_json(found)
    if out is not None:
        file = out / "optimum.json"
        with writing(file):
            write_whole(file, json.dumps(numbers.finite(result), indent=1, allow_nan=False))
        notify(f"wrote {file}")
    present(result, optimum_text(found), as_json=as_json)


def cavity_counts(text: str) -> list[int]:
    try:
        found = [int(part) for part in text.split(",")]
    except ValueError:
        found = []
    if min(found, default=0) < 1:
        raise typer.BadParameter(f"{text!r} is not a list of numbers of 1 or more, as 3,5,7", param_hint="--cavities")
    return list(dict.fromkeys(found))
