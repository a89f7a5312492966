"""Results kept in the recording they came from, so that a report can be traced and a figure reproduced.

A result carries its parameters, its seed and the program's version; the same result is kept once. A run that is no
`.boat` file, or cannot be written, keeps nothing, and returns why.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analysis.calibration.curve_choice import degree_of
from analysis.calibration.type_b import contributions
from analysis.data.boat_file import is_boat_file, store_result
from analysis.fidelity import fidelity
from analysis.figures.pipeline import Analysis, analyse
from analysis.figures.sensor_analysis import MOST_RESAMPLES, Options
from analysis.numbers import finite
from analysis.segmentation.plateaus import PlateauSettings
from protocol.base.errors import BoatDaqError, FileError

_COMPUTING = (".", "data", "segmentation", "calibration", "tracking", "figures")


def store_analysis(run: str | Path, analysis: Analysis, elongation: str | Path | None = None) -> str:
    """Keep an analysis, and name and hash of its file of elongations, in its recording; return why not, or ""."""
    run = Path(run)
    if not is_boat_file(run):
        return ""
    options = asdict(replace(analysis.options, type_b=()))
    options["type_b"] = {one.name: one.as_table() for one in analysis.options.type_b}
    parameters: dict[str, Any] = {"options": options, "code": code_state()}
    if elongation is not None:
        file = Path(elongation)
        parameters["elongation"] = {"name": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
    try:
        store_result(run, "analysis", finite(analysis.to_json()), parameters, seed=analysis.options.seed)
    except BoatDaqError as error:
        return f"the result was not stored: {error.cause}. {error.remedy}".rstrip(". ") + "."
    return ""


@cache
def code_state() -> str:
    """Return a hash of all code that figures rest on, to distinguish states of the program with the same version.

    It covers the packages that figures are computed by, the recording's schema, and the versions of the numerical
    libraries.
    """
    analysis = Path(__file__).parents[1]
    sources = [file for package in _COMPUTING for file in sorted((analysis / package).glob("*.py"))]
    digest = hashlib.sha256()
    for file in (*sources, analysis.parent / "protocol" / "recording" / "schema.py"):
        digest.update(file.name.encode() + file.read_bytes().replace(b"\r\n", b"\n"))
    for name in ("numpy", "scipy", "pandas", "emcee"):
        digest.update(f"{name} {version(name)}".encode())
    return digest.hexdigest()[:12]


def reproduce(run: str | Path, parameters: Mapping[str, Any]) -> dict[str, Any] | None:
    """Compute a stored analysis again; None if it used a file of elongations; FileError for other parameters."""
    if "elongation" in parameters:
        return None
    try:
        options = _stored_options(parameters["options"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        cause = f"the parameters of a stored result of {Path(run).name} cannot be used: {error!r:.100}"
        raise FileError(cause, "The file is damaged, or was made by another program.") from error
    content: dict[str, Any] = finite(analyse(run, options=options).to_json())
    return content


def _stored_options(stored: Mapping[str, Any]) -> Options:
    table = {**asdict(Options()), **stored}  # an older program had fewer
    table.pop("derived", None)  # or definitions of channels
    plateau = PlateauSettings(**table["plateau"])
    numbers = (table["seed"], table["x_resolution_mm"] or 0, *asdict(plateau).values())
    if not all(isinstance(number, int | float) and number >= 0 for number in numbers):
        raise ValueError(f"no number, or a negative one, among {numbers}")
    draws = {name: table[name] for name in ("resamples", "posterior_samples")}
    if not all(n is None or (isinstance(n, int) and 0 < n <= MOST_RESAMPLES) for n in draws.values()):
        raise ValueError(f"no usable number of draws among {draws}")
    read = {
        "degree": degree_of(str(table["degree"])), "seed": int(table["seed"]), "plateau": plateau,
        "fidelity": fidelity(str(table["fidelity"])).level, "type_b": contributions(table["type_b"] or {}),
    }  # fmt: skip
    return Options(**{**table, **read})
