"""Batches, examples and the overview: the same everywhere, and never stopped by one bad run."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from analysis import BoatDaqError
from analysis.examples import batch_a_folder, calibrate_a_run, compare_units
from analysis.history.batch import batch, write_table
from tests.analysis.boat_builder import Plant, Staircase, write_boat


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two calibrations of one unit with readings beside them, and a file that is no run."""
    folder = tmp_path_factory.mktemp("runs")
    for seed in (1, 2):
        stairs = Staircase(Plant(loop_mm=0.25, seed=seed), cycles=2)
        write_boat(folder / f"run{seed}.boat", stairs.recording(), meta={"uuid": str(seed), "unit": "=SA1"})
        stairs.elongations().to_csv(folder / f"run{seed}.elongation.csv", index=False)
    (folder / "bad.csv").write_text("no numbers here\n")
    return folder


def test_a_bad_run_is_a_row_with_its_reason(folder: Path, tmp_path: Path) -> None:
    """Three runs, two sensors each and one reason; text cells are neutralised in the file."""
    table = batch(folder, workers=1)
    assert table["run"].tolist() == ["bad.csv", "run1.boat", "run1.boat", "run2.boat", "run2.boat"]
    assert "no rows of numbers" in table["error"].iloc[0]
    assert table["b0"].iloc[1] == pytest.approx(1651.98, abs=1.0)
    write_table(table, tmp_path / "t.csv")
    assert pd.read_csv(tmp_path / "t.csv")["unit"].iloc[1] == "'=SA1"


@pytest.mark.nightly
def test_processes_and_a_cluster_give_the_same_table(folder: Path) -> None:
    """Two processes, and a Dask cluster on this machine, give the table of one process."""
    from distributed import LocalCluster

    alone = batch(folder, workers=1)
    pd.testing.assert_frame_equal(alone, batch(folder, workers=2))
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        pd.testing.assert_frame_equal(alone, batch(folder, scheduler=cluster.scheduler_address))


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    """No runs, and no folder."""
    with pytest.raises(BoatDaqError, match="holds no runs"):
        batch(tmp_path)
    with pytest.raises(BoatDaqError, match="not a folder"):
        batch(tmp_path / "nowhere")


def test_the_examples_run(folder: Path, tmp_path: Path) -> None:
    """Calibrate a run (its largest elongation is the plant's), compare two, batch a folder."""
    largest = calibrate_a_run.main(str(folder / "run1.boat"), str(folder / "run1.elongation.csv"))
    assert largest == pytest.approx(3.8, abs=0.1)
    runs = [str(folder / f"run{k}.boat") for k in (1, 2)]
    assert compare_units.main(str(tmp_path / "c.html"), runs) == 2
    assert (tmp_path / "c.html").stat().st_size > 10_000
    assert batch_a_folder.main(str(folder), str(tmp_path / "t.csv"), workers=1) == 5
