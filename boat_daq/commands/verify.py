"""`boat-daq verify`: everything derived again from the raw bytes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar

if TYPE_CHECKING:
    from boat_daq.engine.verify import StoredResult


def verify(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A recording (.boat).")],
    as_json: JsonOption = False,
) -> None:
    """Derive a run again, from its raw bytes to its figures, and say `identical`, or name the first difference.

    Example: boat-daq verify recordings/run.boat
    """
    from boat_daq.engine.verify import verify_recording

    with progress_bar("verifying") as progress:
        verdict = verify_recording(run, reanalyse=reanalyse, progress=progress)
    if as_json:
        emit_json(verdict)
    else:
        out.print(
            "identical" if verdict.identical else f"different: {verdict.difference}", highlight=False, markup=False
        )
    if not verdict.identical:
        raise typer.Exit(1)


def reanalyse(run: Path, stored: StoredResult) -> dict[str, Any] | None:
    """Compute a stored analysis anew; other kinds, and those that rest on files of their own, pass."""
    from analysis.results import reproduce

    return reproduce(run, stored.id, stored.parameters) if stored.kind == "analysis" else None
