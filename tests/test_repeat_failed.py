"""A test that fails at times: repeated, listed, and forgotten after some sound runs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import chain, repeat
from pathlib import Path

import pytest

from tests import repeat_failed
from tests.repeat_failed import CLEAN_RUNS, FAILED, MOST, PASSED, TIMES, main, run_alone

GONE = 4


@pytest.fixture
def outcome(tmp_path, monkeypatch):
    """Return a function of status, failed tests and each test's later exit codes: the run's code, and the list."""
    monkeypatch.setattr(repeat_failed, "ROOT", tmp_path)
    monkeypatch.setattr(repeat_failed, "LIST", tmp_path / "out" / "flaky.json")
    monkeypatch.setattr(repeat_failed, "LAST_FAILED", tmp_path / "lastfailed")
    codes: dict[str, Iterator[int]] = {}
    monkeypatch.setattr(repeat_failed.repeat, "__defaults__", (lambda test: next(codes[test]),))

    def run(status: int, failed: list[str], **later: list[int]) -> tuple[int, dict[str, int]]:
        Path(repeat_failed.LAST_FAILED).write_text(json.dumps(dict.fromkeys(failed, True)))
        codes.update({test: chain(each, repeat(PASSED)) for test, each in later.items()})
        code = main(status)
        path = repeat_failed.LIST
        return code, json.loads(path.read_text()) if path.exists() else {}

    return run


@pytest.mark.parametrize("at", range(TIMES))
def test_one_failure_of_five_fails_the_run(outcome, at):
    """A race of 30 % passed seven times of ten when only the second outcome counted."""
    assert outcome(FAILED, ["a"], a=[PASSED] * at + [FAILED]) == (FAILED, {"a": 0})


def test_crash_of_a_repeated_test_is_a_failure(outcome):
    assert outcome(FAILED, ["a"], a=[-11])[0] == FAILED


def test_flaky_test_is_listed_until_it_has_passed_some_runs(outcome):
    """The run passes; the next ones repeat the test as well."""
    assert outcome(FAILED, ["a"], a=[]) == (PASSED, {"a": 0})
    for clean in range(1, CLEAN_RUNS):
        assert outcome(PASSED, []) == (PASSED, {"a": clean})
    assert outcome(PASSED, []) == (PASSED, {})


def test_listed_test_that_fails_alone_fails_the_run(outcome):
    """Though the run itself has passed."""
    outcome(FAILED, ["a"], a=[])
    assert outcome(PASSED, [], a=[PASSED, FAILED]) == (FAILED, {"a": 0})


def test_three_flaky_tests_fail_the_run(outcome):
    """In one run or in successive ones."""
    names = [f"t{i}" for i in range(MOST)]
    assert outcome(FAILED, names[:-1], **{name: [] for name in names})[0] == PASSED
    assert outcome(FAILED, names[-1:]) == (FAILED, {"t0": 1, "t1": 1, "t2": 0})


def test_test_that_is_gone_is_forgotten(outcome):
    outcome(FAILED, ["a"], a=[])
    assert outcome(PASSED, [], a=[GONE]) == (PASSED, {})


@pytest.mark.parametrize("status", [FAILED, 2, 3])
def test_run_that_failed_without_a_failed_test_stays_failed(outcome, status):
    """Interrupted, an error of pytest, a plugin's objection."""
    assert outcome(status, []) == (status, {})


def test_window_is_repeated_without_a_screen(tmp_path, monkeypatch):
    """Every test of the window failed five times of five alone: Qt looked for a display."""
    for name in ("QT_QPA_PLATFORM", "DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    test = tmp_path / "test_opens.py"
    test.write_text("def test_opens(qtbot):\n    from PySide6.QtWidgets import QWidget\n    QWidget().show()\n")
    assert run_alone(str(test)) == PASSED
