"""The window for hours of board time on a fast virtual board: memory, frames, and not a sample lost.

    python -m tests.system.endurance --hours 24 --speed 100

Offscreen, in a home and folder of its own. The board streams and is recorded; the pressure alternates all the
time; halfway the window's thread is blocked for `--block` seconds. Every tenth of a board hour a line is printed:
resident memory, frames drawn and their cost. At the end come the measurements as JSON, then a line for each criterion:
met or failed, with the figure. The exit code is 1 where one failed.
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
from array import array
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtTest import QTest

from boat_daq.engine.recording.verify import verify_recording
from protocol.recording import open_recording

PRESSURES_KPA = (45.0, -35.0)
GROWTH = 1.05  # of the first hour's memory
WORST_FRAME_MS = 100.0


def resident_mb() -> float:
    """Return the resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Watch:
    """Draws the window's frames and stores the cost of each."""

    def __init__(self, window) -> None:
        self.window = window
        self.frames_ms = array("d")  # compact: it would count as the window's growth
        self.cpu_ms = array("d")  # of the window's thread: what a frame costs on a busy computer, too
        self.refreshes_ms = array("d")
        window.frame_timer.timeout.disconnect()
        window.frame_timer.timeout.connect(self.draw)
        window.calm_timer.timeout.disconnect()
        window.calm_timer.timeout.connect(self.refresh)

    def forget(self) -> None:
        """Drop the costs so far: the first frames fill font and other caches."""
        for costs in (self.frames_ms, self.cpu_ms, self.refreshes_ms):
            del costs[:]

    def draw(self) -> None:
        """Draw a frame, painted at once so that its whole cost is measured."""
        began, used = time.perf_counter(), time.thread_time()
        self.window.draw()
        self.window.live.plots.view.viewport().repaint()
        self.window.live.shadow.view.repaint()
        self.frames_ms.append(1000 * (time.perf_counter() - began))
        self.cpu_ms.append(1000 * (time.thread_time() - used))

    def refresh(self) -> None:
        """Refresh the figures, a few times a second."""
        began = time.perf_counter()
        self.window.refresh()
        self.refreshes_ms.append(1000 * (time.perf_counter() - began))


def recorded(path: Path) -> dict[str, int]:
    """Return the number of recorded samples, that expected by the board's clock, and that of the gaps."""
    with closing(open_recording(path)) as db:
        (samples,) = db.execute("SELECT sum(n) FROM block").fetchone()
        spans = db.execute("SELECT min(first_time_us), max(last_time_us) FROM block GROUP BY segment").fetchall()
        (gaps,) = db.execute("SELECT count(*) FROM event WHERE kind = 'gap'").fetchone()
    return {
        "samples": samples,
        "expected": sum(round((last - first) / 10_000) + 1 for first, last in spans),
        "gaps": gaps,
    }


def criteria_of(result: dict[str, Any]) -> list[tuple[str, bool | None, str]]:
    """Return each criterion of a run: its text, whether it is met (None: not determined), the figures."""
    first = [mb for hour, mb in result["memory_mb"] if hour <= 1.01]
    later = [mb for hour, mb in result["memory_mb"] if hour > 1.01]
    growth = f"first hour {max(first):.1f} MB"
    if later:
        growth += f", later {max(later):.1f} MB at most, {later[-1]:.1f} MB at the end, {max(later) / max(first):.3f}"
    worst, lost = max(result["frame_worst_ms"], result["refresh_worst_ms"]), result["lost"]
    processor = f", {result['frame_cpu_worst_ms']:.1f} ms of its thread's processor time at most"
    counted = f"{result['samples']} of {result['expected']}, {lost} lost, {result['gaps']} gaps"
    exact = result["samples"] == result["expected"] and lost == 0 and result["gaps"] == 0
    return [
        ("memory within 5 % of its first hour", max(later) <= GROWTH * max(first) if later else None, growth),
        ("no frame over 100 ms", worst <= WORST_FRAME_MS, f"worst {worst:.1f} ms of {result['frames']}{processor}"),
        ("every sample recorded", exact, counted),
        ("the file is identical to its bytes", not result["difference"], result["difference"] or "identical"),
    ]


