"""Drills of `qualify` for LSL, SECoP and ROS 2, each where its library is installed."""

from __future__ import annotations

import json
import secrets
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from boat_daq.engine.qualification.drill_rig import WAIT_S, Criterion, DrillResult, compare
from boat_daq.engine.snapshot import SessionState
from protocol.recording import BoardState

if TYPE_CHECKING:
    from boat_daq.engine.qualification.drill_rig import DrillRig
    from boat_daq.engine.qualification.drills import Drill

STREAMED_S = 20.0  # of board time
_TOKEN = secrets.token_hex(16)
FRAPPY = """  # in a process of its own: frappy is another program, under another licence
import json, sys, time
from frappy.client import SecopClient
client = SecopClient(f"localhost:{sys.argv[1]}")
client.connect(10)
client.request("_authenticate", sys.argv[2])
client.setParameter("pressure", "_ramp", 50.0)
client.setParameter("pressure", "target", 8.0)
end = time.monotonic() + 10
while abs(client.cache["pressure", "value"][0] - 8.0) > 1.0 and time.monotonic() < end:
    time.sleep(0.05)
reached = client.cache["pressure", "value"][0]
client.execCommand("vent", "vent")
client.disconnect()
print(json.dumps({"modules": sorted(client.modules), "reached_kpa": reached}))
"""


def lsl(rig: DrillRig) -> DrillResult:
    """An LSL inlet on this computer."""
    from boat_daq.engine.outlets.lsl import LslOutlet
    from protocol.base.optional import optional

    pylsl = optional("pylsl")
    values: list[Any] = []
    times: list[float] = []
    with rig.board(speed=1.0) as board, rig.recording(board) as session:
        session.wait(lambda _: session.live.ring is not None, WAIT_S)
        outlet = LslOutlet(session, pylsl)
        try:
            found = pylsl.resolve_byprop("source_id", f"{outlet.source_id} BOAT", timeout=WAIT_S)
            inlet = pylsl.StreamInlet(found[0])
            inlet.open_stream(timeout=WAIT_S)
            end_s = session.snapshot().recorded_s + STREAMED_S
            while session.snapshot().recorded_s < end_s:
                chunk, stamps = inlet.pull_chunk(timeout=0.2, max_samples=4096)
                values += chunk
                times += stamps
            skipped, clock = outlet.skipped, outlet.clock
            inlet.close_stream()
            del inlet
        finally:
            outlet.close()
    seen = compare(rig)
    counts = np.array([row[:2] for row in values])
    scale = 3300.0 / 4096.0
    signal = (seen.samples["lit"].astype(float) - seen.samples["dark"])[:, :2] * scale
    starts = np.flatnonzero((np.abs(signal - counts[0]) < 1e-9).all(axis=1))
    same = any(np.allclose(signal[at : at + len(counts)], counts, rtol=0, atol=1e-9) for at in starts)
    steps_ms = 1e3 * np.diff(times)
    drift = clock["drift_ppm"] if clock["drift_ppm"] is not None else float("nan")
    clock_text = f"drift {drift:+.0f} ppm, arrivals scatter by {clock['jitter_ms'] or 0:.2f} ms"
    return seen.result(
        "lsl",
        "an LSL inlet on this computer receives the samples",
        Criterion("the inlet receives consecutive samples with their values", f"{len(counts)} samples", same),
        Criterion("the stream skips none", f"{skipped} skipped", skipped == 0),
        Criterion("stamps increase, on the board's clock", clock_text, bool(steps_ms.min() > 0)),
        seen.nothing_lost,
    )


