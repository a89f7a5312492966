"""`boat-daq qualify`: a sound program passes; one that loses or invents samples fails, with exit code 1."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from boat_daq import __version__
from boat_daq.cli import app
from boat_daq.engine.qualification import drills, result
from boat_daq.engine.qualification.drill_rig import Criterion, DrillResult, DrillRig
from boat_daq.engine.qualification.drills import available, run_drill
from boat_daq.engine.qualification.result import qualification
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.simulator.server import BoardSettings
from protocol import Samples
from protocol.link import framing


def broken(outcome: DrillResult) -> set[str]:
    """Return the criteria that are not met."""
    return {criterion.text for criterion in outcome.criteria if not criterion.kept}


def test_losses_are_compared_with_the_board_truth(tmp_path: Path) -> None:
    """A sound program passes, and counts what was injected: 1 + 7 + 255 + 10 samples and the damaged frames."""
    outcome = run_drill(drills.loss, tmp_path / "loss")
    assert outcome.passed, outcome
    assert outcome.counts["missing_by_truth"] == outcome.counts["lost_said"] >= 273


def test_recorder_that_drops_samples_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One block of samples in ten is dropped without an error: the board's truth disagrees."""
    take, seen = Recorder.__call__, [0]

    def lossy(recorder: Recorder, block: Any) -> None:
        seen[0] += any(isinstance(event, Samples) for event in block.events)
        if seen[0] % 10 != 5:
            take(recorder, block)

    monkeypatch.setattr(Recorder, "__call__", lossy)
    outcome = run_drill(drills.ambient_flash, tmp_path / "flash")
    assert not outcome.passed
    assert "no sample is lost" in broken(outcome), outcome


@pytest.mark.nightly
def test_decoder_without_checksum_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the CRC, flipped bits become samples that the board never took."""
    monkeypatch.setattr(framing, "RESIDUE", _EqualToAll())
    outcome = run_drill(drills.flips, tmp_path / "flips")
    assert not outcome.passed


class _EqualToAll:
    """Equals everything: every checksum is valid."""

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return True

    def __ne__(self, other: object) -> bool:
        return False


def passing(_rig: DrillRig) -> DrillResult:
    """Return a result whose criterion is met."""
    return DrillResult("passing", "nothing", (Criterion("is kept", "yes", True),), "nothing")


def failing(_rig: DrillRig) -> DrillResult:
    """Return a result whose criterion is not met."""
    return DrillResult("failing", "a doctored criterion", (Criterion("is <b>never</b> kept", "no", False),), "all")


def test_clients_of_the_secop_node_pass(tmp_path: Path) -> None:
    """Read, refused, driven, vented: the drill of `qualify`."""
    outcome = run_drill(drills.secop, tmp_path / "secop")
    assert outcome.passed, broken(outcome)


def breaking(_rig: DrillRig) -> DrillResult:
    """Raise an error."""
    raise RuntimeError("the drill itself broke")


def empty(_rig: DrillRig) -> DrillResult:
    """Return a result without a criterion."""
    return DrillResult("empty", "nothing", (), "nothing")


def test_failed_drill_gives_exit_1_and_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The report names it, and its folder is kept for finding the cause."""
    monkeypatch.setattr(drills, "DRILLS", (passing, failing))
    run = CliRunner().invoke(app, ["qualify", "--out", str(tmp_path), "--json"])
    assert run.exit_code == 1
    content = json.loads(run.stdout)
    assert content["passed"] is False
    assert content["verdict"].startswith("FAILED: failing")
    html, _, written = (Path(path) for path in content["files"])
    assert "failing: FAILED" in html.read_text(encoding="utf-8")
    assert "<b>never</b>" not in html.read_text(encoding="utf-8")
    assert json.loads(written.read_text(encoding="utf-8"))["passed"] is False
    assert [path.name for path in html.parent.iterdir() if path.is_dir()] == ["failing"]


@pytest.mark.parametrize("drill", [breaking, empty])
def test_drill_that_raises_or_checks_nothing_fails(drill: drills.Drill, tmp_path: Path) -> None:
    """A drill without a criterion does not pass."""
    outcome = run_drill(drill, tmp_path / "drill")
    assert not outcome.passed
    assert not qualification([outcome], datetime.now(UTC), whole=True, folder=tmp_path)["passed"]


def test_report_is_marked_simulated_and_dated_for_signature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit 0 where all criteria are met; some drills are no full qualification; an unknown drill is exit 2."""
    monkeypatch.setattr(drills, "DRILLS", (passing, failing))
    run = CliRunner().invoke(app, ["qualify", "--out", str(tmp_path), "--drill", "passing", "--json"])
    assert run.exit_code == 0
    content = json.loads(run.stdout)
    assert (content["passed"], content["whole"], content["simulated"]) == (True, False, True)
    html, pdf, _ = (Path(path) for path in content["files"])
    text = html.read_text(encoding="utf-8")
    for part in (
        "SIMULATED",
        "Signature",
        content["begun"][:10],
        content["versions"]["Python"],
        "not a full qualification",
    ):
        assert part in text
    assert pdf.read_bytes().startswith(b"%PDF")
    assert CliRunner().invoke(app, ["qualify", "--drill", "nonsense"]).exit_code == 2


def test_report_names_what_was_qualified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Program, computer, disk and port are named above the drills and the signature."""
    board = BoardSettings(speed=8.0, seed=0, faults=("index_gap@4:7",))

    def served(rig: DrillRig) -> DrillResult:
        rig.served.append(board)
        return DrillResult("served", "7 frames", (Criterion("is kept", "yes", True),), "7 samples")

    monkeypatch.setattr(drills, "DRILLS", (served,))
    run = CliRunner().invoke(app, ["qualify", "--out", str(tmp_path), "--json"])
    content = json.loads(run.stdout)
    assert (len(content["program"]["sha256"]), content["program"]["version"]) == (64, __version__)
    assert content["disk"]["folder"].startswith(str(tmp_path))
    assert content["disk"]["file_system"] and content["machine"]["system"]
    (used,) = content["drills"][0]["boards"]
    faults = ["index_gap@4:7"]
    assert used == {"port": "pseudo-terminal", "speed": 8.0, "unit": "SA1", "seed": 0, "faults": faults}
    text = Path(content["files"][0]).read_text(encoding="utf-8")
    computer = (content["program"]["sha256"], content["disk"]["folder"], content["machine"]["system"])
    for part in (*computer, used["port"], "seed 0"):
        assert part in text
    assert text.index(content["verdict"]) < text.index("Signature") < text.index(">Drills<")


def test_program_hash_depends_on_every_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any byte of any file of the program changes it; the same files give the same hash."""
    for package in ("boat_daq", "protocol", "analysis"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "a.py").write_text("x = 1\n")
    monkeypatch.setattr(result, "_ROOT", tmp_path)
    before = result.program()
    assert before["files"] == 3
    assert result.program()["sha256"] == before["sha256"]
    (tmp_path / "protocol" / "a.py").write_text("x = 2\n")
    assert result.program()["sha256"] != before["sha256"]


@pytest.mark.nightly
@pytest.mark.parametrize("drill", available(), ids=lambda drill: drill.__name__)
def test_every_drill_passes_on_this_machine(drill: drills.Drill, tmp_path: Path) -> None:
    """All that `qualify` runs, on this machine."""
    outcome = run_drill(drill, tmp_path / drill.__name__)
    assert outcome.passed, broken(outcome)
