"""What LSL, SECoP with five clients, and the window cost beside the recorder at 10 kHz; and what is lost.

`BOAT_LOAD_S` sets the length; `make bench` takes ten seconds. The clients and the inlet are processes of their own, as
they are in a lab.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from boat_daq.engine.outlets.lsl import LslOutlet
from boat_daq.engine.outlets.secop_node import SecopNode
from boat_daq.engine.outlets.secop_server import SecopServer
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.simulator.server import BoardSettings, serve

pytestmark = pytest.mark.benchmark_run

RATE_HZ, CLIENTS = 10_000, 5
SECONDS = float(os.environ.get("BOAT_LOAD_S", "10"))
CLIENT = """
import socket, sys, time
end = time.time() + float(sys.argv[2])
lines = socket.create_connection(("127.0.0.1", int(sys.argv[1]))).makefile("rw")
lines.write("activate\\n"); lines.flush()
updates = 0
while time.time() < end:
    updates += lines.readline().startswith("update")
print(updates)
"""
INLET = """
import sys, time
import pylsl
pylsl.set_config_content("[multicast]\\nResolveScope = machine\\n[log]\\nlevel = -2\\n")
inlet = pylsl.StreamInlet(pylsl.resolve_byprop("source_id", sys.argv[2], timeout=20)[0], max_buflen=60)
inlet.open_stream(timeout=20)
print("open", flush=True)
n, end = 0, time.time() + float(sys.argv[1])
while time.time() < end:
    n += len(inlet.pull_chunk(timeout=0.1, max_samples=20000)[1])
print(n)
"""


def program(text: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", text, *arguments], stdout=subprocess.PIPE, text=True)


def read(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


@pytest.mark.timeout(600)
@pytest.mark.parametrize("outlets", ["none", "lsl", "secop", "both"])
def test_cost_of_outlets_beside_window_and_recorder(
    tmp_path: Path, outlets: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Processor time of the program with each outlet; samples lost on the link, in the recording and in the stream."""
    pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed")
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path / "home"))
    from PySide6.QtTest import QTest

    from boat_daq.gui.app import make_application, make_window

    make_application()
    window = make_window()
    window.resize(1280, 800)
    window.show()
    session, path = window.model.session, tmp_path / "run.boat"
    servers: list[Any] = []
    with serve(BoardSettings()) as board:
        session.connect(board.url, rate_hz=RATE_HZ, record_to=path)
        session.wait_connected()
        session.wait(lambda _: session.ring is not None, 10)
        if outlets in ("lsl", "both"):
            servers.append(LslOutlet(session, pylsl))
        if outlets in ("secop", "both"):
            servers.append(SecopServer(SecopNode(session, tmp_path), ("127.0.0.1", 0)))
        lsl = next((s for s in servers if isinstance(s, LslOutlet)), None)
        secop = next((s for s in servers if isinstance(s, SecopServer)), None)
        inlet = program(INLET, str(SECONDS + 2), f"{lsl.source_id} BOAT") if lsl else None
        if inlet is not None:
            assert read(inlet) == "open"
        before = lsl.pushed if lsl else 0
        clients = [program(CLIENT, str(secop.port), str(SECONDS)) for _ in range(CLIENTS)] if secop else []
        used, began = time.process_time(), time.perf_counter()
        QTest.qWait(round(1000 * SECONDS))
        cpu = (time.process_time() - used) / (time.perf_counter() - began)
        updates = sum(int(read(client) or 0) for client in clients)
        QTest.qWait(2500 if inlet else 100)
        received = int(read(inlet)) if inlet else 0
        skipped = lsl.skipped if lsl else 0
        health = session.snapshot().health
        for server in servers:
            server.close()
        session.stop_recording()
    pushed = lsl.pushed - before if lsl else 0
    window.leave()
    summary = summarise(path)
    assert health is not None
    with capsys.disabled():
        print(
            f"\noutlets {outlets:5}: {100 * cpu:5.1f} % of a core at {RATE_HZ} Hz for {SECONDS:g} s with window and "
            f"recorder; {health.statistics.lost} lost on the link, {summary.lost_samples} in the recording of "
            f"{summary.samples}, {skipped} in the stream; inlet {received} of {pushed} pushed, {updates} updates to "
            f"{len(clients)} clients"
        )
    assert skipped == 0  # what a busy computer loses on the link is printed, and counted exactly
    assert summary.lost_samples == health.statistics.lost
