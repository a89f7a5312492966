"""What a frame of the live page costs with an hour of history; how soon the window is up; from byte to pixel."""

from __future__ import annotations

import math
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from boat_daq.viewmodels.common.services import Tab
from protocol.recording import sample_dtype
from tests.benchmarks.lengths import WHOLE, benchmark_shadow, length
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring

HOUR_S = length(3600.0, 120.0)
FRAMES, SKIPPED = length((300, 20), (3, 1))
BUDGET_MS = 1000 / 60
REST_SHARE = 0.20  # of a core
DRAWN, WHOLE_DRAWN = length((20, 3), (1, 1))


def window_on(qtbot, tmp_path, size):
    """The main window on a filled ring, with a calibration and the shadow."""
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.gui import app
    from boat_daq.viewmodels.app_model import AppModel
    from boat_daq.workflows.live_conversion import LiveElongation

    app.make_application()
    session = RecordedSession(connected(), filled_ring(HOUR_S))
    window = app.window_on(AppModel(session, tmp_path, tmp_path / "recordings", UnitLibrary(tmp_path / "units")))
    qtbot.addWidget(window)
    window.frame_timer.stop()
    window.calm_timer.stop()

    def inverse(signal_mv):
        mm = (signal_mv.mean(axis=1) - 1638.0) / 40.0
        return LiveElongation(mm, np.full(mm.shape, 0.3), np.zeros(mm.shape, bool))

    window.model.live.inverse = inverse
    window.model.shadow.model = benchmark_shadow()
    window.resize(*size)
    window.show()
    qtbot.waitExposed(window)
    window.refresh()
    return window, session.live.ring


def feed(ring, n, at_s):
    """Append `n` samples from `at_s`."""
    samples = np.zeros(n, sample_dtype(2, "signal"))
    time_s = at_s + np.arange(1, n + 1) / 100
    samples["time_us"] = np.round(time_s * 1e6)
    samples["host_ns"] = np.round(time_s * 1e9)
    samples["pressure_pa"] = 30_000 * np.sin(time_s / 3)
    samples["signal_mv"] = 1650 + 100 * np.sin(time_s / 3)[:, None] + np.random.default_rng(n).normal(0, 1, (n, 2))
    ring.append(samples)
    return time_s[-1]


@pytest.mark.parametrize("size", length([(1280, 800), (1920, 1080)], [(1280, 800)]))
@pytest.mark.parametrize("span_s", length([10.0, 60.0, HOUR_S], [10.0]))
def test_frame(qtbot, tmp_path, size, span_s, capsys):
    """Draw and paint 300 whole frames, new samples before each; print the median and the 99th percentile."""
    window, ring = window_on(qtbot, tmp_path, size)
    window.model.live.set_window(span_s)
    at_s, wall, cpu = HOUR_S, [], []
    for frame in range(FRAMES + SKIPPED):
        at_s = feed(ring, 2, at_s)
        window.live.plots._whole_until_s = -math.inf  # the more expensive kind: a picture that moves is drawn whole
        began, used = time.perf_counter(), time.process_time()
        window.live.draw()
        window.live.plots.view.viewport().repaint()
        window.live.shadow.view.repaint()
        if frame >= SKIPPED:
            wall.append(1000 * (time.perf_counter() - began))
            cpu.append(1000 * (time.process_time() - used))
    p99, p99_cpu = np.percentile(wall, 99), np.percentile(cpu, 99)
    with capsys.disabled():
        print(
            f"\n{size[0]} x {size[1]}, {span_s:g} s shown: median {statistics.median(wall):.2f} ms, 99 % {p99:.2f} ms"
            f" (CPU {statistics.median(cpu):.2f}, 99 % {p99_cpu:.2f}); a frame at 60/s has {BUDGET_MS:.1f} ms"
        )
    assert len(wall) == FRAMES


