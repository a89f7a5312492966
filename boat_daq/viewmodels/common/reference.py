"""What the file of a unit or of a rig states for an analysis: type B contributions, and the curve that was accepted.

Rules: a rig's file has the same tables as a unit's, [type_b.scale] and so on, and counts before the unit's. A simulated
run takes both from the library of simulated units.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.engine.toml_values import BadValue, parse_toml, read_text

if TYPE_CHECKING:
    from analysis.calibration.curve_choice import Degree
    from analysis.calibration.inverse import Inverse
    from analysis.calibration.type_b import TypeBContribution
    from analysis.data.recording import Recording


def stated_contributions(recording: Recording, rig: Path | None = None) -> tuple[TypeBContribution, ...]:
    """Return the type B contributions that a rig's file states, or else the unit's; none where neither states any.

    Parameters
    ----------
    recording : of the unit; it may name none.
    rig : file of the rig; None for none.

    Raises
    ------
    OperatorError : a file is refused. AnalysisError : a contribution is refused, by name and key.
    """
    from analysis.calibration.type_b import contributions

    if rig is not None:
        table = parse_toml(read_text(rig), str(rig)).get("type_b")
        if not isinstance(table, dict):
            raise BadValue(str(rig), "type_b", "is missing", "write [type_b.scale] and its keys below it")
        return contributions(table)
    unit = _unit(recording)
    return contributions(unit.type_b) if unit is not None else ()


def chosen_curve(recording: Recording, choice: str = "") -> Degree:
    """Return the curve of a calibration: as chosen, else as it was accepted with this recording, else the usual one.

    Parameters
    ----------
    recording : of the unit; it may name none.
    choice : as `degree_of` takes it; empty for none.

    Raises
    ------
    OperatorError : the unit's file is refused. AnalysisError : there is no such curve.
    """
    from analysis.calibration.curve_choice import USUAL_DEGREE, degree_of

    unit, own = None if choice else _unit(recording), identity(recording)
    accepted = (
        str(entry.content.get("curve", ""))
        for entry in reversed(unit.history if unit is not None else ())
        if entry.accepted and entry.content.get("recording_id") == own
    )
    return degree_of(choice or next(accepted, "") or str(USUAL_DEGREE))


def stored_inverse(stored: Mapping[str, Any]) -> Inverse:
    """Return the inverse of one sensor of an accepted calibration, with the uncertainty of its run.

    Its points are fitted again, so that it is exactly the accepted calibration. Where no uncertainty is stored it is
    that of the residuals of the fit.

    Raises
    ------
    AnalysisError : the curve has no inverse over its range.
    """
    from analysis.calibration.curve_choice import SPLINE
    from analysis.calibration.fit import fit_by_branch, fit_calibration
    from analysis.calibration.inverse import Inverse
    from analysis.calibration.type_b import contributions

    points, degree = (stored["elongation_mm"], stored["signal_mv"]), int(stored["fit"]["degree"])
    reading_sd, positions = float(stored.get("reading_sd_mm") or 0.0), stored.get("positions")
    if stored.get("branches") is not None:
        branch = stored["branches"]
        curve: int | Literal["spline"] = SPLINE if stored["fit"].get("curve") == SPLINE else degree
        fit = fit_by_branch(*points, curve, positions=stored["positions"], branch=branch, reading_sd=reading_sd)
    else:  # accepted before the branches were stored
        fit = fit_calibration(*points, degree).with_reading(reading_sd, positions)
    type_b = contributions(stored.get("type_b") or {})
    model_sd = float(stored.get("model_mv") or 0.0)
    return Inverse.of(fit, noise_sd=stored.get("noise_mv"), model_sd=model_sd, type_b=type_b)


def identity(recording: Recording) -> str:
    """Return what names a recording whatever its file is called: its UUID, or else the name of the file."""
    return str(recording.meta.get("uuid") or Path(recording.source).name)


def _unit(recording: Recording) -> Unit | None:
    """Return the stored unit of a recording; None where it names none or none is stored."""
    library = UnitLibrary(simulated=recording.simulated)
    return library.load(recording.unit) if recording.unit in library.names() else None
