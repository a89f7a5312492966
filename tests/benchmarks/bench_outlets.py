"""What LSL, SECoP with five clients, and the window cost beside the recorder at 10 kHz; and what is lost.

`BOAT_LOAD_S` sets the length; `make bench` takes ten seconds, the daily tests one. The clients and the inlet are
processes of their own, as they are in a lab.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis import load_recording
from boat_daq.engine.outlets.lsl import LslOutlet
from boat_daq.engine.outlets.secop_node import SecopNode
from boat_daq.engine.outlets.secop_server import SecopServer
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import LinkState
from tests.benchmarks.lengths import length
from tests.boat_daq.gui.windows import close_all
from tests.conftest import reached

RATE_HZ, CLIENTS = 10_000, 5
SECONDS = float(os.environ.get("BOAT_LOAD_S", length("10", "1")))
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
import sys, threading
import numpy as np, pylsl
pylsl.set_config_content("[multicast]\\nResolveScope = machine\\n[log]\\nlevel = -2\\n")
inlet = pylsl.StreamInlet(pylsl.resolve_byprop("source_id", sys.argv[1], timeout=20)[0], max_buflen=60)
inlet.open_stream(timeout=20)
print("open", flush=True)
ended = threading.Event()
threading.Thread(target=lambda: (sys.stdin.readline(), ended.set()), daemon=True).start()
rows, last = [], False
while not last:
    last = ended.is_set()
    while chunk := inlet.pull_chunk(timeout=0.2, max_samples=20000)[0]:
        rows += chunk
np.save(sys.argv[2], np.array(rows))
inlet.close_stream()
"""


def program(text: str, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", text, *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def line_of(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def missing(path: Path, values: NDArray[np.float64]) -> int:
    """Return how many samples of the recording, from the first that the inlet received on, it did not receive."""
    run = load_recording(path)
    rows = np.column_stack([run.signal_mv, run.pressure_kpa])
    streamed = values[:, : rows.shape[1]]
    n = min(100, len(streamed))
    firsts = np.flatnonzero((rows == streamed[0]).all(axis=1))
    starts = [at for at in firsts if np.array_equal(rows[at : at + n], streamed[:n])]
    assert len(starts) == 1
    wanted = rows[starts[0] :]
    same = min(len(wanted), len(streamed))  # what came while the recording closed is in the stream alone
    return len(wanted) - int((wanted[:same] == streamed[:same]).all(axis=1).sum())


@pytest.mark.timeout(600)
@pytest.mark.parametrize("outlets", length(["none", "lsl", "secop", "both"], ["both"]))
def test_cost_of_outlets_beside_window_and_recorder(
    tmp_path: Path, outlets: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Processor time of the program with each outlet; samples lost on the link, in the recording and in the inlet."""
    pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed")
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path / "home"))
    from PySide6.QtTest import QTest

    from boat_daq.gui.app import make_application, make_window

    make_application()
    window = make_window()
    window.resize(1280, 800)
    window.show()
    session, path, received = window.model.session, tmp_path / "run.boat", tmp_path / "received.npy"
    with ExitStack() as opened:
        board = opened.enter_context(serve(BoardSettings()))
        session.connect(board.url, rate_hz=RATE_HZ, record_to=path)
        session.wait_connected()
        reached(session, lambda _: session.live.ring is not None, 10)
        lsl = opened.enter_context(closing(LslOutlet(session, pylsl))) if outlets in ("lsl", "both") else None
        clients, inlet = list[subprocess.Popen[str]](), None
        if outlets in ("secop", "both"):
            secop = opened.enter_context(closing(SecopServer(SecopNode(session, tmp_path), ("127.0.0.1", 0))))
            arguments = (CLIENT, str(secop.port), str(SECONDS))
            clients = [opened.enter_context(program(*arguments)) for _ in range(CLIENTS)]
        if lsl is not None:
            inlet = opened.enter_context(program(INLET, f"{lsl.source_id} BOAT", str(received)))
            assert line_of(inlet) == "open"
        used, began = time.process_time(), time.perf_counter()
        QTest.qWait(round(1000 * SECONDS))
        cpu = (time.process_time() - used) / (time.perf_counter() - began)
        updates = sum(int(line_of(client)) for client in clients)
        health = session.snapshot().health
        session.disconnect()
        reached(session, lambda s: s.link is LinkState.CLOSED, 10)
        QTest.qWait(200)  # the outlet pushes what waits
        if inlet is not None:
            inlet.communicate("end\n", timeout=60)
        skipped = lsl.skipped if lsl else 0
    close_all([window])
    summary = summarise(path)
    assert health is not None
    stream = ""
    if lsl is not None:
        values = np.load(received)
        stream = f", {missing(path, values)} of {len(values)} missing in the inlet, {skipped} skipped"
    with capsys.disabled():
        print(
            f"\noutlets {outlets:5}: {100 * cpu:5.1f} % of a core at {RATE_HZ} Hz for {SECONDS:g} s with window and "
            f"recorder; {health.statistics.lost} lost on the link, {summary.lost_samples} in the recording of "
            f"{summary.samples}{stream}; {updates} updates to {len(clients)} clients"
        )
    assert skipped == 0  # what a busy computer loses on the link is printed, and counted exactly
    assert lsl is None or missing(path, values) == 0
    assert summary.lost_samples == health.statistics.lost
