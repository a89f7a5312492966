"""Whether any actuator that agrees with the paper bends its guides more on elongation, and follows the calibrations.

    python -m tests.verification.sensing_principle --seconds 240 --out drawn.jsonl
    python -m tests.verification.sensing_principle --climb curvature --seconds 300 --out curvature.jsonl
    python -m tests.verification.sensing_principle --climb light --seconds 130 --out light.jsonl
    python -m tests.verification.sensing_principle --climb light --start light.jsonl --rays 10000 --out finer.jsonl
    python -m tests.verification.sensing_principle --again tests/verification/sensing_found.jsonl --out again.jsonl
    python -m tests.verification.sensing_principle --draw *.jsonl --out sensing.png

`sensing_found.jsonl` holds the guide of the greatest growth of curvature and that of the best light; `--again` computes
both on the mesh of the search and, with neck and modulus solved again, on that of the shadow.

What the paper leaves open (cells, belly, wall, lattice's nu, envelope) is drawn from ranges, the lattice's E from its
18.34 +- 1.86 kPa. Neck and modulus of the wall are solved, with the finite elements, so that +50 kPa gives +3.80 mm and
-40 kPa gives -2.70 mm. Kept is what is stable at -40 kPa and has a wall as stiff as printed elastomers; where it loses
its stability, down to LOWEST_LIMIT_KPA, is noted. In each of these actuators guides with greatest distances from the
axis and end pieces that end on nodes of the lattice are moved through the 15 states, and the light of the paper's
pattern is traced.

Rejection needs no surrogate and no convergence: a sample costs about 0.3 s.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cma
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm, qmc

from analysis import figure_style as style
from analysis.optics.scene.parameters import PAPER_OPTIMUM
from analysis.optics.sweep.signal import chain_signal
from analysis.published import RANGE_MM, SENSORS
from analysis.shadow.fem.mesh import build_mesh
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.guides import Embedding, both_guides, embed, rest_centreline
from analysis.shadow.model.states import GuideStates, guide_states
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError

TARGETS = ((50.0, 3.80), (-40.0, -2.70))
RANGES = {"cells": (4, 8.99), "belly_radius_mm": (5.5, 13.0), "wall_mm": (0.8, 3.5), "lattice_poisson": (0.0, 0.45)}
ENVELOPE_MM = (16.0, 32.0)
NECK_SHARE = (0.15, 1.0)  # of the belly, where the solution starts
MODULUS_KPA = (600.0, 4000.0)  # Elastic 50A: 2.7 MPa by its data sheet's stress at 50 and 100 % strain
LOWEST_LIMIT_KPA = -55.0
PLACES_MM = tuple(itertools.product((12.5, 18.75, 25.0), (12.5, 25.0, 37.5, 50.0, 62.5)))
FACES = ("outer", "inner")
PRESSURES_KPA = np.concatenate([np.linspace(-40.0, 0.0, 8), np.linspace(0.0, 50.0, 8)[1:]])
MESH = {"axial_elements": 6, "wall_elements": 2, "lattice_elements": 3}
SHADOW_MESH = dict(zip(MESH, ActuatorParameters().elements, strict=True))
FOUND = Path(__file__).with_name("sensing_found.jsonl")
CLOSE_MM = 0.01
REFUSED = -9.0  # value of an actuator that is not allowed
TRACED_SHARE = 0.2  # of the guides that straighten; of those that bend more all are traced


@dataclass(frozen=True, slots=True)
class Guide:
    """One guide in one actuator: how it bends, and what its light says."""

    actuator: ActuatorParameters
    limit_kpa: float  # the pressure at which the actuator loses its stability, to 2 kPa
    curvature_growth: float  # of the middle, last state over first, less 1
    bow_growth_mm: float  # from -40 to +50 kPa
    face: str = ""
    light_change: float = float("nan")  # last state over first, less 1
    r2: tuple[float, float] = (float("nan"), float("nan"))  # of gain * light + offset against each published cubic

    def as_json(self) -> dict[str, object]:
        """Return the numbers with those of the actuator that the search varies."""
        return asdict(self)


def actuators(rows: FloatArray) -> list[ActuatorParameters]:
    """Return the actuators at points of the unit cube, neck and modulus where their solution starts."""
    found = []
    for row in rows:
        low, high = np.transpose(list(RANGES.values()))
        values = dict(zip(RANGES, (low + (high - low) * row[: len(RANGES)]).tolist(), strict=True))
        envelope, lattice, neck, modulus = row[len(RANGES) :].tolist()
        belly = values["belly_radius_mm"]
        try:
            found.append(ActuatorParameters(
                **(values | {"cells": int(values["cells"])}),
                envelope_radius_mm=ENVELOPE_MM[0] + envelope * (ENVELOPE_MM[1] - ENVELOPE_MM[0]),
                lattice_modulus_kpa=float(norm.ppf(lattice, 18.34, 1.86)),
                neck_radius_mm=belly * (NECK_SHARE[0] + neck * (NECK_SHARE[1] - NECK_SHARE[0])),
                wall_modulus_kpa=float(np.exp(np.interp(modulus, [0, 1], np.log(MODULUS_KPA)))),
                guide_bow_mm=1.0, **MESH,
            ))  # fmt: skip
        except BoatDaqError:
            continue  # the wall reaches beyond the lattice
    return found


def elongations(actuator: ActuatorParameters) -> FloatArray:
    """Return the elongation at each target's pressure, mm."""
    model = FullModel(actuator)
    return np.asarray([model.solver.solve(pressure_kpa=p).elongation_mm for p, _ in TARGETS])


