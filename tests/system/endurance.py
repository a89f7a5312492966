"""The window for hours of board time on a fast virtual board: memory, frames, and not a sample lost.

    python -m tests.system.endurance --hours 8 --speed 100

Offscreen, in a home and folder of its own. The board streams and is recorded; the pressure goes up and down all the
time; halfway the window's thread is blocked for `--block` seconds. Every tenth of a board hour a line goes to standard
output: resident memory, frames drawn and what they cost. The last line is JSON; `test_endurance.py` judges it.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import numpy as np
from PySide6.QtTest import QTest

from protocol.recording import open_recording

PRESSURES_KPA = (45.0, -35.0)


def resident_mb() -> float:
    """Resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Watch:
    """Draws the window's frames and keeps what each cost."""

    def __init__(self, window) -> None:
        self.window = window
        self.frames_ms: list[float] = []
        self.cpu_ms: list[float] = []  # of the window's thread: what a frame costs on a busy computer, too
        self.refreshes_ms: list[float] = []
        window.frame_timer.timeout.disconnect()
        window.frame_timer.timeout.connect(self.draw)
        window.calm_timer.timeout.disconnect()
        window.calm_timer.timeout.connect(self.refresh)

    def forget(self) -> None:
        """Begin anew: the first frames make fonts and caches."""
        for costs in (self.frames_ms, self.cpu_ms, self.refreshes_ms):
            costs.clear()

    def draw(self) -> None:
        """One frame, painted at once so that its whole cost is seen."""
        began, used = time.perf_counter(), time.thread_time()
        self.window.draw()
        self.window.live.plots.view.viewport().repaint()
        self.window.live.shadow.view.repaint()
        self.frames_ms.append(1000 * (time.perf_counter() - began))
        self.cpu_ms.append(1000 * (time.thread_time() - used))

    def refresh(self) -> None:
        """The figures, a few times a second."""
        began = time.perf_counter()
        self.window.refresh()
        self.refreshes_ms.append(1000 * (time.perf_counter() - began))


def recorded(path: Path) -> dict[str, int]:
    """How many samples the recording has, how many the board's clock says it should have, and the gaps."""
    with closing(open_recording(path)) as db:
        (samples,) = db.execute("SELECT sum(n) FROM block").fetchone()
        spans = db.execute("SELECT min(first_time_us), max(last_time_us) FROM block GROUP BY segment").fetchall()
        (gaps,) = db.execute("SELECT count(*) FROM event WHERE kind = 'gap'").fetchone()
    return {
        "samples": samples,
        "expected": sum(round((last - first) / 10_000) + 1 for first, last in spans),
        "gaps": gaps,
    }


def run(hours: float, speed: float, block_s: float, window_s: float) -> dict[str, object]:
    """Run it; returns what was measured."""
    from boat_daq.gui.app import make_application, make_window, spare_the_collector

    app = make_application()
    window = make_window()
    spare_the_collector(window)
    window.resize(1280, 800)
    window.show()
    desk, watch = window.desk, Watch(window)
    desk.shadow.prepare()
    board = subprocess.Popen(
        [sys.executable, "-m", "boat_daq", "board", "--pty", "--speed", f"{speed:g}"], stdout=subprocess.PIPE, text=True
    )
    assert board.stdout is not None
    try:
        desk.connection.connect(board.stdout.readline().strip())
        until(desk.connected, "the board")
        until(lambda: desk.shadow.model is not None, "the shadow", 300)
        window.live.set_window(window_s)
        path = desk.record()
        QTest.qWait(1000)
        watch.forget()
        began_s, began_wall = desk.snapshot.last.time_s, time.perf_counter()
        lines, target, next_line, blocked = [], 0, 0.0, False
        while (passed := desk.snapshot.last.time_s - began_s) < hours * 3600:
            QTest.qWait(100)
            target = steer(desk, target)
            if passed >= hours * 1800 and not blocked:
                blocked = True
                time.sleep(block_s)
            if passed >= next_line:
                next_line += 360.0
                lines.append(told(passed, watch))
        lines.append(told(passed, watch))
        result = {
            "hours": hours, "speed": speed, "blocked_s": block_s, "wall_s": round(time.perf_counter() - began_wall, 1),
            "cpu_s": round(time.process_time(), 1), "memory_mb": lines, "frames": len(watch.frames_ms),
            "frame_median_ms": round(statistics.median(watch.frames_ms), 2),
            "frame_p99_ms": round(float(np.percentile(watch.frames_ms, 99)), 2),
            "frame_cpu_p99_ms": round(float(np.percentile(watch.cpu_ms, 99)), 2),
            "frame_worst_ms": round(max(watch.frames_ms), 1), "refresh_worst_ms": round(max(watch.refreshes_ms), 1),
            "lost": desk.snapshot.health.statistics.lost, "strip": window.strip.text.text(),
        }  # fmt: skip
        desk.session.stop_recording()
        window.close()
        app.processEvents()
        return {**result, **recorded(path)}
    finally:
        board.kill()
        board.wait()


def steer(desk, target: int) -> int:
    """Ask for the other pressure once the one before has been reached; returns which one is asked for."""
    last = desk.snapshot.last
    wanted = PRESSURES_KPA[target % 2]
    if np.isnan(last.target_kpa) or abs(last.pressure_kpa - wanted) < 1.0:
        target += 1
        desk.set_pressure(f"{PRESSURES_KPA[target % 2]:g}", "5")
    return target


def told(passed_s: float, watch: Watch) -> tuple[float, float]:
    """Print a line; returns board hours and memory."""
    recent = watch.frames_ms[-500:] or [0.0]
    megabytes = resident_mb()
    print(
        f"{passed_s / 3600:6.1f} h  {megabytes:7.1f} MB  {len(watch.frames_ms):7d} frames  "
        f"median {statistics.median(recent):5.2f} ms  99 % {np.percentile(recent, 99):5.2f} ms  "
        f"worst so far {max(watch.frames_ms, default=0.0):6.1f} ms",
        flush=True,
    )
    return round(passed_s / 3600, 2), round(megabytes, 1)


def until(condition, what: str, timeout_s: float = 60.0) -> None:
    """Wait for `condition`."""
    end = time.perf_counter() + timeout_s
    while not condition():
        if time.perf_counter() > end:
            raise SystemExit(f"waited in vain for: {what}")
        QTest.qWait(50)


def main() -> None:
    """Read the arguments, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=2.0, help="of board time")
    parser.add_argument("--speed", type=float, default=100.0, help="board time over wall time")
    parser.add_argument("--block", type=float, default=10.0, help="seconds for which the window's thread is blocked")
    parser.add_argument("--window", type=float, default=600.0, help="seconds of signal shown")
    chosen = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with tempfile.TemporaryDirectory(prefix="endurance-") as folder:
        os.environ["BOAT_DAQ_HOME"] = folder
        os.environ["PYTHONPATH"] = str(Path(__file__).resolve().parents[2])
        os.chdir(folder)
        print(json.dumps(run(chosen.hours, chosen.speed, chosen.block, chosen.window)), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main()
