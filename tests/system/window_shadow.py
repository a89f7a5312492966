"""The shadow's alarms in the real window, in a process of its own: started by `test_window_shadow.py` under Xvfb.

    python -m tests.system.window_shadow FOLDER SEED CYCLES [FAULT]

A virtual board with or without a fault at 20 times real time; the unit is calibrated from the sample recording.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

from boat_daq.engine.snapshot import SessionState
from tests.system.window_scenarios import SPEED, Scenario

SAMPLE = Path(__file__).resolve().parents[2] / "recordings" / "simulated_SA1_two_cycles.boat"
ACTIVE = (SessionState.RUNNING, SessionState.FINISHING)


def watch(scenario: Scenario, seed: str, cycles: int, fault: str | None) -> None:
    """Calibrate, connect, run cycles with the shadow's page open; print the alarms."""
    model = scenario.window.model
    model.calibration.analyse(SAMPLE)
    scenario.until(lambda: model.calibration.result is not None, "the analysis", 120)
    model.calibration.request_acceptance()
    model.shadow.prepare()
    scenario.until(lambda: model.shadow.model is not None, "the shadow", 120)
    command = [sys.executable, "-m", "boat_daq", "board", "--pty", "--speed", f"{SPEED:g}", "--seed", seed]
    board = subprocess.Popen(command + (["--fault", fault] if fault else []), stdout=subprocess.PIPE, text=True)
    assert board.stdout is not None
    model.connection.connect(board.stdout.readline().strip())
    scenario.until(model.connected, "the board")
    scenario.until(lambda: model.live.inverse is not None, "the live elongation")
    model.sequence.choose("repeatability")
    model.sequence.plan = dataclasses.replace(model.sequence.plan, cycles=cycles)
    scenario.click(scenario.window.live.sequence.buttons["arm"])
    scenario.until(lambda: scenario.state() is SessionState.ARMED, "armed")
    scenario.click(scenario.window.live.sequence.buttons["start"])
    scenario.until(lambda: scenario.state() is SessionState.RUNNING, "running")
    scenario.click(scenario.window.navigation.buttons["Shadow"])
    for frame in range(6):
        scenario.until(lambda n=frame: len(model.monitor.marks) > n, "a cycle", 60)
        scenario.keep(f"shadow-{frame}")
    scenario.until(lambda: scenario.state() not in ACTIVE, "the end of the run", 180)
    scenario.until(lambda: len(model.monitor.marks) >= cycles - 1, "the last cycle", 20)
    scenario.keep("shadow-end")
    board.terminate()
    board.wait()
    rows = model.monitor.rows()
    alarms = [(a.fault, a.since_cycle, a.cycle) for a in model.monitor.alarms]
    scenario.done(cycles=len(model.monitor.marks), alarms=alarms, rows=rows)


if __name__ == "__main__":
    folder, seed, cycles, *fault = sys.argv[1:]
    watch(Scenario(Path(folder)), seed, int(cycles), fault[0] if fault else None)
