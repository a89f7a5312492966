"""The result of a race as JSON and as text."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from analysis.numbers import finite
from analysis.optics.scene.parameters import By, Design
from analysis.optics.sweep.race import Race
from analysis.version import program_version

_SHOWN = 5


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
    """Return the same as a few lines of text."""
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
