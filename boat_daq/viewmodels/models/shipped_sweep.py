"""The sweep of all designs that ships with the program: the page of the optics answers before anything is traced.

It is that of the paper's 250 rays with the default deformation curves, as `optics.sweep(CAVITIES, 250)` returns it. A
nightly test compares both.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from boat_daq.engine.toml_values import read_json
from boat_daq.viewmodels.models.optics import SweepSummary
from protocol.base.whole_file import write_whole

SHIPPED = Path(__file__).with_name("swept_designs.json")
_COLUMNS = ("cavities", "width_mm", "depth_mm", "spacing_mm", "delta", "n_sign", "rmse", "p", "tied", "rank")
_TEXTS = ("rays", "simulated", "rank_text", "winners", "fans", "error_text")


def shipped_sweep() -> SweepSummary:
    """Return the sweep that ships with the program."""
    from analysis.optics.sweep.figure_of_merit import Merit

    stored: dict[str, Any] = read_json(SHIPPED)
    rows = np.array(stored["designs"])
    delta, n_sign, rmse, p, tied, ranks = rows[:, 4:].T
    unknown = np.full(len(rows), np.nan)
    merit = Merit(unknown, delta, n_sign, rmse, unknown, p, n_sign == 0, np.zeros(len(rows), dtype=bool))
    texts = {name: stored[name] for name in _TEXTS}
    best, ends = int(np.argmax(p)), stored["paper"]
    found = rows[:, :4], merit, tied.astype(bool), best, ends, ranks.astype(int)
    return SweepSummary(*found, seconds=0.0, **texts)


def store_sweep(sweep: SweepSummary, path: Path) -> None:
    """Write a sweep as it ships."""
    m = sweep.merit
    columns = (*sweep.values.T, m.delta, m.n_sign, m.rmse, m.p, sweep.tied, sweep.ranks)
    rows = [[float(f"{value:.7g}") for value in row] for row in zip(*columns, strict=True)]
    lines = ",\n".join(json.dumps(row) for row in rows)
    head = json.dumps({"columns": _COLUMNS, "paper": sweep.paper} | {name: getattr(sweep, name) for name in _TEXTS})
    write_whole(path, f'{head[:-1]}, "designs": [\n{lines}\n]}}\n')
