"""The option `--fidelity` of every command that computes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from analysis.fidelity import Level

HELP = "How fine it computes: draft, normal or reference (see `tradeoff`)."


def known_level(value: str | None) -> str | None:
    """Refuse a level that is none.

    Raises
    ------
    typer.BadParameter : naming the levels.
    """
    from analysis.fidelity import LEVELS

    if value is not None and value not in LEVELS:
        raise typer.BadParameter(f"'{value}' is none of {', '.join(LEVELS)}")
    return value


def level_of(value: str) -> Level:
    """Return a checked option's value as a level."""
    from analysis.fidelity import fidelity

    return fidelity(value).level


FidelityOption = Annotated[str, typer.Option("--fidelity", metavar="LEVEL", help=HELP, callback=known_level)]
OptionalFidelity = Annotated[str | None, typer.Option("--fidelity", metavar="LEVEL", help=HELP, callback=known_level)]
