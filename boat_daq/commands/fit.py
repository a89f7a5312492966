"""`boat-daq fit`: a polynomial calibration of any two columns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analysis.calibration.fit import Calibration
    from analysis.calibration.general_fit import GeneralFit
    from analysis.calibration.posterior import Posterior
    from protocol.base.arrays import BoolArray, FloatArray

_BAND_POINTS = 101


class _Points(NamedTuple):
    """The columns of a fit, [n] each: u and positions None where none was named; and the number of incomplete rows."""

    x: FloatArray
    y: FloatArray
    u: FloatArray | None
    positions: NDArray[Any] | None
    masked: int

    def of(self, rows: BoolArray) -> _Points:
        u, positions = (None if part is None else part[rows] for part in (self.u, self.positions))
        return _Points(self.x[rows], self.y[rows], u, positions, self.masked)


UOption = Annotated[
    str | None,
    typer.Option("--u", metavar="COL", help="Column of the stated standard uncertainty of y, tested by chi-square."),
]
ThroughZeroOption = Annotated[bool, typer.Option("--through-zero", help="The curve passes through x = 0, y = 0.")]
MonotoneOption = Annotated[bool, typer.Option("--monotone", help="The curve rises or falls over its whole range.")]
LeaveOutOption = Annotated[
    bool, typer.Option("--leave-out", help="Leave out points that are off the curve; each is listed.")
]
BandsOption = Annotated[bool, typer.Option("--bands", help="Add 68 and 95 % bands of the curve and of a new reading.")]
XResolutionOption = Annotated[
    float,
    typer.Option(min=0.0, metavar="X", help="Resolution of x, in its unit; above 0 the posterior is sampled."),
]
PositionOption = Annotated[
    str | None,
    typer.Option(metavar="COL", help="Column that names the position of x: equal positions share one rounding error."),
]


def fit(
    file: Annotated[Path, typer.Argument(metavar="FILE.csv", help="A table of numbers.")],
    x: Annotated[str, typer.Option(metavar="COL", help="Column of x: its name, or its number from 1.")],
    y: Annotated[str, typer.Option(metavar="COL", help="Column of y.")],
    degree: Annotated[int, typer.Option(min=0, max=10, help="Degree of the polynomial.")] = 3,
    u: UOption = None,
    through_zero: ThroughZeroOption = False,
    monotone: MonotoneOption = False,
    leave_out: LeaveOutOption = False,
    bands: BandsOption = False,
    x_resolution: XResolutionOption = 0.0,
    position: PositionOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fit a polynomial calibration to any two columns of a CSV.

    Rows with a missing number are omitted and counted.

    Example: boat-daq fit pontius.csv --x load --y deflection --degree 2 --json
    """
    from analysis.calibration.general_fit import FitOptions, general_fit

    if x_resolution > 0 and through_zero:
        raise typer.BadParameter("has no posterior through zero", param_hint="--x-resolution")
    read = _readings(file, x, y, u, position)
    options = FitOptions(through_zero, monotone, leave_out)
    found = general_fit(read.x, read.y, degree, standard_uncertainty=read.u, options=options)
    read = read.of(found.kept)
    reading_sd = x_resolution / 12**0.5
    calibration = found.calibration.with_reading(reading_sd, read.positions)
    posterior = None
    if x_resolution > 0:
        posterior = _posterior(read, calibration, reading_sd, monotone=monotone)
    for warning in (*found.warnings, *(posterior.warnings if posterior is not None else ())):
        notify(warning.text)
    content = _content(found, calibration, read.masked)
    if posterior is not None:
        content["posterior"] = posterior.as_json() | {"band_error": posterior.band_error()}
    if bands:
        content["bands"] = _bands(calibration, posterior)
    terms = zip(calibration.coefficients, content["std_errors_with_reading"], strict=True)
    present(
        content,
        *(f"b{i} = {b:.12g}   u = {error:.3g}" for i, (b, error) in enumerate(terms)),
        f"R2 = {calibration.r2:.8f}   RMSE = {content['rmse']:.6g}   n = {content['n']}",
        f"range {content['range']}   monotone: {content['monotone']}",
        *([] if posterior is None else [_sampled(posterior)]),
        *_tested(found),
        as_json=as_json,
    )


