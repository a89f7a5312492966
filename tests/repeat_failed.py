"""Repeats the failed tests of a run, and lists those that fail at times only.

`python -m tests.repeat_failed STATUS`, after a run of pytest that ended with STATUS: each failed test, and each listed
by an earlier run, is run `TIMES` more times with nothing beside it. One that fails again has failed. One that passes
each time is flaky: it is listed in `LIST` until it has passed in `CLEAN_RUNS` runs. `MOST` listed tests fail the run.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Collection
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "out" / "flaky.json"
LAST_FAILED = ROOT / ".pytest_cache" / "v" / "cache" / "lastfailed"  # pytest's own
TIMES = 5
CLEAN_RUNS = 3
MOST = 3
WORTH_REPEATING = 20  # failed tests: with more it is no matter of chance
PASSED, FAILED = 0, 1  # pytest's exit codes
NOT_OF_THIS_RUN = {4, 5}  # the test is gone, or is not of the daily set


def run_alone(test: str) -> int:
    """Run one test in a process of its own, with the platform of the whole run; return pytest's exit code."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not nightly", test]
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    quiet = subprocess.DEVNULL
    return subprocess.run(command, cwd=ROOT, env=environment, stdout=quiet, stderr=quiet).returncode


def repeat(
    failed: Collection[str], listed: dict[str, int], run: Callable[[str], int] = run_alone
) -> tuple[list[str], dict[str, int]]:
    """Return the tests that failed again, and the new list: how many runs each test has passed since it failed.

    Parameters
    ----------
    failed : tests that failed in this run.
    listed : the list of earlier runs.
    run : runs a test, returns pytest's exit code.
    """
    again, kept = [], {}
    for test in dict.fromkeys([*failed, *listed]):
        codes = [run(test) for _ in range(TIMES)]
        if NOT_OF_THIS_RUN.intersection(codes):
            continue
        count = TIMES - codes.count(PASSED)
        print(f"{test}: failed {count} of {TIMES} times alone")
        if count:
            again.append(test)
        clean = 0 if count or test in failed else listed[test] + 1
        if clean < CLEAN_RUNS:
            kept[test] = clean
    return again, kept


def main(status: int) -> int:
    """Repeat what is to be repeated; return the exit code of the whole run."""
    failed = list(json.loads(LAST_FAILED.read_text(encoding="utf-8"))) if LAST_FAILED.exists() else []
    if status not in (PASSED, FAILED) or (status == FAILED and not failed) or len(failed) > WORTH_REPEATING:
        return status
    listed = json.loads(LIST.read_text(encoding="utf-8")) if LIST.exists() else {}
    again, kept = repeat(failed, listed)
    LIST.parent.mkdir(exist_ok=True)
    LIST.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    for test in kept.keys() - set(again):
        print(f"flaky: {test}, listed in {LIST.relative_to(ROOT)}")
    return FAILED if again or len(kept) >= MOST else PASSED


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
