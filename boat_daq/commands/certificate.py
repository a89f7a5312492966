"""`boat-daq certificate`: the calibration certificate of a run, or of several that are compared."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar
from boat_daq.commands.options import (
    LimitOption,
    SetOption,
    limits_of,
    values_of,
)


def certificate(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="A calibration, or several to compare.")],
    to: Annotated[Path, typer.Option("--out", metavar="FILE.pdf|FILE.xml", help="File to write.")],
    item: Annotated[
        list[str] | None, typer.Option(metavar="TEXT", help="The item; repeat it for each run, in order.")
    ] = None,
    customer: Annotated[str, typer.Option(metavar="TEXT", help="The customer; default that of the recording.")] = "",
    laboratory: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="The laboratory: name, street, city, country_code, ...")
    ] = None,
    values: SetOption = None,
    number: Annotated[str, typer.Option(metavar="TEXT", help="Number of the certificate; default a unique one.")] = "",
    elongation: Annotated[
        list[Path] | None, typer.Option(help="CSV of elongation readings; repeat it for each run, in order.")
    ] = None,
    limit: LimitOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write a calibration certificate (ISO/IEC 17025, 7.8): PDF/A-3 with its XML inside, or the XML (DCC 3.2.1) alone.

    What the recording does not contain: --item, --customer, --set KEY=VALUE. A simulated run gives a document that
    is marked on every page and is no certificate.

    Example: boat-daq certificate SA1.boat --out SA1.pdf --customer "Soft Robotics Lab" --laboratory lab.toml
    """
    from analysis.numbers import finite
    from boat_daq.workflows.certificate import CertificateOrder, certificate_for, write_certificate

    if to.suffix.lower() not in (".pdf", ".xml"):
        raise typer.BadParameter("must end in .pdf or .xml", param_hint="--out")
    if elongation and len(elongation) not in (1, len(runs)):
        raise typer.BadParameter(f"{len(elongation)} files for {len(runs)} runs", param_hint="--elongation")
    if item and len(item) != len(runs):
        raise typer.BadParameter(f"{len(item)} items for {len(runs)} runs", param_hint="--item")
    order = CertificateOrder(
        tuple(runs), tuple(elongation or ()), "", limits_of(limit), values_of(values), customer,
        tuple(item or ()), number, laboratory,
    )  # fmt: skip
    with progress_bar("Certifying") as advance:
        made = certificate_for(order, advance)
        write_certificate(made, to)
    if as_json:
        emit_json({"file": to, **finite(made.as_json())})
        return
    notify(f"wrote {to}: {made.title} no. {made.number}")
    for one in made.items:
        notify(f"{one.name}: an elongation is {one.traceability.text}")
