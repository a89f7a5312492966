"""Measure from a script: watch the samples of two seconds, run a plan into a recording, and read it as a frame.

python -m boat_daq.examples.measure_live PORT RUN.boat
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from boat_daq import Plan, Session, load_recording

_PLAN = Plan("two plateaus", "staircase", cycles=1, high_kpa=20.0, low_kpa=0.0, step_kpa=20.0, ramp_kpa_per_s=20.0)


def main(port: str, path: str, plan: Plan = _PLAN) -> pd.DataFrame:
    """Print the mean signals of two seconds, run the plan, and return the samples of its recording."""
    with Session.open(port, record_to=Path(path)) as session:
        for block in session.samples(seconds=2.0, every_s=0.5):
            print(f"{len(block)} samples, {block.signal_mv.mean(axis=0)} mV, {block.skipped} skipped")
        ending = session.run(plan)
        print(f"run {ending.text}, vented to {session.snapshot().last.pressure_kpa:.1f} kPa")  # type: ignore[union-attr]
    frame = load_recording(path).to_frame()
    print(frame.groupby("target_kpa")[["pressure_kpa", "s1_mv"]].mean())
    return frame


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
