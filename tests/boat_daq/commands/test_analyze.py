"""The commands of the analysis as a user types them: keys of the surface, exit codes, no traceback."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from analysis.errors import AnalysisError
from boat_daq.commands.analyze import analyze
from boat_daq.commands.batch import batch
from boat_daq.commands.export import export
from boat_daq.commands.fit import fit
from boat_daq.commands.history import history
from boat_daq.commands.importing import import_csv
from boat_daq.commands.report import report
from tests.analysis.boat_builder import PAPER, Plant, Staircase, write_boat
from tests.analysis.calibration.test_fit import DIGITS, certified, digits

app = typer.Typer()
for name, command in {
    "analyze": analyze, "batch": batch, "export": export, "fit": fit, "history": history, "import": import_csv,
    "report": report,
}.items():  # fmt: skip
    app.command(name)(command)
FIT_KEYS = {
    "degree", "n", "coefficients", "std_errors", "covariance", "r2", "rmse", "range", "turning_points", "monotone",
}  # fmt: skip


def run(*arguments: object) -> dict:  # type: ignore[type-arg]
    """Run a command with --json and return its object; its failure is raised."""
    result = CliRunner().invoke(app, [str(a) for a in (*arguments, "--json")], catch_exceptions=True)
    if result.exception is not None:
        raise result.exception
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def stairs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording of one sensor over two cycles and its elongation file."""
    folder = tmp_path_factory.mktemp("stairs")
    plan = Staircase(Plant(cubics=PAPER[:1], noise_mv=(1.49,), loop_mm=0.25), cycles=2)
    plan.elongations().to_csv(folder / "e.csv", index=False)
    return write_boat(folder / "run.boat", plan.recording()), folder / "e.csv"


@pytest.mark.parametrize("name", DIGITS)
def test_fit_meets_certified_digits_and_gives_bands(shared_data: Path, tmp_path: Path, name: str) -> None:
    """NIST's sets through the command: the digits of the fit itself, the keys of the surface, bands where asked for."""
    x, y, coefficients, deviations = certified(shared_data / "nist_strd" / f"{name}.dat")
    pd.DataFrame({"load": x, "deflection": y}).to_csv(tmp_path / "p.csv", index=False)
    degree = str(coefficients.size - 1)
    found = run("fit", tmp_path / "p.csv", "--x", "load", "--y", "deflection", "--degree", degree, "--bands")
    assert set(found) >= FIT_KEYS
    assert digits(np.asarray(found["coefficients"]), coefficients) >= DIGITS[name]
    assert digits(np.asarray(found["std_errors"]), deviations) >= 5.0
    assert len(found["bands"]["curve_95"][0]) == len(found["bands"]["x"])


@pytest.mark.parametrize("names", [("low", "mid", "up", "high"), ("1", "2", "3", "4")])
def test_positions_are_named_by_words_or_numbers(tmp_path: Path, names: tuple[str, ...]) -> None:
    """Four positions read twice: no row is lost for its name, and what a position shares is not counted twice."""
    rows = [f"{x},{10 * x + 0.1 * (-1) ** (x + again)},{names[x]}" for again in (0, 1) for x in range(4)]
    path = tmp_path / "positions.csv"
    path.write_text("\n".join(["x,y,p", *rows]))
    own = [f"{row},{number}" for number, row in enumerate(rows)]
    (tmp_path / "own.csv").write_text("\n".join(["x,y,p,q", *own]))
    options = ("--x", "x", "--y", "y", "--degree", 1, "--x-resolution", 1.0)
    shared = run("fit", path, *options, "--position", "p")
    each = run("fit", tmp_path / "own.csv", *options, "--position", "q")
    assert (shared["n"], shared["masked"]) == (8, 0)
    assert shared["std_errors_with_reading"][1] > 1.2 * each["std_errors_with_reading"][1]