def fitted(actuator: ActuatorParameters) -> ActuatorParameters | None:
    """Return the actuator with the neck and the modulus that meet both targets; None where none is near."""
    wanted = np.asarray([mm for _, mm in TARGETS])

    def at(values: FloatArray) -> ActuatorParameters:
        return replace(actuator, wall_modulus_kpa=float(np.exp(values[0])), neck_radius_mm=float(values[1]))

    low = np.asarray([np.log(MODULUS_KPA[0]) - 1.0, 0.5])
    high = np.asarray([np.log(MODULUS_KPA[1]) + 1.0, actuator.belly_radius_mm])
    values = np.asarray([np.log(actuator.wall_modulus_kpa), actuator.neck_radius_mm])
    for _ in range(10):
        off = elongations(at(values)) - wanted
        if np.abs(off).max() < CLOSE_MM:
            return at(values) if MODULUS_KPA[0] <= np.exp(values[0]) <= MODULUS_KPA[1] else None
        steps = np.asarray([1e-3, -1e-3 * actuator.belly_radius_mm])
        slopes = [(elongations(at(values + step)) - wanted - off) / step.sum() for step in np.diag(steps)]
        move = np.linalg.lstsq(np.asarray(slopes).T, -off, rcond=None)[0]
        room = np.asarray([0.7, 0.25 * actuator.belly_radius_mm])
        values = np.clip(values + move / max(1.0, float(np.abs(move / room).max())), low, high)
    return None


def limit_kpa(model: FullModel) -> float:
    """Return the pressure of the last stable state under vacuum, in steps of 2 kPa; -inf below LOWEST_LIMIT_KPA.

    0 where -40 kPa is not stable.
    """
    last: Solution | None = None
    if model.stability.unstable_mode(model.solver.solve(pressure_kpa=TARGETS[1][0])) is not None:
        return 0.0
    for kpa in np.arange(-2.0, LOWEST_LIMIT_KPA - 2.0, -2.0).tolist():
        try:
            last = model.solver.solve(pressure_kpa=kpa, start=last)
            mode = model.stability.unstable_mode(last) if kpa < TARGETS[1][0] else None
        except BoatDaqError:
            mode = 0
        if mode is not None:
            return float(kpa + 2.0)
    return -np.inf


