"""The program against boards of other makers, each within the wire contract or clearly outside it."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.recording.summary import Summary
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.workflows.run_session import SessionRequest, run_session
from protocol.base.errors import BoatDaqError
from tests.system import third_party_boards as boards

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")

PLAN = dataclasses.replace(built_in_plans()["repeatability"], cycles=1, ramp_kpa_per_s=40.0)


def nightly(kind: type[boards.Board], *more: object) -> object:
    return pytest.param(kind, *more, marks=pytest.mark.nightly, id=kind.__name__)


def ci(kind: type[boards.Board], *more: object) -> object:
    return pytest.param(kind, *more, id=kind.__name__)


@contextmanager
def served(kind: type[boards.Board]) -> Iterator[boards.Board]:
    """Serve a board; afterwards it is vented, and received nothing between a command and its repetitions."""
    with closing(kind()) as board:
        yield board
        time.sleep(0.5)
        assert abs(board.pressure) < 1_000
        for number, (before, frame) in enumerate(pairwise(board.heard), 1):
            assert frame == before or frame not in board.heard[max(0, number - 100) : number], board.heard[number - 5 :]


def recorded(board: boards.Board, path: Path) -> tuple[Summary, str]:
    summary, failure, _ = run_session(SessionRequest(board.url, path, PLAN), notify=print)
    assert verify_recording(path).identical
    return summary, failure


@pytest.mark.fault(17, how="answers of another maker's board lost, late by 200 ms, and none of them", times=3)
@pytest.mark.parametrize(
    "kind",
    [
        ci(boards.LosesStart),
        nightly(boards.Board),
        nightly(boards.Late),
        nightly(boards.Slow),
        nightly(boards.Four),
        nightly(boards.BootsLate),
        nightly(boards.Newer),
        nightly(boards.Drops),
        nightly(boards.Trickles),
        nightly(boards.Running),
        nightly(boards.Latched),
    ],
)
def test_board_within_the_contract_runs_a_plan(
    kind: type[boards.Board], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One cycle, every sample that the board sent after START, each command executed once, and no error."""
    with served(kind) as board:
        summary, failure = recorded(board, tmp_path / "run.boat")
        assert failure == ""
        assert summary.cycles.complete == 1
        assert board.acts.count(boards.START) == 1
        assert board.timeout_s == 0, "its watchdog is disarmed"
        *_, stream = summary.segments
        since_start = len(board.indices) - max(i for i, index in enumerate(board.indices) if index == 0)
        assert (stream.reason, stream.samples) == ("started", since_start)
        assert summary.lost_samples == (7 if kind is boards.Drops else 0)
    assert "error" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("kind", "cause", "remedy"),
    [
        ci(boards.NoStart, "refused START: out of its limits, at 100 Hz", "rate"),
        ci(boards.Narrow, "above the board's limit of 30 kPa", "lower"),
        nightly(boards.NoSensors, "no plausible HELLO", "1 to 4 sensors"),
        nightly(boards.NoScale, "no plausible HELLO", "bits"),
        nightly(boards.NoRate, "no plausible HELLO", "rate above 0"),
        nightly(boards.NoVacuum, "5 to 70 kPa, do not include 0 kPa", "firmware"),
    ],
)
def test_unusable_board_is_refused_and_left_vented(
    kind: type[boards.Board], cause: str, remedy: str, tmp_path: Path
) -> None:
    """The error has cause and remedy; no pressure was commanded, and no watchdog is left armed."""
    with served(kind) as board:
        with pytest.raises(BoatDaqError) as refusal:
            run_session(SessionRequest(board.url, tmp_path / "run.boat", PLAN))
        assert cause in refusal.value.cause
        assert remedy in refusal.value.remedy
        assert boards.SET_PRESSURE not in board.acts
        assert board.timeout_s == 0
        assert board.state != boards.FAULT


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("kind", "cause"),
    [
        ci(boards.TooLate, "did not answer"),
        ci(boards.NoLimits, "refused SET_LIMITS"),
        ci(boards.NoWatchdog, "refused HEARTBEAT"),
        ci(boards.Leaks, "50 kPa was not reached"),
        ci(boards.Resets, "restarted (brown out)"),
    ],
)
def test_broken_run_is_reported_once(
    kind: type[boards.Board], cause: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is vented, recorded until then, and reported by one error with its remedy."""
    with served(kind) as board:
        summary, failure = recorded(board, tmp_path / "run.boat")
        assert cause in failure
        assert summary.cycles.complete == 0
    errors = capsys.readouterr().out
    assert errors.count("error:") == 1
    assert errors.count("try:") == 1
    assert errors.count(cause) == 1
