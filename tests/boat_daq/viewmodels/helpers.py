"""What the tests of several view models share."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from boat_daq.engine.plan import built_in_plans
from boat_daq.workflows.jobs import JobFailure, JobState
from boat_daq.workflows.live_conversion import LiveElongation
from protocol.base.errors import BoatDaqError, cause_and_remedy


def until(condition, timeout_s=60.0):
    """Wait for what another process or thread does."""
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


class DirectJob:
    """A job that is done in this process, at once: for tests of what is shown, not of the processes."""

    def __init__(self, label, function, /, *args, **kwargs):
        self.counted = ""
        self.label, self.result, self.failure, self.fraction, self.permille = label, None, None, None, 0
        try:
            self.result, self.state = function(*args, **kwargs), JobState.DONE
        except BoatDaqError as error:
            self.failure, self.state = JobFailure(*cause_and_remedy(error), ""), JobState.FAILED

    def poll(self):
        return self.state

    def cancel(self):
        """Do nothing: it has ended."""


SAMPLE = Path(__file__).parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"


PLAN = built_in_plans()["calibration"]


MV_PER_MM = 40.0


class Straight:
    """A conversion with one slope: what it gives is known beforehand."""

    def __call__(self, signal_mv):
        mm = (signal_mv[:, 0] - 1652.0) / MV_PER_MM
        return LiveElongation(mm, np.full(mm.shape, 0.3), np.zeros(mm.shape, bool))

    def each(self, signal_mv):
        return np.column_stack([self(signal_mv).mm, self(signal_mv).mm])


finite = st.floats(-1e9, 1e9)
