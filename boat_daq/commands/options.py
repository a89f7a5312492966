"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click
import typer

from analysis.fidelity import LEVELS, Level

RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="A .boat file, or a CSV that `import` accepts.")]
RecordingArgument = Annotated[Path, typer.Argument(metavar="RUN", help="A recording (.boat).")]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the intervals and the posterior.")]
NoMcmcOption = Annotated[bool, typer.Option("--no-mcmc", help="Omit the posterior.")]
NoShadowOption = Annotated[bool, typer.Option("--no-shadow", help="Omit the digital shadow.")]
AllowRemoteOption = Annotated[bool, typer.Option("--allow-remote", help="Allow an address outside this computer.")]
FolderArgument = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of .boat or .csv runs, each with NAME.elongation.csv.")
]
PlotOption = Annotated[Path | None, typer.Option(help="Also write a plot: PNG, SVG or PDF.")]

FidelityOption = Annotated[
    Level,
    typer.Option("--fidelity", click_type=click.Choice(LEVELS), help="Precision of the computation."),
]
OptionalFidelity = Annotated[
    Level | None,
    typer.Option(
        "--fidelity", click_type=click.Choice(LEVELS), help="Precision of the computation; default the paper's."
    ),
]
