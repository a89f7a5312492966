"""`boat-daq qualify`: a sound program passes; one that loses or invents is found out, and the exit code says so."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from boat_daq import __version__
from boat_daq.cli import app
from boat_daq.commands.qualify import result
from boat_daq.engine.qualification import drills, installation
from boat_daq.engine.qualification.drills import available, run_drill
from boat_daq.engine.qualification.test_rig import Criterion, DrillResult, DrillRig
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.simulator.server import BoardSettings
from protocol import Samples
from protocol.link import framing


def broken(outcome: DrillResult) -> set[str]:
    """The criteria that are not kept."""
    return {criterion.text for criterion in outcome.criteria if not criterion.kept}


def test_losses_are_held_against_the_boards_truth(tmp_path: Path) -> None:
    """A sound program passes, and the count is the one that was injected: 1 + 7 + 255 + 10 and the bytes' frames."""
    outcome = run_drill(drills.loss, tmp_path / "loss")
    assert outcome.passed, outcome
    assert outcome.counts["missing_by_truth"] == outcome.counts["lost_said"] >= 273


def test_a_recorder_that_loses_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block of samples in ten is thrown away without a word: the board's truth does not agree."""
    take, seen = Recorder.__call__, [0]

    def careless(recorder: Recorder, block: Any) -> None:
        seen[0] += any(isinstance(event, Samples) for event in block.events)
        if seen[0] % 10 != 5:
            take(recorder, block)

    monkeypatch.setattr(Recorder, "__call__", careless)
    outcome = run_drill(drills.ambient_flash, tmp_path / "flash")
    assert not outcome.passed
    assert "no sample is lost" in broken(outcome), outcome


@pytest.mark.nightly
def test_a_decoder_that_believes_everything_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the CRC, flipped bits become samples that the board never took."""
    monkeypatch.setattr(framing, "RESIDUE", _EqualToAll())
    outcome = run_drill(drills.flips, tmp_path / "flips")
    assert not outcome.passed


class _EqualToAll:
    """Every checksum is right."""

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return True

    def __ne__(self, other: object) -> bool:
        return False


def passing(_bench: DrillRig) -> DrillResult:
    """Kept."""
    return DrillResult("passing", "nothing", (Criterion("is kept", "yes", True),), "nothing")


def failing(_bench: DrillRig) -> DrillResult:
    """Not kept."""
    return DrillResult("failing", "a doctored criterion", (Criterion("is <b>never</b> kept", "no", False),), "all")


def breaking(_bench: DrillRig) -> DrillResult:
    """Raises."""
    raise RuntimeError("the drill itself broke")


def empty(_bench: DrillRig) -> DrillResult:
    """States no criterion."""
    return DrillResult("empty", "nothing", (), "nothing")


def test_a_drill_that_fails_makes_exit_1_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The report names it, and its folder is kept for whoever looks for the cause."""
    monkeypatch.setattr(drills, "DRILLS", (passing, failing))
    run = CliRunner().invoke(app, ["qualify", "--out", str(tmp_path), "--json"])
    assert run.exit_code == 1
    told = json.loads(run.stdout)
    assert told["passed"] is False
    assert told["verdict"].startswith("FAILED: failing")
    html, _, written = (Path(path) for path in told["files"])
    assert "failing: FAILED" in html.read_text(encoding="utf-8")
    assert "<b>never</b>" not in html.read_text(encoding="utf-8")
    assert json.loads(written.read_text(encoding="utf-8"))["passed"] is False
    assert [path.name for path in html.parent.iterdir() if path.is_dir()] == ["failing"]


@pytest.mark.parametrize("drill", [breaking, empty])
def test_a_drill_that_breaks_or_asks_nothing_has_failed(drill: drills.Drill, tmp_path: Path) -> None:
    """Nothing passes by not having been judged."""
    outcome = run_drill(drill, tmp_path / "drill")
    assert not outcome.passed
    assert not result([outcome], datetime.now(UTC), whole=True)["passed"]


def test_a_report_is_simulated_dated_and_to_be_signed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit 0 where all is kept; a part of the drills is no whole qualification; an unknown drill is a wrong call."""
    monkeypatch.setattr(drills, "DRILLS", (passing, failing))
    run = CliRunner().invoke(app, ["qualify", "--out", str(tmp_path), "--drill", "passing", "--json"])
    assert run.exit_code == 0
    told = json.loads(run.stdout)
    assert (told["passed"], told["whole"], told["simulated"]) == (True, False, True)
    html, pdf, _ = (Path(path) for path in told["files"])
    text = html.read_text(encoding="utf-8")
    for word in ("SIMULATED", "Signature", told["begun"][:10], told["versions"]["Python"], "no whole qualification"):
        assert word in text
    assert pdf.read_bytes().startswith(b"%PDF")
    assert CliRunner().invoke(app, ["qualify", "--drill", "nonsense"]).exit_code == 2


def test_a_report_names_what_was_qualified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An operator signs for a program, a computer, a disk and a port: each stands in it, above the drills."""
    board = BoardSettings(speed=8.0, seed=0, faults=("index_gap@4:7",))

    def served(bench: DrillRig) -> DrillResult:
        bench.served.append(board)
        return DrillResult("served", "7 frames", (Criterion("is kept", "yes", True),), "7 samples")

    monkeypatch.setattr(drills, "DRILLS", (served,))
    run = CliRunner().invoke(app, ["qualify", "--out", str(tmp_path), "--json"])
    told = json.loads(run.stdout)
    assert (len(told["program"]["sha256"]), told["program"]["version"]) == (64, __version__)
    assert told["disk"]["folder"].startswith(str(tmp_path))
    assert told["disk"]["file_system"] and told["machine"]["system"]
    (used,) = told["drills"][0]["boards"]
    faults = ["index_gap@4:7"]
    assert used == {"port": "pseudo-terminal", "speed": 8.0, "unit": "SA1", "seed": 0, "faults": faults}
    text = Path(told["files"][0]).read_text(encoding="utf-8")
    for word in (told["program"]["sha256"], told["disk"]["folder"], told["machine"]["system"], used["port"], "seed 0"):
        assert word in text
    assert text.index(told["verdict"]) < text.index("Signature") < text.index(">Drills<")


def test_the_programs_hash_is_of_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any byte of any file of the program changes it; the same files give the same."""
    for package in ("boat_daq", "protocol", "analysis"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "a.py").write_text("x = 1\n")
    monkeypatch.setattr(installation, "_ROOT", tmp_path)
    before = installation.program()
    assert before["files"] == 3
    assert installation.program()["sha256"] == before["sha256"]
    (tmp_path / "protocol" / "a.py").write_text("x = 2\n")
    assert installation.program()["sha256"] != before["sha256"]


@pytest.mark.nightly
@pytest.mark.parametrize("drill", available(), ids=lambda drill: drill.__name__)
def test_every_drill_passes_here(drill: drills.Drill, tmp_path: Path) -> None:
    """All that `qualify` runs, on this machine."""
    outcome = run_drill(drill, tmp_path / drill.__name__)
    assert outcome.passed, broken(outcome)