def secop(rig: DrillRig) -> DrillResult:
    """A SECoP client reads, is refused, drives, and vents."""
    from boat_daq.engine.outlets.secop_node import SecopNode
    from boat_daq.engine.outlets.secop_server import CLIENTS, SecopServer

    with rig.board() as board, rig.recording(board) as session:
        session.wait(lambda s: s.last is not None, WAIT_S)
        readers = SecopServer(SecopNode(session, rig.folder), ("127.0.0.1", 0))
        drivers = SecopServer(SecopNode(session, rig.folder, allow_control=True), ("127.0.0.1", 0), token=_TOKEN)
        try:
            ident = _answers(drivers.port, "*IDN?")[0]
            refused = _answers(readers.port, "change pressure:target 10")[0]
            unasked = _answers(drivers.port, "change pressure:target 10")[0]
            beyond = _answers(drivers.port, f"_authenticate {_TOKEN}", "change pressure:target 1000")[1]
            _answers(drivers.port, f"_authenticate {_TOKEN}", "change pressure:_ramp 50", "change pressure:target 10")
            held = session.wait(lambda s: s.last is not None and s.last.state is BoardState.HOLDING, WAIT_S)
            clients = [_frappy(drivers.port)] if find_spec("frappy") else []
            with ExitStack() as idle:  # they take all places
                for _ in range(CLIENTS):
                    taken = idle.enter_context(socket.create_connection(("127.0.0.1", readers.port), timeout=WAIT_S))
                    taken.sendall(b"ping 1\n")
                    taken.recv(100)
                vented = _answers(readers.port, "do vent:_vent")[0]
            seen = session.wait(lambda s: s.last is not None and s.last.state is BoardState.VENTED, WAIT_S)
            session.wait(lambda s: s.last is not None and abs(s.last.pressure_kpa) < 0.5, WAIT_S)
        finally:
            readers.close()
            drivers.close()
    found = compare(rig)
    reached = held.last is not None and abs(held.last.pressure_kpa - 10) < 1.5
    at_rest = seen.last is not None and seen.last.state is BoardState.VENTED and seen.state is SessionState.IDLE
    return found.result(
        "secop",
        "SECoP clients read, are refused, drive and vent",
        Criterion("the node identifies itself", ident, "SECoP" in ident),
        Criterion("a client without control is refused", refused, '"ReadOnly"' in refused),
        Criterion("a client without the token is refused", unasked, '"Disabled"' in unasked),
        Criterion("a pressure beyond the limits is refused", beyond, '"RangeError"' in beyond),
        Criterion("a client with control drives the pressure", f"{held.last and held.last.pressure_kpa}", reached),
        *clients,
        Criterion(
            "VENT is obeyed without control, where all places are taken", vented, vented.startswith("done") and at_rest
        ),
        found.vented,
        found.nothing_lost,
    )


def _answers(port: int, *requests: str) -> list[str]:
    """Return the answers to requests of one client, in order."""
    with socket.create_connection(("127.0.0.1", port), timeout=WAIT_S) as client, client.makefile("rw") as lines:
        found = []
        for request in requests:
            lines.write(request + "\n")
            lines.flush()
            found.append(lines.readline().strip())
        return found


def _frappy(port: int) -> Criterion:
    """Return whether the client of frappy, the reference implementation, understands the node and drives it."""
    program = [sys.executable, "-c", FRAPPY, str(port), _TOKEN]
    ended = subprocess.run(program, capture_output=True, text=True, encoding="utf-8", timeout=WAIT_S, check=False)
    text = f"frappy ended with {ended.returncode}: {ended.stderr[-200:]}"
    good = False
    if ended.returncode == 0:
        found = json.loads(ended.stdout.splitlines()[-1])
        text = f"{len(found['modules'])} modules, {found['reached_kpa']:.1f} kPa, vented"
        good = abs(found["reached_kpa"] - 8.0) <= 1.0 and {"s1", "pressure", "vent"} <= set(found["modules"])
    return Criterion("the client of frappy reads, drives and vents", text, good)


def ros(rig: DrillRig) -> DrillResult:
    """A recording is exported as a ROS 2 bag and read back."""
    from analysis import load_recording
    from analysis.data.export import export
    from protocol.base.optional import optional

    highlevel, typesys = optional("rosbags.highlevel"), optional("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with rig.board() as board, rig.recording(board) as session:
        session.wait(lambda s: s.recorded_s > STREAMED_S, WAIT_S)
    found = compare(rig)
    run = load_recording(rig.run)
    criteria = []
    for form in ("rosbag", "rosbag-sqlite3"):
        bag = rig.folder / form
        began = time.monotonic()
        export(run, bag, "rosbag" if form == "rosbag" else "rosbag-sqlite3")
        seconds = time.monotonic() - began
        with highlevel.AnyReader([bag], default_typestore=store) as reader:
            chosen = [c for c in reader.connections if c.topic in ("/boat/s1_mv", "/boat/description")]
            read: list[tuple[str, Any]] = [
                (c.topic, reader.deserialize(data, c.msgtype)) for c, _, data in reader.messages(chosen)
            ]
        signal = np.array([message.data for topic, message in read if topic == "/boat/s1_mv"])
        same = np.array_equal(signal, run.signal_mv[:, 0])
        about = json.loads(next(message.data for topic, message in read if topic == "/boat/description"))
        criteria.append(Criterion(f"{form}: values are read back", f"{signal.size} in {seconds:.1f} s", same))
        criteria.append(Criterion(f"{form}: marked as simulated", str(about["SIMULATED"]), about["SIMULATED"] is True))
    return found.result("ros", "a recording as a ROS 2 bag, read back", *criteria, found.nothing_lost)


def outlet_drills() -> tuple[Drill, ...]:
    """Return the drills whose libraries are installed here."""
    local = sys.platform == "linux"  # elsewhere LSL streams cannot be kept on this computer
    found: list[Drill] = [lsl] if local and find_spec("pylsl") else []
    return (*found, secop, *([ros] if find_spec("rosbags") else []))
