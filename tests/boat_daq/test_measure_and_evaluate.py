"""`from boat_daq import ...`: the names of scripts and notebooks, and what results look like in a cell."""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import pytest

import boat_daq
from boat_daq import Analysis, Plan, Recording, Scene, Session, elongation_reader, enter_simulated_readings, trace
from protocol.base.errors import ChoiceError, DataError, RequestError
from tests.conftest import ROOT

RUN = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"


@pytest.fixture(scope="module")
def run() -> Recording:
    """The example recording."""
    return boat_daq.load_recording(RUN)


@pytest.fixture(scope="module")
def analysis(run: Recording) -> Analysis:
    """Its figures, with a posterior."""
    return boat_daq.analyse(run)


def test_completion_shows_the_public_names_alone() -> None:
    """Each can be imported; a name that is none is an AttributeError."""
    assert dir(boat_daq) == sorted(boat_daq.__all__)
    assert {"load_recording", "analyse", "Session", "fit_calibration", "Scene", "trace", "Shadow"} <= {*dir(boat_daq)}
    assert all(getattr(boat_daq, name).__doc__ for name in dir(boat_daq))
    stub = (ROOT / "boat_daq" / "__init__.pyi").read_text(encoding="utf-8")
    assert [f"from {module} import {name} as {name}" for name, module in sorted(boat_daq._MODULES.items())] == sorted(
        (line for line in stub.splitlines() if line.startswith("from ")), key=lambda line: line.split()[-1]
    )
    with pytest.raises(AttributeError):
        boat_daq.no_such_name  # noqa: B018


EXAMPLES = ROOT / "docs" / "reference" / "examples"


def test_each_name_has_an_example() -> None:
    """Shown on its page of the reference; it imports the name from `boat_daq`."""
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*boat_daq.__all__}
    for name in boat_daq.__all__:
        text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
        assert "from boat_daq import " in text


@pytest.mark.nightly  # a minute in all
@pytest.mark.parametrize("name", boat_daq.__all__)
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    """As it stands, beside a lab's own `analysis`."""
    shutil.copytree(ROOT / "recordings", tmp_path / "recordings")
    (tmp_path / "analysis").mkdir()
    (tmp_path / "analysis" / "__init__.py").write_text("raise SystemExit('imported')", encoding="utf-8")
    shutil.copy(EXAMPLES / f"{name}.py", tmp_path / "script.py")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "BOAT_DAQ_HOME": str(tmp_path / "home")}
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=200)
    assert (done.returncode, bool(done.stdout) or name == "write_report") == (0, True), done.stderr


def test_results_are_a_dozen_lines(run: Recording, analysis: Analysis) -> None:
    """What a cell prints: marked SIMULATED, with intervals, never an array."""
    sensor = analysis.sensors[0]
    reader = elongation_reader(analysis)
    figure = sensor.figures["snr_db"]
    for shown in (run, analysis, sensor, sensor.calibration, sensor.posterior, figure, reader, reader.inverses[0]):
        text = repr(shown)
        assert text.count("\n") < 16
        assert len(text) < 1500
        assert "array(" not in text
    for shown in (run, analysis, sensor, sensor.calibration):
        assert "SIMULATED" in repr(shown)
    for shown, rows, value in ((analysis, 12, "39.42"), (sensor, 12, "39.42"), (sensor.calibration, 4, "b3</th>")):
        table = shown._repr_html_()
        assert (table.count("<tr>") > rows, "SIMULATED" in table, value in table) == (True, True, True)
    assert "SIMULATED" not in repr(boat_daq.fit_calibration([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.1, 3.0], 1))


def test_a_figure_is_a_number_with_uncertainty(analysis: Analysis) -> None:
    """`float`, a format, and a standard uncertainty from the 95 % interval; a wrong key names the right ones."""
    figure = analysis.sensors[0].figures["sensitivity_mv_per_mm"]
    assert float(figure) == figure.value
    assert (f"{figure:.2f}", f"{figure}") == (f"{figure.value:.2f}", repr(figure))
    with pytest.raises(KeyError, match="sensitivity_mv_per_mm"):
        analysis.sensors[0].figures["sensitivity"]
    assert figure.uncertainty == pytest.approx((figure.high - figure.low) / 4)


