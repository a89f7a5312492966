"""`boat-daq verify`: everything derived again from the raw bytes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar

if TYPE_CHECKING:
    from boat_daq.engine.recording.verify import StoredResult, Verification

IMPORTED = "import:"  # the port of a recording that came from a CSV


def verify(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A recording (.boat).")],
    as_json: JsonOption = False,
) -> None:
    """Derive a run again, from its raw bytes to its figures, and say `identical`, or name the first difference.

    Example: boat-daq verify recordings/run.boat
    """
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.recording.verify import verify_recording

    with progress_bar("verifying") as progress:
        if (summarise(run).port or "").startswith(IMPORTED):
            verdict = verify_import(run)
        else:
            from analysis.figures.stored_results import code_state

            verdict = verify_recording(run, reanalyse=reanalyse, code=code_state(), progress=progress)
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
    from analysis.figures.stored_results import reproduce

    return reproduce(run, stored.id, stored.parameters) if stored.kind == "analysis" else None


def verify_import(run: Path) -> Verification:
    """Import the kept bytes of a CSV again."""
    import time

    from analysis.data.import_check import first_difference
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.recording.verify import Verification

    begun = time.perf_counter()
    difference = first_difference(run)
    samples = summarise(run).samples
    return Verification(not difference, difference, samples, 0, 0, time.perf_counter() - begun)
