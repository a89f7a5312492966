"""LSL: an inlet on this computer receives every sample with its value and time; one that does not read harms nobody."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import protocol
from analysis import load_recording
from boat_daq.engine.outlets import lsl
from boat_daq.engine.plan import Plan
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from protocol.base.errors import RequestError
from tests.boat_daq.engine.other_devices import TextBoard
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached

pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed", exc_type=(ImportError, RuntimeError))
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="streams kept on this computer need Linux")

PROFILE = Path(protocol.__file__).parent / "profiles" / "delimited_lines.toml"
PLAN = Plan("short", "staircase", 1, high_kpa=10.0, low_kpa=0.0, step_kpa=10.0, ramp_kpa_per_s=40.0)


@contextmanager
def streaming(
    tmp_path: Path, rate_hz: int, board: Any, profile: str | None = None, **options: Any
) -> Iterator[tuple[Session, lsl.LslOutlet]]:
    """Record and stream from a board."""
    with board as served:
        session = Session(Settings(), UnitLibrary(tmp_path / "units"))
        try:
            session.connect(served.url, profile, rate_hz=rate_hz, record_to=tmp_path / "run.boat")
            session.wait_connected()
            reached(session, lambda s: session.live.ring is not None, 5)
            outlet = lsl.LslOutlet(session, pylsl, **options)
            yield session, outlet
            outlet.close()
        finally:
            session.close()


@contextmanager
def inlet_of(outlet: lsl.LslOutlet, kind: str) -> Iterator[Any]:
    """Open an inlet of a stream, and close it before its outlet: one without an outlet seeks it as the process ends."""
    found = pylsl.resolve_byprop("source_id", f"{outlet.source_id} {kind}", timeout=10)
    inlet = pylsl.StreamInlet(found[0], max_buflen=60)
    inlet.open_stream(timeout=10)
    try:
        yield inlet
    finally:
        inlet.close_stream()
        del inlet


def pulled(inlet: Any, seconds: float, session: Session) -> tuple[np.ndarray, np.ndarray]:
    """Return values and LSL times of all that arrives within `seconds` of recorded board time."""
    values: list[Any] = []
    times: list[float] = []
    end, latest = session.snapshot().recorded_s + seconds, time.monotonic() + 2 * seconds + 30
    while session.snapshot().recorded_s < end or not values:
        assert time.monotonic() < latest, "the recording has ended"
        chunk, stamps = inlet.pull_chunk(timeout=0.1, max_samples=20_000)
        values += chunk
        times += stamps
    return np.array(values), np.array(times)


def compare(tmp_path: Path, values: np.ndarray, sensors: int = 2) -> int:
    """Assert that the values are consecutive rows of the recording; return how many they are."""
    run = load_recording(tmp_path / "run.boat")
    rows = np.column_stack([run.signal_mv, run.pressure_kpa])
    streamed = values[:, : sensors + 1]
    starts = np.flatnonzero((rows == streamed[0]).all(axis=1))
    matches = [at for at in starts if np.array_equal(rows[at : at + len(streamed)], streamed)]
    assert len(matches) == 1
    return len(streamed)


def test_an_inlet_receives_every_sample_and_marker(tmp_path: Path) -> None:
    """Values as recorded, elongation by the calibration, stamps evenly spaced, markers of the run; metadata."""

    def halves(signal_mv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return signal_mv.mean(axis=1) / 2, np.full(len(signal_mv), 0.25)

    board = serve_in_thread(BoardSettings(speed=5.0))
    with (
        streaming(tmp_path, 100, board, convert=halves, calibration_id="SA1 2026-11-01") as (session, outlet),
        inlet_of(outlet, "BOAT") as inlet,
        inlet_of(outlet, "Markers") as markers,
    ):
        about = inlet.info(timeout=10)
        session.arm(PLAN)
        session.start()
        values, times = pulled(inlet, 6.0, session)
        told = [json.loads(marker[0]) for marker in markers.pull_chunk(timeout=1.0, max_samples=1000)[0]]
    assert compare(tmp_path, values) >= 500
    np.testing.assert_array_equal(values[:, 4], values[:, :2].mean(axis=1) / 2)
    assert set(values[:, 5]) == {0.25}
    assert np.diff(times).min() > 0
    assert 0.9 * 0.01 / 5.0 < np.median(np.diff(times[100:])) < 0.01  # a busy computer slows the virtual board down
    assert {"step", "event"} <= {marker["kind"] for marker in told}
    described = about.as_xml()
    for text in ("<unit>mV</unit>", "<unit>kPa</unit>", "SA1 2026-11-01", "<simulated>true</simulated>"):
        assert text in described


def test_extra_channels_are_streamed_with_their_units(tmp_path: Path) -> None:
    """Behind the usual channels, as the recording has them."""
    with (
        streaming(tmp_path, 100, closing(TextBoard()), str(PROFILE)) as (session, outlet),
        inlet_of(outlet, "BOAT") as inlet,
    ):
        described = inlet.info(timeout=10).as_xml()
        values, _ = pulled(inlet, 1.0, session)
    assert len(values) >= 50
    run = load_recording(tmp_path / "run.boat")
    rows = run.channel
    first = int(np.flatnonzero(rows[:, 0] == values[0, 6])[0])
    np.testing.assert_array_equal(values[:, 6:], rows[first : first + len(values)])
    assert "<label>temperature_degc</label>\n\t\t\t\t<unit>degC</unit>" in described


def test_sockets_are_bound_to_the_loopback_device(tmp_path: Path) -> None:
    """liblsl listens on every interface: what it opened accepts nothing from a network."""
    with streaming(tmp_path, 100, serve_in_thread(BoardSettings())) as (_, _outlet):
        bound, listening = [], 0
        for number in lsl._sockets(Path("/proc/self/fd")):
            with socket.socket(fileno=os.dup(number)) as one:
                if one.family is socket.AF_INET and one.type is socket.SOCK_STREAM:
                    device = one.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16).rstrip(b"\0")
                    if one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                        listening += 1
                        bound.append(device)
    assert listening >= 2
    assert set(bound) == {b"lo"}


def test_an_outlet_before_the_first_sample_is_refused(tmp_path: Path) -> None:
    session = Session(Settings(), UnitLibrary(tmp_path))
    with pytest.raises(RequestError, match="no sample has arrived"):
        lsl.LslOutlet(session, pylsl)
    session.close()


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("rate_hz", "seconds"), [(100, 600.0), (10_000, 60.0)])
def test_long_streams_lose_nothing(tmp_path: Path, rate_hz: int, seconds: float) -> None:
    """Ten minutes at 100 Hz and one at 10 kHz, beside an inlet that never reads: every sample, no lag of the reader."""
    with streaming(tmp_path, rate_hz, serve(BoardSettings())) as (session, outlet):
        with inlet_of(outlet, "BOAT"), inlet_of(outlet, "BOAT") as inlet:
            values, _ = pulled(inlet, seconds, session)
        health, clock = session.snapshot().health, outlet.clock
    n = compare(tmp_path, values)
    print(f"{rate_hz} Hz: {n} samples in the inlet, {outlet.skipped} skipped, clock {clock}")
    assert n > 0.98 * rate_hz * seconds
    assert outlet.skipped == 0
    assert health is not None
    assert health.statistics.lost == 0
    assert load_recording(tmp_path / "run.boat").lost == 0