def tracked_guide(model: FullModel, actuator: ActuatorParameters) -> Embedding:
    """Return the tracked points of a guide; RequestError where any of its points leaves the lattice."""
    embed(model.mesh, rest_centreline(actuator, model.length_mm), model.length_mm)
    return embed(model.mesh, rest_centreline(actuator, model.length_mm, 7), model.length_mm)


def states_of(
    model: FullModel, places: Sequence[tuple[float, float]] = PLACES_MM
) -> list[tuple[ActuatorParameters, GuideStates]]:
    """Return the 15 states of every guide that runs outside the muscle and inside the lattice.

    `places`: greatest distance of a guide from the axis, and length of its end pieces.
    """
    solved: list[Solution] = []
    for kpa in PRESSURES_KPA.tolist():
        solved.append(model.solver.solve(pressure_kpa=kpa, start=solved[-1] if solved else None))
    elongation = np.asarray([one.elongation_mm for one in solved])
    found = []
    for bow, end in places:
        if bow >= model.parameters.envelope_radius_mm:
            continue
        chosen = replace(model.parameters, guide_bow_mm=bow, guide_end_mm=end)
        try:
            tracked = tracked_guide(model, chosen)
        except BoatDaqError:
            continue  # it leaves the lattice
        curves = np.asarray([both_guides(tracked.positions(one.displacement_mm)) for one in solved])
        found.append((chosen, GuideStates(curves, PRESSURES_KPA, elongation, "")))
    return found


def traced(guide: Guide, states: GuideStates, rays: int) -> list[Guide]:
    """Return the guide with its light for each face; faces that its shape refuses are left out."""
    found = []
    for face in FACES:
        try:
            design = replace(PAPER_OPTIMUM, face=face)
            chain = chain_signal(states.curves_mm, states.elongation_mm, rays, design)
        except BoatDaqError:
            continue
        first, second = (fit.r2 for fit in chain.sensors)
        found.append(replace(guide, face=face, light_change=chain.light_change_percent / 100.0, r2=(first, second)))
    return found


def solved(start: ActuatorParameters) -> tuple[str, FullModel | None, float]:
    """Return how far an actuator came; its model and the limit of its stability if it is stable at -40 kPa."""
    try:
        actuator = fitted(start)
        if actuator is None:
            return "no neck and modulus meet both elongations", None, np.nan
        model = FullModel(actuator, mesh=build_mesh(actuator))
        limit = limit_kpa(model)
    except (BoatDaqError, np.linalg.LinAlgError):
        return "no state at one of the pressures", None, np.nan
    return ("unstable above -40 kPa", None, limit) if limit > TARGETS[1][0] else ("stable at -40 kPa", model, limit)


def guide_of(chosen: ActuatorParameters, limit: float, states: GuideStates) -> Guide:
    """Return a guide with its bending."""
    curvature, bow = states.curvature_per_mm(), states.bow_mm()
    return Guide(chosen, limit, float(curvature[-1] / curvature[0] - 1.0), float(bow[-1] - bow[0]))


def drawn(options: argparse.Namespace) -> Iterator[tuple[str, list[Guide]]]:
    """Yield actuators of a Sobol sequence: how far each came, and its guides on the nodes of the lattice."""
    rng, sequence = np.random.default_rng(1), qmc.Sobol(len(RANGES) + 4, seed=1)
    while True:
        for start in actuators(sequence.random(64)):
            outcome, model, limit = solved(start)
            found: list[Guide] = []
            for chosen, states in states_of(model) if model is not None else ():
                guide = guide_of(chosen, limit, states)
                bends = guide.curvature_growth > 0.0 or rng.random() < TRACED_SHARE
                found += traced(guide, states, options.rays) if bends else [guide]
            yield outcome, found


