"""`boat-daq report`: a report as one HTML or PDF file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar
from boat_daq.commands.options import FidelityOption, NoMcmcOption, NoShadowOption, SeedOption


def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="One run, or several to compare.")],
    to: Annotated[Path, typer.Option("--out", metavar="FILE.html|FILE.pdf", help="File to write.")],
    elongation: Annotated[
        list[Path] | None, typer.Option(help="CSV of elongation readings; repeat it for each run, in order.")
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            "--limit", metavar="NAME=VALUE", help="Acceptance limit: hysteresis, repeatability, drift, snr, ..."
        ),
    ] = None,
    seed: SeedOption = 0,
    no_mcmc: NoMcmcOption = False,
    no_shadow: NoShadowOption = False,
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Write a calibration or repeatability report, by the kind of the run; several runs are compared.

    Example: boat-daq report run.boat --out run.pdf --limit hysteresis=6 --limit repeatability=0.5
    """
    if to.suffix.lower() not in (".html", ".pdf"):
        raise typer.BadParameter("must end in .html or .pdf", param_hint="--out")
    if elongation and len(elongation) not in (1, len(runs)):
        raise typer.BadParameter(f"{len(elongation)} files for {len(runs)} runs", param_hint="--elongation")
    from analysis import Options, analyse, write_report
    from analysis.figures.against_shadow import against_shadow

    options = Options(seed=seed, mcmc=not no_mcmc, fidelity=fidelity)
    limits = dict(_limit(text) for text in limit or ())
    files: list[Path | None] = [*elongation] if elongation else [None]
    with progress_bar("Reporting") as advance:
        analyses = []
        for number, run in enumerate(runs):
            analyses.append(analyse(run, files[number % len(files)], options=options))
            advance(number + 1, len(runs) + 1)
        compared = len(analyses) == 1 and analyses[0].kind == "calibration" and not no_shadow
        content = write_report(analyses, to, limits, against_shadow(analyses[0]) if compared else None)
        advance(len(runs) + 1, len(runs) + 1)
    if as_json:
        emit_json({"file": to, "title": content.title, "verdict": content.verdict, "simulated": content.simulated})
    else:
        notify(f"wrote {to}: {content.title}. {content.verdict}")


def _limit(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not NAME=VALUE", param_hint="--limit") from None
