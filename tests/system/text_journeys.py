"""Journeys that end in codes and numbers, run by `test_scrambled_text.py` as they are and with scrambled sentences.

`python -m tests.system.text_journeys FOLDER` prints what came out of the scrambled ones.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from tests.system import scrambled_text

SAMPLE = Path(__file__).resolve().parents[2] / "recordings" / "simulated_SA1_two_cycles.boat"
FAULTS = (
    "ack_lost@8:40", "ack_refused@8", "silent@8:3", "unplug@8:60", "reset@8", "estop@8:2", "pressure_invalid@8:1",
    "overshoot@8:12", "beyond_limit@8", "dead_pump@8", "stall@8", "frozen_channel@8", "saturate@8", "wrong_protocol@0",
    "other_device@0", "absurd_value@8",
)  # fmt: skip


def controller() -> dict[str, Any]:
    """A run under each fault: its state, how it ended, the kind of every message, whether pressure is forbidden."""
    from boat_daq.engine.snapshot import SessionState
    from tests.boat_daq.engine.controller_rig import QUICK, ControllerRig

    ended: dict[str, Any] = {}
    for fault in ("none@0", *FAULTS):
        rig = ControllerRig(*[fault] * (fault != "none@0"))
        rig.run(5.0, lambda rig=rig: rig.control.up)
        if rig.control.up:
            rig.do(lambda rig=rig: rig.control.arm(QUICK), rig.control.start)
            rig.run(2.0)
            rig.run(
                30.0,
                lambda rig=rig: rig.state in (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT),
                step_s=0.05,
            )
        ended[fault] = {
            "state": rig.state,
            "ends": [end.end for end in rig.ends],
            "messages": [note.kind for note in rig.notes],
            "latched": bool(rig.control.interlock.latched),
            "checks": [check.ok for check in rig.control.preflight.checks(up=rig.control.up, vented=True)],
        }
    return ended


def recording(folder: Path) -> dict[str, Any]:
    """A run that its board leaves in mid-cycle, what is known of it, and the same run resumed to its end."""
    from boat_daq.engine.plan import built_in_plans
    from boat_daq.engine.recording.resumption import prepare_resumption
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.recording.verify import verify_recording
    from boat_daq.engine.simulator.server import BoardSettings, serve
    from boat_daq.workflows.run_session import SessionRequest, run_session

    path = folder / "run.boat"
    plan = dataclasses.replace(built_in_plans()["repeatability"], cycles=3, ramp_kpa_per_s=40.0)
    with serve(BoardSettings(speed=20.0, faults=("estop@20:1",))) as board:
        _, first, _ = run_session(SessionRequest(board.url, path, plan))
    broken, end = prepare_resumption(path), summarise(path).run_end
    with serve(BoardSettings(speed=20.0)) as board:
        _, second, _ = run_session(SessionRequest(board.url, path, broken.plan, broken=broken))
    whole = summarise(path)
    return {
        "failed": [bool(first), bool(second)],
        "end": end,
        "status": whole.status,
        "breaks": len(whole.breaks),
        "complete": whole.cycles.complete,
        "identical": verify_recording(path).identical,
    }


def analysis(folder: Path) -> dict[str, Any]:
    """Figures, reasons and warnings of a sound and of a clipped recording; the error of a table without a spread."""
    import numpy as np

    from analysis import BoatDaqError, analyse, fit_calibration, load_recording, write_report

    sound = load_recording(SAMPLE)
    clipped = dataclasses.replace(
        sound, signal_mv=np.minimum(sound.signal_mv, np.quantile(sound.signal_mv, 0.7, axis=0))
    )
    found = {}
    for name, run in (("sound", sound), ("clipped", clipped)):
        result = analyse(run, mcmc=name == "sound")
        found[name] = {
            "sections": len(write_report([result], folder / f"{name}.html").sections),
            "warnings": [[warning.code, warning.subject] for warning in result.warnings],
            "figures": [
                {key: [figure.value, figure.reason] for key, figure in sensor.figures.items()}
                for sensor in result.sensors
            ],
        }
    try:
        fit_calibration([1.0, 1.0, 1.0, 1.0, 1.0], [1.0, 2.0, 3.0, 4.0, 5.0])
    except BoatDaqError as error:
        found["refused"] = type(error).__name__
    return found


def window(folder: Path) -> dict[str, Any]:
    """What the window offers on every page: with nothing connected, with a board, and after an abort."""
    from PySide6.QtWidgets import QAbstractButton

    from boat_daq.engine.snapshot import RunEnd, RunEnding, SessionState
    from boat_daq.gui.app import make_application
    from boat_daq.viewmodels.common.services import PLACES, Page
    from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring, idle, window_on

    application = make_application()
    (folder / "recordings").mkdir(exist_ok=True)
    shutil.copy(SAMPLE, folder / "recordings" / "sound.boat")
    (folder / "recordings" / "torn.boat").write_bytes(SAMPLE.read_bytes()[:50_000])
    aborted = dataclasses.replace(connected(), state=SessionState.ABORTED, run_ended=RunEnding(RunEnd.ABORTED, "x"))
    offered: dict[str, Any] = {}
    session = RecordedSession(idle(), filled_ring(30.0))
    shown = window_on(session, folder)
    shown.show()
    states = {"idle": idle(), "connected": connected(), "aborted": aborted}
    for name, snapshot in states.items():
        session.shown = snapshot
        for page in PLACES:
            shown.go(page)
            listed = time.monotonic() + 20.0
            shown.refresh()
            while page is Page.RECORDINGS and shown.open_page(page).list.rowCount() < 2 and time.monotonic() < listed:
                application.processEvents()
                shown.refresh()
            application.processEvents()
            shown.refresh()
            shown.commands.refresh()
            buttons = [b for b in shown.findChildren(QAbstractButton) if b.isVisible() and b.accessibleName() != ""]
            offered[f"{name}, {page.name}"] = {
                "commands": {i: [c.available(), bool(c.why())] for i, c in enumerate(shown.commands.actions)},
                "buttons": [b.isEnabled() for b in buttons],
            }
    shown.close()
    return offered


def journeys(folder: Path) -> str:
    """What came out of all of them, as JSON."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    outcome: dict[str, Any] = {
        "controller": controller(), "recording": recording(folder),
        "analysis": analysis(folder), "window": window(folder),
    }  # fmt: skip
    outcome["sentences"] = scrambled_text.ScrambledLoader.total
    return json.dumps(outcome, default=str).replace("NaN", "null")


if __name__ == "__main__":
    scrambled_text.install()
    print(journeys(Path(sys.argv[1])))
