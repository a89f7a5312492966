"""Jobs in helper processes: progress, result, refusal, crash, cancel."""

from __future__ import annotations

import os
import sys
import time

import pytest

from boat_daq.workflows import jobs
from boat_daq.workflows.jobs import Job, JobRunner, JobState, prepare
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.helpers import until


def slow_square(n, *, progress):
    """Square in ten steps."""
    for i in range(10):
        progress(i + 1, 10)
    return n * n


def refuse():
    """Refuse with an error of the program."""
    raise RequestError("the run has no sensor", "Record one.")


def leave():
    """End without a result."""
    import os

    os._exit(3)


def scheduling():
    """Return niceness and cores of this process."""
    import os

    return os.getpriority(os.PRIO_PROCESS, 0), os.sched_getaffinity(0)


def pause(seconds):
    """Wait."""
    time.sleep(seconds)


def test_job_returns_progress_and_result():
    """A function named by its place runs in another process; progress and result arrive by polling alone."""
    job = Job("Squaring", slow_square, 12)
    job.counts = "steps"
    until(lambda: job.poll() is not JobState.RUNNING)
    assert (job.state, job.result, job.permille) == (JobState.DONE, 144, 1000)
    assert job.counted.startswith("Squaring: ") and job.counted.endswith(" steps")


def load():
    """Load what a job needs: nothing."""


def test_prepared_helper_takes_the_next_job():
    """The helper that was started before runs the job, and is not used twice; one that waits ends with the runner."""
    prepare(load)
    (_, process), *others = jobs._prepared
    job = Job("Squaring", slow_square, 12)
    assert (job._process, others, jobs._prepared) == (process, [], [])
    until(lambda: job.poll() is not JobState.RUNNING)
    assert (job.state, job.result) == (JobState.DONE, 144)
    prepare(load)
    ((_, waiting),) = jobs._prepared
    JobRunner().close()
    waiting.join(5.0)
    assert (waiting.exitcode is None, jobs._prepared) == (False, [])


def test_refusal_keeps_its_remedy_and_crash_is_reported():
    """An error of the program keeps cause and remedy; a process that just ends is reported as ended."""
    refused, crashed = Job("Refusing", refuse), Job("Crashing", leave)
    until(lambda: refused.poll() is not JobState.RUNNING and crashed.poll() is not JobState.RUNNING)
    assert (refused.failure.cause, refused.failure.remedy) == ("the run has no sensor", "Record one.")
    assert "ended without a result" in crashed.failure.cause


@pytest.mark.parametrize("wait_s", [0.0, 30.0])
def test_job_of_a_helper_that_died_ends_in_a_result_or_a_cause(wait_s):
    """A helper that died with the job unread raised in every poll; to one that is gone no job could be sent."""
    prepare(leave)
    until(lambda: not wait_s or not jobs._prepared[0][1].is_alive(), wait_s + 1.0)
    job = Job("Squaring", slow_square, 12)
    until(lambda: job.poll() is not JobState.RUNNING, 30.0)
    ended = job.failure.cause if job.failure is not None else job.result
    assert ended in {"Squaring: the process ended without a result", 144}
    assert not wait_s or ended == 144


def test_cancelled_job_ends_and_frees_its_slot(tmp_path):
    """A cancelled job ends at once, and its slot in the runner is free; what it has begun to write is removed."""
    runner, ended = JobRunner(), []
    job = runner.start("long", Job("Sleeping", pause, 60), ended.append)
    job.target = tmp_path / "r.csv"
    (tmp_path / "r.csv.123-1.part").write_text("index,")
    runner.cancel("long")
    assert list(tmp_path.iterdir()) == []
    runner.poll()
    assert job.state is JobState.CANCELLED
    assert ended == [job]
    assert runner.get("long") is None


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process's priority and cores cannot be read")
@pytest.mark.fault(60, how="a job runs beside the window")
def test_helper_has_the_lowest_priority_and_leaves_a_core():
    """A computation of the program takes no time from the threads that read, record and control."""
    job = Job("Asking", scheduling)
    until(lambda: job.poll() is not JobState.RUNNING)
    nice, cores = job.result
    ours = os.sched_getaffinity(0)
    assert nice == 19
    assert len(cores) == max(1, len(ours) - 1)
