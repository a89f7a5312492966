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
    from analysis.calibration_export.calibration_file import CalibrationFile
    from analysis.data.export import ConvertedElongation
    from analysis.data.recording import Recording
    from analysis.figures.sensor_analysis import Options


def stated_contributions(recording: Recording, rig: Path | None = None) -> tuple[TypeBContribution, ...]:
    """Return the type B contributions that a rig's file states, or else the unit's; none where neither states any.

    Parameters
    ----------
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
    half_loop, model_sd = stored.get("half_loop_mv"), stored.get("between_cycles_mv")
    if half_loop is None or model_sd is None:  # accepted before the loop's course was stored: its rms is in the model
        half_loop, model_sd = 0.0, float(stored.get("model_mv") or 0.0)
    noise_sd = stored.get("noise_mv")
    return Inverse.of(fit, noise_sd=noise_sd, model_sd=model_sd, half_loop=half_loop, type_b=type_b)


def calibration_in_force(recording: Recording) -> CalibrationFile | None:
    """Return the calibration that the unit of a recording was last accepted with; None where it has none.

    Raises
    ------
    OperatorError : the unit's file is refused. AnalysisError : the curve has no inverse over its range.
    """
    from analysis.calibration.inverse import Fusion
    from analysis.calibration.type_b import contributions, traceability
    from analysis.calibration_export.calibration_file import CalibrationFile

    unit = _unit(recording)
    stored = unit.calibration if unit is not None else None
    if unit is None or stored is None:
        return None
    contents = stored.content["sensors"]
    inverses = tuple(stored_inverse(content) for content in contents)
    fits = [inverse.calibration for inverse in inverses]
    head = {
        "program_version": stored.program_version, "simulated": recording.simulated, "unit": unit.name,
        "recording": stored.recording, "recording_id": str(stored.content.get("recording_id", "")),
        "calibrated_utc": stored.utc, "operator": stored.operator, "warnings": [],
        "traceability": traceability(contributions(contents[0].get("type_b") or {})).text,
    }  # fmt: skip
    sensors = tuple(
        {
            "name": content["name"], "fit": content["fit"], "u_elongation_mm": [],
            "adequacy": fit.adequacy.as_json() if fit is not None and fit.adequacy is not None else None,
        }
        for content, fit in zip(contents, fits, strict=True)
    )  # fmt: skip
    return CalibrationFile(head, sensors, Fusion.of(inverses))


def exported_elongation(
    recording: Recording, options: Options, elongation: Path | None = None
) -> tuple[ConvertedElongation | None, str]:
    """Return the elongation of every sample of a recording, or None and why there is none.

    It is that of the run's own calibration, else that of the calibration in force of its unit.

    Parameters
    ----------
    recording, options, elongation : as `analysis.calibration_export.conversion.own_elongation` takes them.

    Raises
    ------
    OperatorError : the unit's file is refused.
    """
    from analysis.calibration_export.conversion import convert_recording, own_elongation
    from analysis.errors import AnalysisError

    try:
        return own_elongation(recording, options, elongation), ""
    except AnalysisError as error:
        void = error.cause
    try:
        accepted = calibration_in_force(recording)
        if accepted is not None:
            return convert_recording(recording, accepted), ""
    except AnalysisError as error:
        void = f"{void}; the calibration of the unit: {error.cause}"
    return None, void


def identity(recording: Recording) -> str:
    """Return what names a recording whatever its file is called: its UUID, or else the name of the file."""
    return str(recording.meta.get("uuid") or Path(recording.source).name)


def _unit(recording: Recording) -> Unit | None:
    """Return the stored unit of a recording; None where it names none or none is stored."""
    library = UnitLibrary(simulated=recording.simulated)
    return library.load(recording.unit) if recording.unit in library.names() else None