def print_criteria(result: dict[str, Any]) -> bool:
    """Print the criteria and return whether none failed."""
    found = criteria_of(result)
    for what, kept, figures in found:
        print(f"{'undetermined' if kept is None else 'met' if kept else 'FAILED':12s} {what}: {figures}", flush=True)
    return all(kept is not False for _, kept, _ in found)


def run(hours: float, speed: float, block_s: float, window_s: float) -> dict[str, Any]:
    """Run the window and return the measurements."""
    from boat_daq.gui.app import Collector, make_application, make_window

    app = make_application()
    window = make_window()
    Collector(window, window.page_made)
    window.resize(1280, 800)
    window.show()
    model, watch = window.model, Watch(window)
    model.shadow.prepare()
    board = subprocess.Popen(
        [sys.executable, "-m", "boat_daq", "board", "--pty", "--speed", f"{speed:g}"], stdout=subprocess.PIPE, text=True
    )
    assert board.stdout is not None
    try:
        model.connection.connect(board.stdout.readline().strip())
        until(model.connected, "the board")
        until(lambda: model.shadow.model is not None, "the shadow", 300)
        window.live.model.set_window(window_s)
        path = model.run.record()
        QTest.qWait(1000)
        watch.forget()
        began_s, began_wall = model.snapshot.last.time_s, time.perf_counter()
        lines, target, next_line, blocked = [], 0, 0.0, False
        while (passed := model.snapshot.last.time_s - began_s) < hours * 3600:
            QTest.qWait(100)
            target = steer(model, target)
            if passed >= hours * 1800 and not blocked:
                blocked = True
                time.sleep(block_s)
            if passed >= next_line:
                next_line += 360.0
                lines.append(report_line(passed, watch))
        lines.append(report_line(passed, watch))
        result = {
            "hours": hours, "speed": speed, "blocked_s": block_s, "wall_s": round(time.perf_counter() - began_wall, 1),
            "cpu_s": round(time.process_time(), 1), "memory_mb": lines, "frames": len(watch.frames_ms),
            "frame_median_ms": round(statistics.median(watch.frames_ms), 2),
            "frame_p99_ms": round(float(np.percentile(watch.frames_ms, 99)), 2),
            "frame_cpu_p99_ms": round(float(np.percentile(watch.cpu_ms, 99)), 2),
            "frame_worst_ms": round(max(watch.frames_ms), 1), "frame_cpu_worst_ms": round(max(watch.cpu_ms), 1),
            "refresh_worst_ms": round(max(watch.refreshes_ms), 1),
            "lost": model.snapshot.health.statistics.lost, "strip": window.strip.text.text(),
        }  # fmt: skip
        model.session.stop_recording()
        window.close()
        app.processEvents()
        return {**result, **recorded(path), "difference": verify_recording(path).difference}
    finally:
        board.kill()
        board.wait()


def steer(model, target: int) -> int:
    """Request the other pressure once the one before is reached; return the index of the one requested."""
    last = model.snapshot.last
    wanted = PRESSURES_KPA[target % 2]
    if np.isnan(last.target_kpa) or abs(last.pressure_kpa - wanted) < 1.0:
        target += 1
        model.sequence.set_pressure(f"{PRESSURES_KPA[target % 2]:g}", "5")
    return target


def report_line(passed_s: float, watch: Watch) -> tuple[float, float]:
    """Print a line and return board hours and memory."""
    recent = watch.frames_ms[-500:] or array("d", [0.0])
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
            raise SystemExit(f"timed out waiting for: {what}")
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
        result = run(chosen.hours, chosen.speed, chosen.block, chosen.window)
        print(json.dumps(result), flush=True)
        kept = print_criteria(result)
    os._exit(0 if kept else 1)


if __name__ == "__main__":
    main()
