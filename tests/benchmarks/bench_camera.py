"""What a camera of 640 x 480 at 30 frames/s costs beside a streaming board, and how soon a frame is on the screen."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.benchmarks.lengths import WHOLE, length

SHARE_LIMIT = 0.25  # of a core
LATENCY_LIMIT_MS = 100.0
SECONDS = length(10, 2)


@pytest.fixture
def filmed_board(tmp_path, monkeypatch):
    """Start a virtual board with its camera in another process; return the port and the camera's address."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    command = [sys.executable, "-m", "boat_daq", "board", "--pty", "--mjpeg", "0", "--json"]
    board = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert board.stdout is not None
    head = json.loads(board.stdout.readline())
    yield head["port"], head["camera"]
    board.terminate()
    board.wait()
    board.stdout.close()


def share(qtbot) -> float:
    """Return the share of a core that the process takes."""
    began, used = time.perf_counter(), time.process_time()
    qtbot.wait(1000 * SECONDS)
    return (time.process_time() - used) / (time.perf_counter() - began)


def test_camera_in_the_window(qtbot, filmed_board, capsys):
    """Live page at 1280 x 800 with the tab Camera in front: closed, then open; each frame from arrival to its paint."""
    from boat_daq.gui.app import make_application, make_window
    from boat_daq.gui.live.readings_panel import BY_CAMERA

    port, address = filmed_board
    make_application()
    window = make_window()
    qtbot.addWidget(window)
    window.resize(1280, 800)
    window.show()
    model, panel = window.model, window.live.camera
    model.shadow.prepare = lambda: None
    model.connection.connect(port)
    qtbot.waitUntil(model.live.has_data, timeout=30_000)
    window.live.pane.setCurrentWidget(window.live.readings)
    window.live.readings.choose(BY_CAMERA)
    qtbot.wait(length(3000, 100))
    without = share(qtbot)
    panel.source.setText(address)
    panel.mark.setText("8")
    panel.button.click()
    qtbot.waitUntil(lambda: panel.model.view().u != "", timeout=30_000)
    painted: dict[int, float] = {}
    paint = panel.picture.paintEvent

    def timed(event) -> None:
        paint(event)
        if panel.picture.host_ns is not None:
            painted.setdefault(panel.picture.host_ns, 1e-6 * (time.monotonic_ns() - panel.picture.host_ns))

    panel.picture.paintEvent = timed
    before = panel.model.channel.state
    used = share(qtbot) - without
    after = panel.model.channel.state
    rate_hz = (after.frames - before.frames) / SECONDS
    median_ms, p95_ms = np.percentile(list(painted.values()), [50, 95])
    missing = after.dropped - before.dropped
    with capsys.disabled():
        print(
            f"\ncamera 640 x 480: {rate_hz:.1f} frames/s, {missing} missing, {100 * used:.1f} % of one core beside the"
            f" window's {100 * without:.1f} % ({used / SHARE_LIMIT:.2f} of the limit); arrival to paint: median"
            f" {median_ms:.1f} ms, 95 % {p95_ms:.1f} ms ({p95_ms / LATENCY_LIMIT_MS:.2f} of the limit)"
        )
    assert painted
    assert not WHOLE or len(painted) > 0.5 * (after.frames - before.frames)
    window.close()