def point_of(guide: Guide) -> list[float]:
    """Return the point of the unit cube at which `climbed` finds a guide."""
    a = guide.actuator
    values = [(getattr(a, name) - low) / (high - low) for name, (low, high) in RANGES.items()]
    values[0] = (a.cells + 0.5 - RANGES["cells"][0]) / (RANGES["cells"][1] - RANGES["cells"][0])
    neck = (a.neck_radius_mm / a.belly_radius_mm - NECK_SHARE[0]) / (NECK_SHARE[1] - NECK_SHARE[0])
    modulus = np.log(a.wall_modulus_kpa / MODULUS_KPA[0]) / np.log(MODULUS_KPA[1] / MODULUS_KPA[0])
    envelope = (a.envelope_radius_mm - ENVELOPE_MM[0]) / (ENVELOPE_MM[1] - ENVELOPE_MM[0])
    lattice = float(norm.cdf(a.lattice_modulus_kpa, 18.34, 1.86))
    place = [(a.guide_bow_mm - 12.0) / 13.0, (a.guide_end_mm - 12.5) / 52.5]
    return [*values, envelope, lattice, neck, float(modulus), *place]


def guides_in(path: Path) -> list[Guide]:
    """Return the guides in a file of this search."""
    rows = [guide for line in path.read_text().splitlines() for guide in json.loads(line)["guides"]]
    return [Guide(**row | {"actuator": ActuatorParameters(**row["actuator"]), "r2": tuple(row["r2"])}) for row in rows]


def climbed(options: argparse.Namespace) -> Iterator[tuple[str, list[Guide]]]:
    """Yield actuators of CMA-ES towards the greatest growth of curvature, or the greatest lesser R2 of both sensors.

    Distance from the axis (12 to 25 mm) and end pieces (12.5 to 65 mm) of the guides are searched too.
    """
    size = len(RANGES) + 4
    while True:
        middle, wide = [0.3, 0.6, 0.8, 0.4, 0.6, 0.5, 0.6, 0.5, 0.5, 0.6], 0.25
        if options.start is not None:
            best = max((g for g in guides_in(options.start) if g.face), key=lambda g: min(g.r2))
            middle, wide = np.clip(point_of(best), 0.001, 0.999).tolist(), 0.05
        strategy = cma.CMAEvolutionStrategy(middle, wide, {"bounds": [0.0, 1.0], "seed": 1, "verbose": -9})
        while not strategy.stop():
            points = strategy.ask()
            values = []
            for point in points:
                reached, starts = [REFUSED], actuators(np.atleast_2d(np.clip(point[:size], 0.001, 0.999)))
                outcome, model, limit = solved(starts[0]) if starts else ("no lattice outside the wall", None, np.nan)
                place = (12.0 + 13.0 * point[size], 12.5 + 52.5 * point[size + 1])
                found: list[Guide] = []
                for chosen, states in states_of(model, [place]) if model is not None else ():
                    guide = guide_of(chosen, limit, states)
                    found = [guide] if options.climb == "curvature" else traced(guide, states, options.rays)
                    growth = options.climb == "curvature"
                    reached += [guide.curvature_growth] if growth else [min(each.r2) for each in found]
                values.append(-max(reached))
                yield outcome, found
            strategy.tell(points, values)


def repeated(options: argparse.Namespace) -> Iterator[tuple[str, list[Guide]]]:
    """Yield each guide of a file on the mesh of the search and on that of the shadow."""
    for guide, mesh in itertools.product(guides_in(options.again), (MESH, SHADOW_MESH)):
        outcome, model, limit = solved(replace(guide.actuator, **mesh))
        found: list[Guide] = []
        place = guide.actuator.guide_bow_mm, guide.actuator.guide_end_mm
        for chosen, states in states_of(model, [place]) if model is not None else ():
            again = guide_of(chosen, limit, states)
            found += traced(again, states, options.rays) if guide.face else [again]
        yield outcome, found


