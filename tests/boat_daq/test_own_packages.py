"""The program and a lab's own `protocol` and `analysis`: real programs, started in real folders."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import mostly_at_night

ROOT = Path(__file__).resolve().parents[2]
RECORDING = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"
NAMES = ("protocol", "analysis")
ALARM = "raise SystemExit('a file of the lab was imported: ' + __file__)\n"
SCRIPT = shutil.which("boat-daq", path=str(Path(sys.executable).parent))
PROGRAMS = {
    "python -m boat_daq": [sys.executable, "-m", "boat_daq"],
    "boat-daq": [SCRIPT or "boat-daq"],
}
HELPERS = """
import sys
import time
from pathlib import Path
from boat_daq.own_packages import prefer_own_packages
prefer_own_packages()
from boat_daq.engine.simulator.server import BoardSettings, serve
from analysis.data.load import load_recording
from boat_daq.workflows.jobs import Job, JobState
with serve(BoardSettings()) as board:
    print("board at", board.url)
work = Job("outline", load_recording, sys.argv[1])
while work.poll() is JobState.RUNNING:
    time.sleep(0.05)
print(work.failure, work.result.n)
"""


def as_files(folder: Path, text: str) -> None:
    """`protocol.py` and `analysis.py`."""
    for name in NAMES:
        (folder / f"{name}.py").write_text(text)


def as_packages(folder: Path, text: str) -> None:
    """`protocol/` and `analysis/` with modules in them."""
    for name in NAMES:
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(text)


def as_folders(folder: Path, _: str) -> None:
    """Bare folders, of tables perhaps."""
    for name in NAMES:
        (folder / name).mkdir()
        (folder / name / "run_1.csv").touch()


KINDS = {"files": as_files, "packages": as_packages, "folders": as_folders}


def run(command: list[str], folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, with this checkout on the path as an installation has it: behind the libraries."""
    env = {**os.environ, **environment}
    env.pop("PYTHONSAFEPATH", None)  # set in this process where an earlier test ran the program in it
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, env=env, timeout=100)


def script(folder: Path, text: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a script that lies in a folder."""
    (folder / "script.py").write_text(text)
    return run([sys.executable, "script.py"], folder, **environment)


def distribution(folder: Path) -> Path:
    """A place of installed packages with another distribution, which has its own `protocol`."""
    place = folder / "site-packages"
    (place / "protocol").mkdir(parents=True)
    (place / "protocol" / "__init__.py").write_text(ALARM)
    (place / "protocol" / "recording.py").write_text(ALARM)
    return place


# ---- the program -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("program", "kind", "on_path"),
    [
        ("boat-daq", "packages", "distribution"),
        ("python -m boat_daq", "folders", "tools"),
        pytest.param("boat-daq", "files", "tools", marks=pytest.mark.nightly),
        pytest.param("python -m boat_daq", "packages", "distribution", marks=pytest.mark.nightly),
    ],
)
def test_program_imports_own_packages(tmp_path: Path, program: str, kind: str, on_path: str) -> None:
    """Neither those of the working folder nor those on PYTHONPATH: a folder of the user's, another distribution's."""
    KINDS[kind](tmp_path, ALARM)
    (tmp_path / "tools").mkdir()
    as_files(tmp_path / "tools", ALARM)
    place = distribution(tmp_path) if on_path == "distribution" else tmp_path / "tools"
    done = run([*PROGRAMS[program], "info", str(RECORDING)], tmp_path, PYTHONPATH=str(place))
    assert done.returncode == 0, done.stderr
    assert "SIMULATED" in done.stdout


@pytest.mark.nightly
def test_program_imports_nothing_later_from_working_folder(tmp_path: Path) -> None:
    """Nor a name of the standard library that the program imports when its command runs."""
    as_files(tmp_path, ALARM)
    (tmp_path / "signal.py").write_text(ALARM)
    export = ["export", str(RECORDING), "--format", "csv", "--out", "run.csv"]
    done = run([*PROGRAMS["python -m boat_daq"], *export], tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run.csv").stat().st_size > 10_000


@pytest.mark.nightly
def test_program_runs_in_its_own_checkout() -> None:
    """The working folder that holds the program itself stays on the path."""
    done = run([sys.executable, "-m", "boat_daq", "info", str(RECORDING)], ROOT)
    assert done.returncode == 0, done.stderr


def test_helper_processes_import_own_packages(tmp_path: Path) -> None:
    """The virtual board's process and those that compute, started in that folder."""
    as_files(tmp_path, ALARM)
    (tmp_path / "signal.py").write_text(ALARM)
    done = run([sys.executable, "-c", HELPERS, str(RECORDING)], tmp_path)
    assert done.returncode == 0, done.stderr
    board, work = done.stdout.splitlines()
    assert board.startswith("board at tcp:" if sys.platform == "win32" else "board at /dev/")
    assert work.startswith("None ")


# ---- scripts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("statement", "name", "kind"),
    [
        ("from analysis import load_recording; load_recording", "protocol", "files"),
        ("from boat_daq.engine.session.session import Session", "protocol", "packages"),
        ("from boat_daq.viewmodels.app_model import PAGES", "analysis", "files"),
        ("from boat_daq.cli import main", "analysis", "packages"),
    ],
)
def test_script_is_refused_with_cause_and_remedy(tmp_path: Path, kind: str, statement: str, name: str) -> None:
    """The file found in place of the package, and what to do; the file itself is not run."""
    KINDS[kind](tmp_path, ALARM)
    shutil.rmtree(tmp_path / NAMES[name == "protocol"], ignore_errors=True)
    (tmp_path / f"{NAMES[name == 'protocol']}.py").unlink(missing_ok=True)
    done = script(tmp_path, statement)
    last = done.stderr.splitlines()[-1]
    found = tmp_path / (f"{name}.py" if kind == "files" else f"{name}/__init__.py")
    assert last.startswith(f"ImportError: {found} would be imported in place of boat-daq's package '{name}'. Rename it")


