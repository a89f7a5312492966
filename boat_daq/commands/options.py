"""Arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.calibration.curve_choice import AUTO, CURVES
from analysis.fidelity import LEVELS, Level


def one_of(*choices: str) -> Callable[[str | None], str | None]:
    """Return the callback of an option that refuses every value but these."""

    def check(value: str | None) -> str | None:
        if value is not None and value not in choices:
            raise typer.BadParameter(f"{value!r} is none of {', '.join(choices)}")
        return value

    check.choices = choices  # type: ignore[attr-defined]  # for the completion of the shell
    return check


RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="A .boat file, or a CSV that `import` accepts.")]
PortOption = Annotated[str, typer.Option("--port", help="Serial port, pty or socket://HOST:PORT.")]
ProfileOption = Annotated[Path | None, typer.Option("--profile", help="Text profile (TOML) of other firmware.")]
ReadingsOption = Annotated[
    Path | None, typer.Option("--elongation", help="CSV of elongation readings, one row per plateau.")
]
RecordingArgument = Annotated[Path, typer.Argument(metavar="RUN", help="A recording (.boat).")]
MapOption = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="NAME=COLUMN[*SCALE][+OFFSET][:UNIT]",
        help="Column for time_s, pressure_kpa, elongation_mm, target_kpa, s1_mv, ..., or FILE.json; may be repeated.",
    ),
]
RateOption = Annotated[
    float | None, typer.Option("--rate", min=0.001, metavar="HZ", help="Sampling rate, in place of a column of time.")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the intervals and the posterior.")]
NoMcmcOption = Annotated[bool, typer.Option("--no-mcmc", help="Omit the posterior.")]
NoShadowOption = Annotated[bool, typer.Option("--no-shadow", help="Omit the digital shadow.")]
AllowRemoteOption = Annotated[bool, typer.Option("--allow-remote", help="Allow an address outside this computer.")]
FolderArgument = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of .boat or .csv runs, each with NAME.elongation.csv.")
]
LimitOption = Annotated[
    list[str] | None,
    typer.Option("--limit", metavar="NAME=VALUE", help="Acceptance limit: hysteresis, repeatability, drift, snr, ..."),
]
TypeBOption = Annotated[
    Path | None,
    typer.Option(
        "--type-b",
        metavar="FILE.toml",
        help="Type B contributions of grid or photograph, parallax, pressure gauge, temperature.",
    ),
]
_DEGREE = typer.Option(
    metavar="N|auto|spline",
    callback=one_of(AUTO, *CURVES),
    help="Curve: degree 1 to 6, a monotone spline, or the best of them.",
)
DegreeOption = Annotated[str, _DEGREE]
XResolutionOption = Annotated[
    float | None,
    typer.Option(min=0.0, metavar="MM", help="Resolution of the readings, else their own steps; 0 = exact."),
]
UncertaintyOption = Annotated[
    float | None,
    typer.Option(
        "--uncertainty",
        metavar="MM",
        help="End the run once U (k = 2) at mid-range is at most this; print U at the end.",
    ),
]
LeaveOutOption = Annotated[
    bool, typer.Option("--leave-out", help="Leave out readings that are off the curve; each is named.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Metadata: customer, item, serial_number, ...; may be repeated."),
]
PlotOption = Annotated[Path | None, typer.Option(help="Also write a plot: PNG, SVG or PDF.")]


def limits_of(texts: list[str] | None) -> dict[str, float]:
    return dict(_limit(text) for text in texts or ())


def values_of(texts: list[str] | None) -> dict[str, str]:
    for text in texts or ():
        if "=" not in text:
            raise typer.BadParameter(f"{text!r} is not KEY=VALUE")
    return {key.strip(): value for key, _, value in (text.partition("=") for text in texts or ())}


def _limit(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not NAME=VALUE", param_hint="--limit") from None


if TYPE_CHECKING:
    LevelName = Level
else:
    LevelName = str  # older releases of typer have no Literal

_LEVEL = typer.Option(
    "--fidelity", metavar="LEVEL", callback=one_of(*LEVELS), help="Precision: draft, normal or reference."
)
FidelityOption = Annotated[LevelName, _LEVEL]
OptionalFidelity = Annotated[LevelName | None, _LEVEL]
UnusedFidelity = Annotated[LevelName | None, typer.Option("--fidelity", callback=one_of(*LEVELS), hidden=True)]
