"""The result of a qualification as one JSON object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

from boat_daq.engine.qualification.installation import disk, machine, program, versions
from boat_daq.engine.qualification.test_rig import DrillResult


def qualification(results: Sequence[DrillResult], begun: datetime, *, whole: bool, folder: Path) -> dict[str, Any]:
    """Return the object of `qualify --json`, without its files.

    Parameters
    ----------
    results : of the drills that were run.
    begun : when.
    whole : whether these are all drills.
    folder : of the report, whose disk was tested.
    """
    failed = [result.name for result in results if not result.passed]
    if failed:
        verdict = f"FAILED: {', '.join(failed)}. Do not use this installation until the cause is found."
    elif whole:
        verdict = f"PASSED: all {len(results)} drills."
    else:
        names = ", ".join(result.name for result in results)
        verdict = f"Passed the selected drills ({names or 'none'}): this is not a full qualification."
    return {
        "simulated": True,
        "passed": not failed and bool(results),
        "whole": whole,
        "verdict": verdict,
        "begun": begun.isoformat(timespec="seconds"),
        "seconds": sum(result.seconds for result in results),
        "program": program(),
        "machine": machine(),
        "disk": disk(folder),
        "versions": versions(),
        "drills": [_drill(result) for result in results],
    }


def _drill(result: DrillResult) -> dict[str, Any]:
    boards = [
        {"port": _port_kind(b.port), "speed": b.speed, "unit": b.unit, "seed": b.seed, "faults": list(b.faults)}
        for b in result.boards
    ]
    return {**asdict(result), "passed": result.passed, "boards": boards}


def _port_kind(port: str) -> str:
    return "pseudo-terminal" if port == "pty" else f"TCP on {port.partition(':')[0]}"