def test_frames_carry_their_units(run: Recording, analysis: Analysis) -> None:
    """Samples with elongation and U, figures with intervals; both marked as simulated."""
    assert "elongation_reader" in analysis.recording.to_frame(slice(5)).attrs["elongation_void"]
    frame = run.to_frame()
    given = run.to_frame(slice(9000), reader=elongation_reader(analysis))
    np.testing.assert_allclose(given["elongation_mm"], frame["elongation_mm"][:9000], atol=1e-9)
    assert frame.attrs["simulated"] is True
    assert (frame.attrs["unit"], frame.attrs["units"]["s1_mv"], frame.attrs["units"]["u_mm"]) == ("SA1", "mV", "mm")
    held = frame[np.isclose(frame["target_kpa"], 20.0)]
    assert 1.0 < held["elongation_mm"].mean() < 3.0
    assert 0.0 < held["u_mm"].mean() < 0.5
    figures = analysis.to_frame()
    assert figures.attrs == {"simulated": True, "unit": "SA1"}
    assert set(figures["sensor"]) == {"s1", "s2", ""}
    row = figures[(figures["sensor"] == "s1") & (figures["figure"] == "snr_db")].iloc[0]
    assert row["low"] < row["value"] < row["high"]


def test_samples_as_a_dataset(run: Recording) -> None:
    """Coordinate and units as xarray has them."""
    pytest.importorskip("xarray")
    data = run.to_xarray()
    assert data["s1_mv"].attrs["units"] == "mV"
    assert data.sizes["time_s"] == run.n
    assert data.attrs["simulated"] == 1


def test_readings_may_be_arrays_or_a_frame(run: Recording, analysis: Analysis) -> None:
    """The same calibration as from the recording's own readings; another number of values is refused."""
    own = analysis.elongations.elongation_mm
    expected = analysis.sensors[0].calibration.coefficients
    kpa = [plateau.pressure_kpa for plateau in analysis.plateaus]
    for readings in (own, list(own), pd.DataFrame({"pressure_kpa": kpa, "elongation_mm": own})):
        found = boat_daq.analyse(run, readings, mcmc=False).sensors[0].calibration
        np.testing.assert_allclose(found.coefficients, expected, rtol=1e-6)
    with pytest.raises(DataError, match="3 elongations for"):
        boat_daq.analyse(run, [1.0, 2.0, 3.0], mcmc=False)
    with pytest.raises(DataError, match="lack elongation_mm"):
        boat_daq.analyse(run, pd.DataFrame({"pressure_kpa": kpa}), mcmc=False)
    with pytest.raises(RequestError, match="not a DataFrame"):
        boat_daq.analyse(run.to_frame(slice(5)))


def test_draws_as_chains(analysis: Analysis) -> None:
    """[chain, draw] for ArviZ: the mean over all is that of the posterior."""
    posterior = analysis.sensors[0].posterior
    chains = posterior.chains()
    assert set(chains) == {"b0", "b1", "b2", "b3", "sigma"}
    assert {values.shape for values in chains.values()} == {(posterior.walkers, chains["sigma"].shape[1])}
    assert posterior.walkers > 10
    assert chains["b1"].mean() == pytest.approx(posterior.mean[1], abs=3 * posterior.sd[1] / 20)
    between = chains["b1"].mean(axis=1).std()
    assert between < chains["b1"].std(axis=1).mean()


def test_a_calibration_is_drawn(analysis: Analysis) -> None:
    """Into an axes of one's own, or a new one."""
    matplotlib.use("agg")
    ax = analysis.sensors[0].calibration.plot()
    assert len(ax.lines) == 2
    assert analysis.sensors[1].calibration.plot(ax) is ax
    assert len(ax.lines) == 4


def test_a_scene_is_traced(tmp_path: Path) -> None:
    """The counts of `boat-daq optics trace`; a state that does not exist is refused."""
    from tests.boat_daq.commands.calls import call

    expected = call("optics", "trace", "--cavities", "3", "--state", "2")
    assert trace(Scene(cavities=3, state=2)).ndr == expected["ndr"]
    with pytest.raises(ChoiceError, match="no state 15"):
        trace(Scene(state=15))


def test_a_virtual_board_in_this_process(tmp_path: Path) -> None:
    """From nothing to readings in a recording, without another program."""
    plan = Plan("short", "staircase", cycles=1, high_kpa=20.0, low_kpa=0.0, step_kpa=20.0, ramp_kpa_per_s=40.0)
    with Session.simulated("SA2", speed=50.0, record_to=tmp_path / "run.boat") as session:
        assert session.run(plan).text == "finished"
        assert enter_simulated_readings(session) > 1
    found = boat_daq.load_recording(tmp_path / "run.boat")
    assert (found.simulated, found.unit) == (True, "SA2")
    assert len(found.readings) > 1


def test_blocks_are_a_line(tmp_path: Path) -> None:
    """Of a live session."""
    with Session.simulated(speed=20.0) as session:
        block = next(iter(session.samples(seconds=1.0)))
    assert repr(block).startswith("<MeasuredBlock: ")
    assert inspect.isclass(boat_daq.MeasuredBlock) and "\n" not in repr(block)
    assert sys.getsizeof(repr(block)) < 300