def test_shadow_frames(qtbot, tmp_path, capsys):
    """Draw the shadow with a moving signal: a state of each model, the pane, the page with all of it."""
    window, ring = window_on(qtbot, tmp_path, (1280, 800))
    shadow, states = window.model.shadow, length(200, 2)
    began, used = time.perf_counter(), time.process_time()
    window.go(Tab.SHADOW)
    qtbot.wait(length(1000, 50))
    opened = (time.process_time() - used) / (time.perf_counter() - began)
    page = window.open_page(Tab.SHADOW)
    drawn = {}
    for model in ("full", "reduced"):
        began = time.process_time()
        for k in range(states):
            shadow.model.state(pressure_kpa=20.0 + 5.0 * math.sin(k / 30), model=model)
        drawn[f"{model} model"] = (time.process_time() - began) / states

    def pane():
        page.pane.draw()
        page.pane.view.repaint()

    def whole():
        pane()
        page.refresh(window.model.snapshot)
        page.repaint()

    for name, draw in (("pane", pane), ("page", whole)):
        used_s, at_s = 0.0, HOUR_S
        for _ in range(FRAMES):
            at_s = feed(ring, 2, at_s)
            began = time.process_time()
            draw()
            used_s += time.process_time() - began
        drawn[name] = used_s / FRAMES
    with capsys.disabled():
        print(f"\nshadow, opened: {opened:.2f} of a core in its first second")
        for name, seconds in drawn.items():
            print(f"  {name:14} {1000 * seconds:7.2f} ms of CPU time a frame, {1 / seconds:8.0f} frames/s")
    assert all(seconds > 0 for seconds in drawn.values())


def test_whole_hour_in_pyqtgraph(qtbot, tmp_path, capsys):
    """The same hour given to pyqtgraph whole, with autorange: the pyramid's gain."""
    import pyqtgraph as pg

    window, ring = window_on(qtbot, tmp_path, (1280, 800))
    window.model.live.set_window(HOUR_S)
    began = time.process_time()
    for _ in range(DRAWN):
        window.live.plots._whole_until_s = -math.inf
        window.live.draw()
        window.live.plots.view.viewport().repaint()
    ours = (time.process_time() - began) / DRAWN
    plain = pg.GraphicsLayoutWidget()
    qtbot.addWidget(plain)
    curves = [plain.addPlot(row=i, col=0).plot() for i in range(3)]
    plain.resize(800, 400)
    plain.show()
    qtbot.waitExposed(plain)
    columns = ring.view()
    qtbot.wait(50)
    began = time.process_time()
    for _ in range(WHOLE_DRAWN):
        for curve, name in zip(curves, ("s1_mv", "s2_mv", "pressure_kpa"), strict=True):
            curve.setData(columns["time_s"], columns[name])
        plain.viewport().repaint()
    whole = (time.process_time() - began) / WHOLE_DRAWN
    with capsys.disabled():
        ratio = whole / ours
        print(f"\nan hour at 100 Hz: {1000 * ours:.2f} ms a frame, whole {1000 * whole:.0f} ms, ratio {ratio:.0f}")
    assert ours > 0


def window_on_a_board(qtbot, tmp_path, monkeypatch, rate_hz=100):
    """The window as `run` opens it, on a virtual board in another process; the shadow is not prepared."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    from boat_daq.gui.app import Collector, make_application, make_window

    make_application()
    window = make_window(rate_hz)
    Collector(window, window.page_made)
    qtbot.addWidget(window)
    window.show()
    model = window.model
    model.shadow.prepare = lambda: None
    model.connection.start_virtual_board()
    qtbot.waitUntil(model.connected, timeout=20_000)
    qtbot.waitUntil(model.live.has_data, timeout=5000)
    return window


def shares(qtbot, seconds):
    """Shares of a core over so long: the process, and of it the window's thread."""
    began, used, own = time.perf_counter(), time.process_time(), time.thread_time()
    qtbot.wait(round(1000 * length(seconds, 0.3)))
    wall = time.perf_counter() - began
    return (time.process_time() - used) / wall, (time.thread_time() - own) / wall