def _sampled(posterior: Posterior) -> str:
    """Return the Monte-Carlo error of the band as a line."""
    return f"Monte-Carlo error of the 95 % band with {posterior.n_eff:.0f} samples: {posterior.band_error():.2g}"


def _content(found: GeneralFit, calibration: Calibration, masked: int) -> dict[str, Any]:
    """Return the object of the fit without posterior and bands; `calibration` knows of the reading of x."""
    from analysis.calibration.checks import fit_checks
    from analysis.json_object import json_object

    return (
        found.as_json()
        | calibration.as_json()
        | {
            "residual_sd": found.residual_sd,
            "masked": masked,
            "checks": fit_checks(calibration),
            "notes": [warning.text for warning in found.warnings],
        }
        | json_object(found, "warnings")
    )


def _posterior(read: _Points, calibration: Calibration, reading_sd: float, *, monotone: bool) -> Posterior:
    """Sample the posterior of a fit whose x were read on a grid; notify where they share one error."""
    from analysis.calibration.posterior import sample_posterior
    from analysis.calibration.quantised_x import share_their_error
    from analysis.fidelity import fidelity

    fineness = fidelity("normal")
    with progress_bar("samples") as advance:
        found = sample_posterior(
            read.x, read.y, calibration.degree, reading_sd=reading_sd, positions=read.positions,
            standard_uncertainty=read.u, monotone=monotone, walkers=fineness.walkers,
            samples=fineness.posterior_samples, progress=advance,
        )  # fmt: skip
    if read.positions is None and share_their_error(calibration.fit, calibration.x, calibration.y, reading_sd):
        notify("signals at equal x scatter less than independent reading errors: one common error is assumed")
    return found


def _tested(found: GeneralFit) -> list[str]:
    """Return the test of a stated uncertainty as a line, and the points left out as lines."""
    lines = []
    if found.stated is not None:
        test = found.stated
        verdict = str(test.verdict).replace("_", " ")
        lines.append(
            f"stated uncertainty: {verdict}, chi-square {test.chi_squared:.4g} with {test.dof} degrees of freedom "
            f"({test.low:.4g} to {test.high:.4g} expected); the scatter is {test.ratio:.2g} times the stated one"
        )
    left = (f"row {p.row + 1}: x = {p.x:.6g}, y = {p.y:.6g}, {p.residual:+.3g} off: left out" for p in found.left_out)
    return [*lines, *left]


def _readings(file: Path, x: str, y: str, u: str | None, position: str | None) -> _Points:
    """Return the complete rows of the columns."""
    import numpy as np

    from analysis.data.csv_table import read_table

    table = read_table(file)
    columns = [table.columns[table.position(name)] for name in (x, y, u) if name is not None]
    known = np.asarray(np.isfinite(columns).all(axis=0))
    masked = int((~known).sum()) + table.broken
    if masked:
        notify(f"{masked} rows omitted: a number is missing")
    for warning in table.warnings:
        notify(warning.text)
    labels = np.asarray(table.labels(position)) if position is not None else None
    return _Points(columns[0], columns[1], columns[2] if u is not None else None, labels, masked).of(known)


def _bands(calibration: Calibration, posterior: Posterior | None) -> dict[str, Any]:
    import numpy as np

    grid = np.linspace(*calibration.x_range, _BAND_POINTS)
    method = "posterior" if posterior else "Student t"
    content: dict[str, Any] = {"x": grid, "y": calibration.predict(grid), "method": method}
    for level in (0.68, 0.95):
        if posterior is not None:
            curve, reading = posterior.curve_band(grid, level), posterior.new_reading_band(grid, level)
        else:
            curve, reading = calibration.band(grid, level), calibration.band(grid, level, new_reading=True)
        content[f"curve_{100 * level:.0f}"] = list(curve)
        content[f"new_reading_{100 * level:.0f}"] = list(reading)
    return content
