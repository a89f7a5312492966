"""What the trade-off page has swept for it, in a process of its own: the maps of one method."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from analysis.atlas.methods import chosen_studies
from analysis.atlas.report import atlas_json
from analysis.atlas.sweep import sweep

Progress = Callable[[float, float], None]


def sweep_method(name: str, *, progress: Progress | None = None) -> dict[str, Any]:
    """Sweep every map of a method; return what `boat-daq atlas --json` prints.

    Raises
    ------
    RequestError : there is no such method.
    """
    studies = chosen_studies([name])
    places = [study.places for study in studies]
    maps = []
    for i, study in enumerate(studies):

        def within(done: float, total: float, before: int = sum(places[:i])) -> None:
            if progress is not None:
                progress(before + done, sum(places))

        maps.append(sweep(study, within))
    return atlas_json(maps)
