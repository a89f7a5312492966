"""What recording costs: a minute at 10,000 samples/s from a board in another process; a day summed up; a drawing."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from boat_daq.engine.display.ring_buffer import MinMaxPyramid, RingBuffer
from boat_daq.engine.link.block import Block
from boat_daq.engine.link.health import LinkHealth
from boat_daq.engine.link.ports import open_transport
from boat_daq.engine.link.reader import PortReader
from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.rows import RowMaker
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.sample_columns import mv_per_count
from protocol import Connection, Identify, Samples, Start
from protocol.recording import RunEnd, describe_dtype, sample_dtype
from tests.benchmarks.lengths import length
from tests.boat_daq.engine.board_link import Seen, meta_of


@contextmanager
def served_board(*options: str) -> Iterator[str]:
    """A board in a process of its own; gives its port."""
    command = [sys.executable, "-m", "boat_daq", "board", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as board:
        assert board.stdout is not None
        yield board.stdout.readline().strip()
        board.terminate()


@pytest.mark.parametrize(
    ("carrier", "rate_hz", "speed", "seconds"),
    length(
        [("--pty", 10_000, 1, 60), ("--pty", 100, 1, 20), ("--pty", 100, 100, 20), ("tcp", 10_000, 1, 20)],
        [("tcp", 10_000, 1, 1)],
    ),
)
def test_recording(tmp_path, capsys, carrier, rate_hz, speed, seconds):
    """All sinks of a session at work: recorder, ring, health; CPU of this process, samples lost, commits' lag."""
    options = ["--pty"] if carrier == "--pty" else ["--tcp", "127.0.0.1:0"]
    with served_board(*options, "--speed", str(speed)) as port:
        link, seen = Connection(), Seen()
        acquisition = PortReader(open_transport(port), link)
        acquisition.add_sink(seen)
        acquisition.start()
        acquisition.send(Identify())
        assert seen.wait(object)
        while link.hello is None:
            time.sleep(0.01)
        acquisition.remove_sink(seen)
        meta = meta_of(link, rate_hz=rate_hz)
        health = LinkHealth(lambda: acquisition.statistics, asked_hz=rate_hz, real_time=speed == 1)
        recorder = Recorder(tmp_path / "run.boat", meta, health=health.snapshot)
        health.lag_ms = lambda: recorder.lag_ms
        acquisition.add_sink(RingBuffer(2, mv_per_count=mv_per_count(meta)))
        acquisition.add_sink(health)
        acquisition.add_recorder(recorder)
        acquisition.send(Start(rate_hz))
        cpu, end, lags = time.process_time(), time.monotonic() + seconds, []
        while time.monotonic() < end:
            time.sleep(0.5)
            lags.append(recorder.lag_ms)
        cpu = time.process_time() - cpu
        acquisition.stop()
        statistics = acquisition.statistics
        path = recorder.close(RunEnd.FINISHED)
    summary, verdict = summarise(path), verify_recording(path)
    with capsys.disabled():
        print(
            f"\n{rate_hz} Hz at {speed}x over {carrier.strip('-')}, {seconds} s: {summary.samples} samples, "
            f"{statistics.lost} lost, {statistics.crc_errors} damaged; CPU {100 * cpu / seconds:.1f} % of a core, "
            f"lag median {np.median(lags):.0f} ms, worst {max(lags):.0f} ms; {summary.size_bytes / 1e6:.1f} MB; "
            f"verified {verdict.samples / verdict.seconds:,.0f} samples/s"
        )
    assert verdict.identical
    assert summary.samples == statistics.samples


def test_a_day(tmp_path, capsys):
    """A day at 100 Hz, 8.64 million samples, one read a sample: how long `info` and `verify`'s overview take."""
    path, n_day, step = tmp_path / "day.boat", length(8_640_000, 20_000), 10
    dtype = sample_dtype(2)
    meta = {"n_sensors": 2, "sample_kind": "counts", "vref_mv": 3300, "adc_bits": 12, "rate_hz": 100, "simulated": True}
    file, maker = RecordingFile.create(path, meta), RowMaker({**meta, "sample_dtype": describe_dtype(dtype)})
    samples = np.zeros(step * 1000, dtype)
    samples["lit"] = np.random.default_rng(0).integers(1000, 2000, (len(samples), 2))
    index = np.arange(len(samples))
    statements = []
    for start in range(0, n_day, len(samples)):
        samples["index"] = start + index
        samples["time_us"] = (start + index) * 10_000
        for at in range(0, len(samples), step):
            part = samples[at : at + step].copy()
            statements.extend(maker.block(Block(start + at, bytes(340), events=(Samples(part),))))
            statements.extend(maker.flush())
        file.commit(statements)
        statements = []
    file.commit(maker.flush(last=True))
    file.close()
    began = time.perf_counter()
    summary = summarise(path)
    seconds = time.perf_counter() - began
    with capsys.disabled():
        print(f"\na day of {summary.samples} samples, {summary.size_bytes / 1e6:.0f} MB: summed up in {seconds:.3f} s")
    assert summary.samples == n_day


def test_drawing(capsys):
    """A span of a day from the pyramid, beside extremes taken from all samples."""
    n = length(8_640_000, 43_200)
    entries = np.vstack([np.arange(n) * 0.01, np.random.default_rng(0).normal(size=(4, n)).cumsum(axis=1)])
    pyramid = MinMaxPyramid(5, 360_000)
    began = time.perf_counter()
    for start in range(0, n, 100):
        pyramid.append(entries[:, start : start + 100])
    fed = time.perf_counter() - began
    began = time.perf_counter()
    for _ in range(length(100, 1)):
        drawn = pyramid.draw(-np.inf, np.inf, 4_000)
    quick = (time.perf_counter() - began) / length(100, 1)
    began = time.perf_counter()
    folded = entries[:, : n - n % 4320].reshape(5, -1, 4320)
    plain = np.stack([folded.min(axis=2), folded.max(axis=2)])
    slow = time.perf_counter() - began
    with capsys.disabled():
        print(
            f"\na day drawn with {drawn.shape[1]} points in {quick * 1e3:.2f} ms, "
            f"from all samples in {slow * 1e3:.0f} ms (ratio {slow / quick:.0f}); "
            f"feeding costs {fed / n * 1e6:.2f} us a sample"
        )
    assert drawn[1].max() >= plain[1, 1].max()
