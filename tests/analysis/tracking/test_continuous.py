"""The loop over the camera's elongation: a branch that was vented through is none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analysis import Recording
from analysis.segmentation.cycles import find_cycles
from analysis.tracking.continuous import ContinuousCalibration, camera_figures

RATE, LOOP_MV, SPAN_MV = 100.0, 12.0, 300.0


def continuous(down_s: float, up_s: float, cycles: int = 3) -> ContinuousCalibration:
    """Return the calibration of a straight sensor with a loop, driven down and up in these times."""
    z = np.concatenate(
        [np.append(np.linspace(1, -1, int(down_s * RATE)), np.linspace(-1, 1, int(up_s * RATE)))] * cycles
    )
    loading = np.concatenate([np.append(np.full(int(down_s * RATE), -1), np.full(int(up_s * RATE), 1))] * cycles)
    x = 0.55 + 3.25 * z
    signal = 1650.0 + 0.5 * SPAN_MV * z + 0.5 * LOOP_MV * loading * (1.0 - z**2)
    rng, time = np.random.default_rng(0), np.arange(z.size) / RATE
    run = Recording.from_arrays(time, 5.0 + 45.0 * z, (signal + 0.3 * rng.standard_normal(z.size))[:, None])
    film = SimpleNamespace(record=SimpleNamespace(at=lambda _: (x, np.gradient(x, time))), recording=run)
    return camera_figures(film, run, find_cycles(run).used, [None]).sensors[0]


def test_two_driven_branches_have_the_loop() -> None:
    """4 % of the full scale, of each cycle and of their mean."""
    found = continuous(8.0, 8.0)
    assert not found.hysteresis_void
    assert found.hysteresis_percent_fso == pytest.approx(4.0, abs=0.1)
    assert found.per_cycle == pytest.approx([4.0] * len(found.per_cycle), abs=0.2)


@pytest.mark.parametrize(("down_s", "up_s", "driven"), [(30.0, 4.0, "unloading"), (3.0, 24.0, "loading")])
def test_a_branch_passed_much_faster_is_no_branch(down_s: float, up_s: float, driven: str) -> None:
    """No hysteresis, with the reason, in JSON too; the curve stays."""
    found = continuous(down_s, up_s)
    assert found.calibration is not None
    assert np.isnan([found.hysteresis_percent_fso, *found.per_cycle]).all()
    assert found.hysteresis_void.startswith(f"only the {driven} branch was driven")
    assert found.as_json()["hysteresis_void"] == found.hysteresis_void
