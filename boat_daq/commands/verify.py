"""`boat-daq verify`: derive everything again from the raw bytes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from boat_daq.commands.console import JsonOption, present, progress_bar
from boat_daq.commands.options import RecordingArgument

if TYPE_CHECKING:
    from boat_daq.engine.recording.verify import StoredResult, Verification

IMPORTED = "import:"  # scheme of the port of a recording imported from a CSV


def verify(run: RecordingArgument, as_json: JsonOption = False) -> None:
    """Derive a run again, from its raw bytes to its figures, and print `identical` or the first difference.

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
    present(verdict, "identical" if verdict.identical else f"different: {verdict.difference}", as_json=as_json)
    if not verdict.identical:
        raise typer.Exit(1)


def reanalyse(run: Path, stored: StoredResult) -> dict[str, Any] | None:
    """Return a stored analysis computed anew; None for other kinds, and for those that used other files."""
    from analysis.figures.stored_results import reproduce

    return reproduce(run, stored.id, stored.parameters) if stored.kind == "analysis" else None


def verify_import(run: Path) -> Verification:
    """Return the comparison of an imported recording with a new import of its stored CSV."""
    import time

    from analysis.data.import_check import first_difference
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.recording.verify import Verification

    begun = time.perf_counter()
    difference = first_difference(run)
    return Verification(not difference, difference, summarise(run).samples, 0, 0, time.perf_counter() - begun)