@style.styled
def drawing(files: Sequence[Path], rays: int = 50_000) -> Figure:
    """Draw how light and curvature change in all guides found, and the best light beside the published signals."""
    guides = [guide for file in files for guide in guides_in(file)]
    lit = [guide for guide in guides if guide.face]
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    growth = [100.0 * guide.curvature_growth for guide in guides]
    left.axhline(0.0, color=style.SOFT, lw=0.6)
    left.axvline(max(growth), color=style.INK, lw=0.8, ls="--", label=f"greatest of all guides: {max(growth):+.1f} %")
    changes = [(100.0 * guide.curvature_growth, 100.0 * guide.light_change) for guide in lit]
    left.plot(*np.transpose(changes), ".", color=style.SOFT, ms=3, label=f"{len(lit)} traced of {len(guides)} guides")
    default = FullModel(ActuatorParameters())
    chosen = max(lit, key=lambda g: min(g.r2))
    model = FullModel(chosen.actuator)
    place = chosen.actuator.guide_bow_mm, chosen.actuator.guide_end_mm
    cases = (("default", guide_states(default), "outer"), ("best found", states_of(model, [place])[0][1], chosen.face))
    x = np.linspace(*RANGE_MM, 100)
    for number, sensor in enumerate(SENSORS):
        right.plot(x, np.polynomial.polynomial.polyval(x, sensor.coefficients), color=style.INK, lw=1.0,
                   label=None if number else "published")  # fmt: skip
    for (name, states, face), colour in zip(cases, style.SENSOR_COLOURS, strict=False):
        design = replace(PAPER_OPTIMUM, face=face)
        chain, curvature = chain_signal(states.curves_mm, states.elongation_mm, rays, design), states.curvature_per_mm()
        change = 100.0 * (curvature[-1] / curvature[0] - 1.0), chain.light_change_percent
        left.plot(*change, "o", color=colour, label=f"{name}: {change[0]:+.1f} and {change[1]:+.1f} %")
        for number, fit in enumerate(chain.sensors):
            signal = fit.gain_mv_per_percent * chain.light_percent + fit.offset_mv
            text = f"{name}: R² {chain.sensors[0].r2:.4f} and {chain.sensors[1].r2:.4f}"
            right.plot(states.elongation_mm, signal, "o", ms=3, color=colour, label=None if number else text)
    for degree, name in ((1, "straight line"), (2, "parabola")):
        r2 = [(fit.line_r2, fit.parabola_r2)[degree - 1] for fit in chain.sensors]
        right.plot([], [], " ", label=f"{name}: R² {r2[0]:.4f} and {r2[1]:.4f}")
    left.set(
        xlabel="curvature, change from -40 to +50 kPa, %",
        ylabel="light, change, %",
        xlim=(-16.0, 2.0),
        title="Guides of actuators that agree",
    )
    right.set(xlabel="elongation, mm", ylabel="signal, mV", title="Gain x light + offset")
    for axes in (left, right):
        axes.legend(fontsize=7.5, loc="upper left" if axes is right else "lower right")
    return figure


def main() -> None:
    """Search, and write every actuator as a line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2400.0, help="CPU time")
    parser.add_argument("--rays", type=int, default=2000)
    parser.add_argument("--climb", choices=("curvature", "light"), help="search for the greatest instead of drawing")
    parser.add_argument("--start", type=Path, help="file of a search, from whose best light to climb")
    parser.add_argument("--again", type=Path, help="file of guides, to compute on both meshes")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--draw", type=Path, nargs="+", help="files of searches, to draw instead of searching")
    options = parser.parse_args()
    if options.draw:
        style.save_picture(drawing(options.draw), options.out, dpi=120)
        return
    with options.out.open("w", encoding="utf-8") as out:
        search = repeated if options.again else climbed if options.climb else drawn
        for outcome, guides in search(options):
            out.write(json.dumps({"outcome": outcome, "guides": [guide.as_json() for guide in guides]}) + "\n")
            out.flush()
            if time.process_time() > options.seconds:
                break


if __name__ == "__main__":
    main()