def test_at_rest(qtbot, tmp_path, monkeypatch, capsys):
    """A minute's window on a board that streams at 100 Hz: share of a core, and from a byte's arrival to the paint."""
    window = window_on_a_board(qtbot, tmp_path, monkeypatch)
    model = window.model
    qtbot.wait(length(4000, 50))
    share, own = shares(
        qtbot, 8.0
    )  # the window as it is; below, each picture is painted once more, at once, to see when
    arrived_ns: list[int] = []
    model.session.live.add_sink(lambda samples: arrived_ns.append(int(samples["host_ns"][-1])))
    taken, lags = 0, []
    window.frame_timer.timeout.disconnect()

    def draw():
        nonlocal taken
        waiting, taken = arrived_ns[taken:], len(arrived_ns)
        window.draw()
        window.live.plots.view.viewport().repaint()
        lags.extend((time.monotonic_ns() - at) / 1e6 for at in waiting)

    window.frame_timer.timeout.connect(draw)
    qtbot.wait(length(1500, 50))
    lags.clear()
    qtbot.wait(length(8000, 500))
    with capsys.disabled():
        print(
            f"\nat rest: {100 * share:.1f} % of one core ({share / REST_SHARE:.2f} of the limit), the window's thread"
            f" {100 * own:.1f} %; byte to pixel: median {statistics.median(lags):.1f} ms,"
            f" 99 % {np.percentile(lags, 99):.1f} ms"
        )
    assert lags
    window.close()


@pytest.mark.parametrize("where", length(["minimised", "Recordings", "Optics"], ["minimised"]))
def test_at_rest_out_of_sight(qtbot, tmp_path, monkeypatch, capsys, where):
    """The same board while its plots are hidden."""
    window = window_on_a_board(qtbot, tmp_path, monkeypatch)
    if where == "minimised":
        window.showMinimized()
    else:
        window.go(where)
    qtbot.wait(length(6000, 100))  # a page's first look at what it shows
    share, own = shares(qtbot, 6.0)
    with capsys.disabled():
        print(
            f"\nat rest, {where}: {100 * share:.1f} % of one core ({share / REST_SHARE:.2f} of the limit),"
            f" the window's thread {100 * own:.1f} %"
        )
    assert 0.0 < own < share
    window.close()


@pytest.mark.parametrize("span_s", length([10.0, 60.0], [10.0]))
def test_ten_kilohertz(qtbot, tmp_path, monkeypatch, capsys, span_s):
    """As `boat-daq gui --board --rate 10000`, recording: what a frame costs, how many come, and whether all arrives."""
    window = window_on_a_board(qtbot, tmp_path, monkeypatch, 10_000)
    model = window.model
    window.resize(1280, 800)
    model.run.toggle_recording()
    model.live.set_window(span_s)
    qtbot.wait(length(round(1000 * min(span_s, 20.0)), 300))
    window.frame_timer.timeout.disconnect()
    wall, cpu, at = [], [], []

    def draw():
        began, used = time.perf_counter(), time.thread_time()
        window.draw()
        window.live.plots.view.viewport().repaint()
        at.append(began)
        wall.append(1000 * (time.perf_counter() - began))
        cpu.append(1000 * (time.thread_time() - used))

    window.frame_timer.timeout.connect(draw)
    share, own = shares(qtbot, 8.0)
    health = model.session.snapshot().health
    with capsys.disabled():
        print(
            f"\n10 kHz, {span_s:g} s shown: a frame median {statistics.median(wall):.2f} ms, 99 % "
            f"{np.percentile(wall, 99):.2f} ms (CPU of its thread {statistics.median(cpu):.2f}, 99 % "
            f"{np.percentile(cpu, 99):.2f}); {len(at) / 8.0:.0f} frames/s, "
            f"longest pause {1000 * max(np.diff(at)):.0f} ms; "
            f"{100 * share:.0f} % of one core, the window's thread {100 * own:.0f} %; "
            f"{health.rate_hz:.0f} Hz, {health.statistics.lost} lost, {health.lag_ms:.0f} ms behind"
        )
    assert not WHOLE or health.statistics.lost == 0
    window.close()


def test_window_up(capsys):
    """Seconds from the start of the interpreter to a painted window."""
    script = (
        "from boat_daq.gui.app import make_application, make_window\n"
        "app = make_application(); window = make_window(); window.show(); app.processEvents(); window.grab()\n"
        "import os, sys; sys.stdout.write('up'); sys.stdout.flush(); os._exit(0)"
    )
    seconds = []
    for _ in range(length(3, 1)):
        began = time.perf_counter()
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, cwd=Path.cwd(), check=False)
        seconds.append(time.perf_counter() - began)
        assert done.stdout == b"up", done.stderr
    with capsys.disabled():
        print(f"\nwindow up in {min(seconds):.2f} s (best of 3), {max(seconds):.2f} s (worst)")