def test_script_runs_beside_bare_folders_and_before_another_distribution(tmp_path: Path) -> None:
    """A folder of tables called `analysis` hides no package, nor does what lies behind ours on the path."""
    as_folders(tmp_path, "")
    place = distribution(tmp_path)
    text = f"import sys; sys.path.append({str(place)!r}); from analysis import load_recording; import boat_daq.engine"
    done = script(tmp_path, f"{text}; print(load_recording({str(RECORDING)!r}).n)")
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 1000


def test_script_runs_with_own_analysis_that_it_means(tmp_path: Path) -> None:
    """What needs none of our `analysis` is not refused for the sake of the lab's."""
    (tmp_path / "analysis.py").write_text("own = 5\n")
    text = "from boat_daq.engine.recording.summary import summarise; from pathlib import Path; from analysis import own"
    text += f"; print(own, summarise(Path({str(RECORDING)!r})).status)"
    done = script(tmp_path, text)
    assert done.stdout == "5 closed\n", done.stderr


@pytest.mark.parametrize("needing", ["from analysis import load_recording", "import boat_daq.engine"])
def test_script_with_another_distribution_before_ours_is_refused(tmp_path: Path, needing: str) -> None:
    """The remedy is another environment: an installed package cannot be renamed."""
    done = script(tmp_path, needing, PYTHONPATH=str(distribution(tmp_path)))
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: {tmp_path}/site-packages/protocol/__init__.py would be imported in place of")
    assert "environment without" in last


LABS_OWN = """
import analysis
from boat_daq import fit_calibration
print(fit_calibration([0, 1, 2], [1, 3, 5], degree=1).coefficients.round(6).tolist())
from analysis import OFFSET
from analysis.rig import valve
import analysis.rig
print(analysis.OFFSET if order == "theirs first" else OFFSET, valve())
"""


@pytest.mark.parametrize("order", mostly_at_night("theirs first", "ours first"))
def test_public_names_work_beside_a_labs_own_analysis(order: str, tmp_path: Path) -> None:
    """Its names and modules are found as well, whichever is imported first."""
    (tmp_path / "analysis").mkdir()
    (tmp_path / "analysis" / "__init__.py").write_text("OFFSET = 7\n")
    (tmp_path / "analysis" / "rig.py").write_text("def valve():\n    return 'open'\n")
    lines = LABS_OWN.strip().splitlines()
    text = "\n".join([f"order = {order!r}", *(lines if order == "theirs first" else lines[1:])])
    found = script(tmp_path, text, PYTHONPATH=str(ROOT))
    assert found.stdout.splitlines() == ["[1.0, 2.0]", "7 open"], found.stderr
