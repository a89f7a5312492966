"""`boat-daq report`: one file that one can send."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, progress_bar, say
from boat_daq.commands.fidelity import FidelityOption, level_of


def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="One run, or several to compare.")],
    to: Annotated[Path, typer.Option("--out", metavar="FILE.html|FILE.pdf", help="The report; its ending decides.")],
    elongation: Annotated[
        list[Path] | None, typer.Option(help="CSV of read elongations; repeat it once for each run, in order.")
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option("--limit", metavar="NAME=VALUE", help="hysteresis, repeatability, drift, snr, ..."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the intervals and the posterior.")] = 0,
    no_mcmc: Annotated[bool, typer.Option("--no-mcmc", help="Leave the posterior out.")] = False,
    no_shadow: Annotated[bool, typer.Option("--no-shadow", help="Leave the digital shadow out.")] = False,
    fidelity: FidelityOption = "normal",
    json: JsonOption = False,
) -> None:
    """A calibration or a 100-cycle repeatability report, as the run is; several runs are compared.

    Example:

        boat-daq report run.boat --out run.pdf --limit hysteresis=6 --limit repeatability=0.5
    """
    if to.suffix.lower() not in (".html", ".pdf"):
        raise typer.BadParameter("end it in .html or .pdf", param_hint="--out")
    if elongation and len(elongation) not in (1, len(runs)):
        raise typer.BadParameter(f"{len(elongation)} files for {len(runs)} runs", param_hint="--elongation")
    from analysis import Options, analyse, write_report
    from analysis.figures.against_shadow import against_shadow

    options = Options(seed=seed, mcmc=not no_mcmc, fidelity=level_of(fidelity))
    limits = dict(_limit(text) for text in limit or ())
    files: list[Path | None] = [*elongation] if elongation else [None]
    given = files * len(runs) if len(files) == 1 else files
    with progress_bar("Reporting") as advance:
        analyses = []
        for number, (run, file) in enumerate(zip(runs, given, strict=True)):
            analyses.append(analyse(run, file, options=options))
            advance(number + 1, len(runs) + 1)
        alone = len(analyses) == 1 and analyses[0].kind == "calibration" and not no_shadow
        content = write_report(analyses, to, limits, against_shadow(analyses[0]) if alone else None)
        advance(len(runs) + 1, len(runs) + 1)
    if json:
        emit_json({"file": to, "title": content.title, "verdict": content.verdict, "simulated": content.simulated})
    else:
        say(f"wrote {to}: {content.title}. {content.verdict}")


def _limit(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not NAME=VALUE", param_hint="--limit") from None