def test_fit_masks_what_is_missing_and_refuses_what_cannot_be(tmp_path: Path) -> None:
    """A row without a number is left out and counted; too few distinct x are an error of the family."""
    (tmp_path / "a.csv").write_text("x,y\n0,0\n1,1\n2,4\n3,\n4,16\n5,25\n")
    assert run("fit", tmp_path / "a.csv", "--x", "x", "--y", "2", "--degree", "2")["masked"] == 1
    with pytest.raises(AnalysisError, match="no column"):
        run("fit", tmp_path / "a.csv", "--x", "z", "--y", "y")
    (tmp_path / "b.csv").write_text("x,y\n0,0\n1,1\n0,4\n1,5\n")
    with pytest.raises(AnalysisError, match="2 distinct x"):
        run("fit", tmp_path / "b.csv", "--x", "x", "--y", "y")
    with pytest.raises(SystemExit) as usage:
        run("fit", tmp_path / "a.csv", "--x", "x", "--y", "y", "--degree", "11")
    assert usage.value.code == 2


def test_analyze_export_import_and_report(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """One run through all of them; the export, imported again, gives the same figures."""
    boat, readings = stairs
    first = run("analyze", "--no-shadow", boat, "--elongation", readings, "--no-mcmc", "--no-store")
    assert first["cycles"]["complete"] == 2
    assert first["simulated"] is True
    assert run("export", boat, "--format", "csv", "--out", tmp_path / "r.csv")["samples"] == first["samples"]
    imported = run("import", tmp_path / "r.csv", "--out", tmp_path / "again.boat")
    assert imported["samples"] == first["samples"]
    again = run("analyze", "--no-shadow", tmp_path / "again.boat", "--elongation", readings, "--no-mcmc")
    assert again["simulated"] is True
    for a, b in zip(first["sensors"], again["sensors"], strict=True):
        np.testing.assert_allclose(a["calibration"]["coefficients"], b["calibration"]["coefficients"], rtol=1e-9)
    wrote = run(
        "report",
        "--no-shadow",
        boat,
        "--elongation",
        readings,
        "--no-mcmc",
        "--out",
        tmp_path / "r.html",
        "--limit",
        "snr=40",
    )
    assert "PASSES" in wrote["verdict"]
    assert run("import", tmp_path / "r.csv", "--preview")["missing"] == []


def test_batch_makes_one_table(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A folder with one run of one sensor: its row, and one for the file that is no run."""
    found = run("batch", stairs[0].parent, "--workers", "1", "--out", tmp_path / "t.csv")
    assert found["runs"] == 2  # the elongation file is no run: it is a row with its reason
    assert found["failed"] == 1
    assert len(pd.read_csv(tmp_path / "t.csv")) == 2


@pytest.mark.parametrize(
    "arguments", [("report", "a.boat", "--out", "r.docx"), ("export", "a", "--format", "xml", "--out", "b")]
)
def test_a_wrong_option_is_a_usage_error(arguments: tuple[str, ...]) -> None:
    """Exit code 2 before any file is read."""
    with pytest.raises(SystemExit) as usage:
        run(*arguments)
    assert usage.value.code == 2


def test_history_charts_a_unit_and_names_what_it_left_out(tmp_path: Path) -> None:
    """Two calibrations in order of time; En is their difference over its U; drift is the step; a bad file is named."""
    for day, offset in ((2, 1.0), (1, 0.0)):
        cubics = tuple((c[0] + offset, *c[1:]) for c in PAPER)
        plan = Staircase(Plant(cubics=cubics, loop_mm=0.25, seed=day), cycles=2)
        plan.elongations().to_csv(tmp_path / f"run{day}.elongation.csv", index=False)
        meta = {"uuid": str(day), "started_utc": f"2026-01-0{day}T00:00:00+00:00"}
        write_boat(tmp_path / f"run{day}.boat", plan.recording(), meta=meta)
    (tmp_path / "bad.csv").write_text("no numbers\n")
    found = run("history", tmp_path, "--unit", "SA1")
    first, second = found["sensors"][0]["calibrations"]
    assert (first["started_utc"][:10], second["started_utc"][:10]) == ("2026-01-01", "2026-01-02")
    step = second["value_mv"] - first["value_mv"]
    assert step == pytest.approx(1.0, abs=0.6)
    assert second["en"] == pytest.approx(step / np.hypot(first["expanded_mv"], second["expanded_mv"]))
    drift = second["coefficients"][0] - first["coefficients"][0]
    assert found["sensors"][0]["drift_per_calibration"][0] == pytest.approx(drift)
    assert first["en"] is None
    assert found["left_out"][0]["run"] == "bad.csv"
    with pytest.raises(AnalysisError, match="no calibration of unit 'SB9'"):
        run("history", tmp_path, "--unit", "SB9")
