"""A folder of runs into one table, over all cores or on a Dask cluster.

One run is one task, `summarise_run`, which returns plain rows in the order of the names. A run that cannot be analysed
is a row with its reason. Readings are in the recording, or beside it in NAME.elongation.csv.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.cluster import check_scheduler, connect
from analysis.numbers import neutral
from analysis.progress import Progress
from protocol.base.errors import BoatDaqError, FileError, RequestError, writing

_SUFFIXES = (".boat", ".csv")
_ELONGATION = ".elongation.csv"
LEADING = ("run", "unit", "started_utc", "simulated", "kind", "cycles", "partial", "lost_samples", "sensor", "error")


def summarise_run(path: Path, *, seed: int = 0, mcmc: bool = False) -> list[dict[str, Any]]:
    """Return one row for each sensor of a run, or one row with the reason why there is none."""
    from analysis.figures.pipeline import analyse  # imported in the worker, not by the caller of a batch
    from analysis.figures.sensor_analysis import Options

    try:
        analysis = analyse(path, readings_beside(path), options=Options(seed=seed, mcmc=mcmc))
    except BoatDaqError as error:
        return [{"run": path.name, "error": f"{error.cause}: {error.remedy}"}]
    cycles = analysis.cycles.as_json()
    head = {
        "run": path.name,
        "unit": analysis.recording.unit,
        "started_utc": analysis.recording.started_utc,
        "simulated": analysis.recording.simulated,
        "kind": analysis.kind,
        "cycles": cycles["complete"],
        "partial": cycles["partial"],
        "lost_samples": analysis.recording.lost,
    }
    rows = []
    for sensor in analysis.sensors:
        row = {**head, "sensor": sensor.name, "error": ""}
        if sensor.calibration is not None:
            row |= {f"b{i}": float(b) for i, b in enumerate(sensor.calibration.coefficients)}
            row["r2"] = sensor.calibration.r2
        row |= {name: figure.value for name, figure in sensor.figures.items()}
        rows.append(row)
    return rows


def batch(
    runs: str | Path | Sequence[str | Path],
    *,
    seed: int = 0,
    mcmc: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    allow_remote: bool = False,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Analyse many runs; raises FileError or RequestError for a missing folder, no run in it, or missing Dask.

    `workers`: number of processes; by default one for each core. `scheduler`: address of a Dask scheduler, whose
    workers can read the runs. `allow_remote`: allow a scheduler on another computer, see `analysis.cluster`.
    """
    if scheduler is not None:
        check_scheduler(scheduler, allow_remote=allow_remote)
    files = runs_in(runs)
    task = partial(summarise_run, seed=seed, mcmc=mcmc)
    rows: list[dict[str, Any]] = []
    for done, found in enumerate(_mapped(task, files, workers or os.cpu_count() or 1, scheduler), 1):
        rows += found
        if progress is not None:
            progress(done, len(files))
    table = pd.DataFrame(rows)
    table.attrs["omitted"] = (
        [path.name for path in [path for path in _candidates(Path(runs)) if not _is_run(path)]]
        if isinstance(runs, str | Path)
        else []
    )
    leading = [name for name in LEADING if name in table]
    return table[leading + [name for name in table if name not in leading]]


def _candidates(folder: Path) -> list[Path]:
    return [f for f in sorted(folder.iterdir()) if f.suffix in _SUFFIXES and not f.name.endswith(_ELONGATION)]


def _is_run(path: Path) -> bool:
    from analysis.data.column_map import map_columns
    from analysis.data.column_names import is_signal
    from analysis.data.csv_table import read_table

    if path.suffix == ".boat":
        return True
    try:
        names = map_columns(read_table(path), tolerant=True).columns
    except BoatDaqError:
        return True  # its row has the reason
    return "pressure_kpa" in names and ("time_s" in names or any(map(is_signal, names)))


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """Write a batch's table as CSV, its text cells neutralised; raises StorageError if it cannot be written."""
    safe = table.copy()
    for name in safe:
        if not (pd.api.types.is_numeric_dtype(safe[name]) or pd.api.types.is_bool_dtype(safe[name])):
            safe[name] = [neutral(str(v)) if isinstance(v, str) else v for v in safe[name]]
    with writing(Path(path)):
        safe.to_csv(path, index=False, errors="replace")  # a name may be no UTF-8


def readings_beside(run: Path) -> Path | None:
    """Return the elongations beside a run in NAME.elongation.csv, None where there are none."""
    readings = run.with_name(run.stem + _ELONGATION)
    return readings if readings.is_file() else None


def runs_in(runs: str | Path | Sequence[str | Path]) -> list[Path]:
    """Return the runs of a folder in the order of their names, or the files given; RequestError if there is none."""
    if not isinstance(runs, str | Path):
        return [Path(run) for run in runs]
    folder = Path(runs)
    if not folder.is_dir():
        raise FileError(f"{folder} is not a folder", "Give the folder that holds the runs.")
    found = [path for path in _candidates(folder) if _is_run(path)]
    if not found:
        raise RequestError(f"{folder} holds no runs ({' or '.join(_SUFFIXES)})", "Choose another folder.")
    return found


def _mapped(
    task: Callable[[Path], list[dict[str, Any]]], files: list[Path], workers: int, scheduler: str | None
) -> Iterator[list[dict[str, Any]]]:
    if scheduler is not None:
        yield from _on_cluster(task, files, scheduler)
    elif workers == 1 or len(files) == 1:
        yield from map(task, files)
    else:
        # spawned, not forked: threads of numba and BLAS do not survive a fork
        with ProcessPoolExecutor(min(workers, len(files)), mp_context=get_context("spawn")) as pool:
            yield from pool.map(task, files)


def _on_cluster(
    task: Callable[[Path], list[dict[str, Any]]], files: list[Path], scheduler: str
) -> Iterator[list[dict[str, Any]]]:
    with connect(scheduler) as client:
        for future in client.map(task, files):
            yield future.result()
