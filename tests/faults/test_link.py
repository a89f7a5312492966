"""Faults of the link and the device, through the program and a real pseudo-terminal."""

from __future__ import annotations

import dataclasses
import random
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, Unit, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import LinkState, LinkWarningCode, MessageKind, RunEnding, SessionState
from protocol import Connection, SampleGap, Samples
from protocol.link.messages import Heartbeat, SetPressure, Stop, Vent
from protocol.recording import RunEnd, SampleFlag, open_recording
from tests.faults.drill import OVER, ROOT, SHORT, VOLT_MV, Drill, drill, needs_pty
from tests.protocol.link.streams import HELLO, sample, stream

pytestmark = needs_pty
LONG = dataclasses.replace(SHORT, cycles=4)


def damaged(data: bytes, share: float, rng: random.Random) -> bytes:
    """Return `data` with that share of its bytes flipped in one bit, removed or doubled."""
    out = bytearray()
    last = 0
    for _ in range(round(len(data) * share)):
        at = rng.randrange(last, min(len(data), last + round(2 / share)))
        out += data[last:at]
        byte = data[at : at + 1]
        out += rng.choice((bytes([byte[0] ^ 1 << rng.randrange(8)]), b"", byte * 2))
        last = at + 1
        if last >= len(data):
            break
    return bytes(out + data[last:])


def count_losses(frames: int, share: float) -> None:
    """Decode that many damaged frames: every sample that arrives was sent, every other is counted as lost."""
    rng = random.Random(frames)
    link = Connection()
    link.receive(stream(HELLO), 0)
    delivered = lost = first = last = 0
    for start in range(0, frames, 5_000):
        whole = start in (0, frames - 5_000)  # the first and the last arrive, so that losses between them are known
        ends = stream(sample(start)) if start == 0 else b"", stream(sample(start + 4_999)) if whole and start else b""
        body = stream(*(sample(i) for i in range(start + (start == 0), start + 5_000 - bool(ends[1]))))
        for event in link.receive(ends[0] + damaged(body, share, rng) + b"\0" + ends[1], 0):
            if isinstance(event, SampleGap):
                lost += event.lost
            if isinstance(event, Samples):
                rows, index = event.array, event.array["index"].astype(np.int64)
                delivered, last = delivered + len(rows), int(index[-1])
                assert (rows["time_us"] == index * 10_000).all()
                assert (rows["pressure_pa"] == 12_345).all()
                assert (rows["lit"] == np.stack([2000 + index % 7, np.full(len(index), 2100)], axis=1)).all()
                assert (rows["dark"] == [40, 50]).all()
    assert (first, last) == (0, frames - 1)
    assert delivered + lost == frames
    assert lost == link.statistics.lost > 0.01 * frames
    assert link.statistics.duplicates == 0


@pytest.mark.fault(1, how="1e-3 of the bytes of 50,000 frames flipped, lost or doubled", times=50_000)
def test_losses_are_counted_exactly() -> None:
    """No wrong sample; delivered and lost samples add up to those sent."""
    count_losses(50_000, 1e-3)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.fault(1, how="1e-3 of the bytes of 1e6 frames flipped, lost or doubled", times=1_000_000)
def test_losses_of_a_million_frames_are_counted_exactly() -> None:
    """The same with a million frames."""
    count_losses(1_000_000, 1e-3)


@pytest.mark.fault(2, how="every byte of 30 frames lost, one at a time, from the bytes of a session", times=900)
def test_every_single_byte_deletion_resynchronises_within_one_frame() -> None:
    """The damaged sample is lost and counted, the next delivered; a removed delimiter loses the next one too."""
    head, body = stream(HELLO, sample(0)), stream(*(sample(i) for i in range(1, 30)), sample(30))
    ends = np.cumsum([len(run) + 1 for run in body.split(b"\0")[:-1]])
    for at in range(len(body)):
        link = Connection()
        events = link.receive(head + body[:at] + body[at + 1 :] + stream(sample(31), sample(32)), 0)
        got = np.concatenate([event.array["index"] for event in events if isinstance(event, Samples)])
        hit = int(np.searchsorted(ends, at, side="right")) + 1
        lost = {hit, hit + 1} if at + 1 in ends else {hit}
        assert set(range(33)) - set(got.tolist()) == lost
        assert sum(event.lost for event in events if isinstance(event, SampleGap)) == len(lost)


def check_samples(found: Drill, tolerance_mv: float = 12.0) -> int:
    """Check every recorded sample against the board's own values for its index; return how many there are."""
    run, truth = found.close(), found.truth()
    own = {int(index): row for index, row in zip(truth[:, 1], truth, strict=True)}
    at = np.array([own[int(index)] for index in run.index])
    good = (run.flags & int(SampleFlag.IMPLAUSIBLE)) == 0
    assert np.abs(run.pressure_kpa - at[:, 3])[good].max() < 1.0
    assert np.abs(run.signal_mv - at[:, 5:])[good].max() < tolerance_mv
    assert run.n + run.lost == int(run.index[-1]) - int(run.index[0]) + 1
    return run.n


@pytest.mark.fault(1, 2, how="`bit_flips` at 1e-3 and `drop_byte` at 5e-4 a byte, recorded over a pty", times=1)
def test_damaged_link_loses_only_counted_frames(tmp_path: Path) -> None:
    """Frames are dropped and counted; every sample in the file is the board's own."""
    with drill(tmp_path, "bit_flips@1:0.001", "drop_byte@1:0.0005") as found:
        found.until_sample(4_000)
        n = check_samples(found)
    summary = summarise(found.path)
    assert n > 3_500
    assert summary.lost_samples > 50
    assert summary.crc_errors > 20


@pytest.mark.fault(3, how="`garbage` and `boot_text`, recorded over a pty", times=2)
@pytest.mark.fault(4, how="`absurd_value`: 5 MPa, 65535 counts, dark above lit, recorded over a pty", times=3)
@pytest.mark.fault(5, how="`index_gap` of 1, 7, 255 and 256 samples, recorded over a pty", times=4)
@pytest.mark.fault(6, how="`duplicate` and `reorder`, recorded over a pty", times=2)
@pytest.mark.fault(7, how="`clock_wrap`, recorded over a pty", times=1)
def test_every_link_fault_in_one_recording_is_handled(tmp_path: Path) -> None:
    """Garbage skipped, repeats dropped, gaps exact, absurd values stored and flagged, time monotone; one segment."""
    gaps = (1, 7, 255, 256)
    faults = [f"index_gap@{108 + 4 * number}:{lost}" for number, lost in enumerate(gaps)]
    faults += ["garbage@102:5000", "boot_text@103:20", "duplicate@104:5", "reorder@105:5", "absurd_value@106:3"]
    with drill(tmp_path, *faults, "clock_wrap@107") as found:  # 2 s of wall time: connected by then
        found.reached(lambda s: s.recorded_s > 130)
        n = check_samples(found)
    run = found.rows("SELECT value FROM event WHERE kind = 'gap' ORDER BY id")
    assert [lost for (lost,) in run][-4:] == list(gaps)
    kept = found.again()
    assert (np.diff(kept.time_s) > 0).all()
    absurd = (kept.flags & int(SampleFlag.IMPLAUSIBLE)) != 0
    assert absurd.sum() >= 2
    assert not kept.usable[absurd].any()
    assert len(set(kept.segment.tolist())) == 1
    health = found.rows("SELECT max(duplicates), max(malformed + crc_errors + oversize) FROM health")[0]
    assert health[0] >= 5
    assert health[1] > 5
    assert n > 1_800


@pytest.mark.nightly
@pytest.mark.fault(5, how="`index_gap` of 70,000 samples, recorded over a pty", times=1)
def test_gap_of_70000_samples_is_exact(tmp_path: Path) -> None:
    """More than 16 bits of the index: exact to the sample."""
    with drill(tmp_path, "index_gap@600:70000", speed=200.0) as found:
        found.reached(lambda s: s.recorded_s > 1400.0, 120)
        found.close()
    assert found.rows("SELECT value FROM event WHERE kind = 'gap'") == [(70_000.0,)]


@pytest.mark.nightly
@pytest.mark.fault(4, how="`absurd_value` in a run under pressure, over a pty", times=1)
def test_absurd_pressure_trips_the_interlock(tmp_path: Path) -> None:
    """5 MPa with a valid checksum in a run: vented, latched with its cause, one end of the run."""
    with drill(tmp_path, "absurd_value@40:3", speed=20.0) as found:
        found.start(LONG)
        seen = found.reached(lambda s: s.state in OVER)
        assert seen.state is SessionState.FAULT
        assert seen.latched
        found.reached(lambda _: found.vented(), 10)
        found.close()
    assert found.rows("SELECT count(*) FROM event WHERE kind = 'run_ended'") == [(1,)]


@pytest.mark.fault(9, how="`slow_rate` of 62 Hz and `jitter` of 4 ms, recorded over a pty", times=1)
def test_slow_jittering_board_keeps_its_times(tmp_path: Path) -> None:
    """The rate shown is the rate received; times are the board's."""
    with drill(tmp_path, "slow_rate@0:62", "jitter@0:4") as found:
        found.reached(lambda s: s.recorded_s > 30.0)
        run = found.close()
        seen = found.session.snapshot()
    assert summarise(found.path).rate_hz == pytest.approx(62.0, abs=0.2)
    assert run.rate_hz == pytest.approx(62.0, abs=2.5)
    assert any("62" in warning.text for warning in seen.health.warnings)
    assert np.diff(run.time_s).std() > 0.5e-3


@pytest.mark.nightly
@pytest.mark.fault(8, how="`drift_ppm` of 200 and 10,000 on a board at 1x, recorded over a pty for a minute", times=2)
@pytest.mark.parametrize(("ppm", "warned"), [(200, False), (10_000, True)])
def test_clock_drift_is_shown_and_warned_of(tmp_path: Path, ppm: int, warned: bool) -> None:
    """The rate is shown and warned of above 0.5 %; raw times stay the board's."""
    with drill(tmp_path, f"drift_ppm@0:{ppm}", speed=1.0) as found:
        time.sleep(60.0)
        seen = found.session.snapshot()
        found.close()
    slope_ppm = 1e6 * (1 - 1 / (1 + 1e-6 * ppm))  # host seconds for one of the board, which is fast by `ppm`
    assert abs(seen.health.drift_ppm) == pytest.approx(slope_ppm, abs=150)
    assert (LinkWarningCode.CLOCK in {w.code for w in seen.health.warnings}) == warned


@pytest.mark.fault(10, how="`reset` in a run under pressure, over a pty", times=1)
def test_board_reset_ends_the_run_in_a_new_segment(tmp_path: Path) -> None:
    """A new segment, the unit vented, the run ended with its cause; samples before and after are never spliced."""
    with drill(tmp_path, "reset@40:2", speed=20.0) as found:
        found.start(LONG)
        seen = found.reached(lambda s: s.state in OVER)
        assert seen.state is not SessionState.IDLE
        found.reached(lambda _: found.vented(), 10)
        found.reached(lambda s: s.recorded_s > 45, 20)
        run = found.close()
    assert len(set(run.segment.tolist())) >= 2
    assert "board restarted" in {reason for (reason,) in found.rows("SELECT reason FROM segment")}
    assert found.rows("SELECT count(*) FROM event WHERE kind = 'run_ended'") == [(1,)]


@pytest.mark.fault(62, how="`clock_back` by 100 s and `clock_wrap` in one recording, over a pty", times=1)
def test_clock_that_goes_back_is_a_segment_of_true_duration(tmp_path: Path) -> None:
    """An event with the time, a segment, and the duration and rate of both; a clock that wraps is neither."""
    with drill(tmp_path, "clock_wrap@105", "clock_back@130:60", speed=50.0) as found:
        seen = found.reached(lambda s: any(m.kind is MessageKind.BOARD_CLOCK for m in s.messages), 60)
        last = found.reached(lambda s: s.recorded_s > seen.recorded_s + 20, 20)
        run = found.close()
    assert found.rows("SELECT value, segment FROM event WHERE kind = 'clock_back_us'") == [(60e6, 2)]
    assert found.rows("SELECT reason FROM segment ORDER BY id") == [("opened",), ("clock went back",)]
    info = summarise(found.path)
    assert [s.rate_hz for s in info.segments] == pytest.approx([100.0, 100.0], abs=0.01)
    assert info.duration_s == pytest.approx((info.samples - 2) / 100, abs=1e-6)
    assert (info.gaps, info.lost_samples) == (0, 0)
    assert last.recorded_s == pytest.approx(info.duration_s, abs=15.0)  # of board time, at 50 times real time
    assert (np.diff(run.time_s) > 0).all()
    assert run.time_s[-1] == pytest.approx(info.duration_s, abs=2.0)


@pytest.mark.fault(62, how="`clock_back` in a run under pressure, over a pty", times=1)
def test_clock_that_goes_back_ends_a_run(tmp_path: Path) -> None:
    """Dwells are timed by that clock: the unit is vented, and the fault names the clock."""
    with drill(tmp_path, "clock_back@40:30", speed=20.0) as found:
        found.start(LONG)
        seen = found.reached(lambda s: s.state in OVER)
        assert seen.state is SessionState.FAULT
        assert any(m.kind is MessageKind.BOARD_CLOCK and "30 s" in m.cause for m in seen.messages)
        found.reached(lambda _: found.vented(), 10)
        found.close()


@pytest.mark.fault(12, how="`silent` for 30 s in a run under pressure, over a pty", times=1)
def test_silent_board_is_vented(tmp_path: Path) -> None:
    """The port stays open without data: a message, a VENT is sent, and the board executes it."""
    with drill(tmp_path, "silent@12:0", speed=5.0) as found:
        found.start(LONG)
        seen = found.reached(lambda s: s.state in OVER, 30)
        assert seen.state is SessionState.FAULT
        found.reached(lambda s: any(message.kind is MessageKind.SILENT for message in s.messages), 20)
        found.reached(lambda _: found.vented(), 20)
        found.reached(lambda _: any(isinstance(command, Vent) for _, command in found.commands()), 20)
        found.session.stop_recording()


@pytest.mark.fault(16, how="`frozen_channel` in a run, over a pty", times=1)
@pytest.mark.fault(23, how="`ambient_step` of 300 mV and `flicker` of 20 mV in a run, over a pty", times=2)
def test_frozen_channel_raises_alarm_and_lamp_cancels(tmp_path: Path) -> None:
    """A frozen sensor raises an alarm with its number. A lamp changes the dark counts, not the signal."""
    with drill(tmp_path, "ambient_step@100:300", "flicker@100:20", "frozen_channel@120:1") as found:
        found.start(dataclasses.replace(SHORT, cycles=6))
        seen = found.reached(lambda s: s.state in OVER)
        run, truth = found.close(), found.truth()
    assert (seen.state, seen.run_ended) == (SessionState.IDLE, RunEnding(RunEnd.FINISHED))
    assert found.rows("SELECT DISTINCT value FROM event WHERE kind = 'flat_line'") == [(1.0,)]
    assert run.dark is not None
    dark = run.dark[:, 1].astype(float) * VOLT_MV
    lit_up = np.flatnonzero(dark > dark[0] + 150)[0]
    assert 100 < lit_up < run.n - 1000
    assert dark[lit_up + 100 :].mean() - dark[: lit_up - 100].mean() > 150
    own = dict(zip(truth[:, 1].astype(int).tolist(), truth[:, 6].tolist(), strict=True))
    residual = run.signal_mv[:, 1] - np.array([own[int(index)] for index in run.index])
    assert abs(residual[lit_up:].mean()) < 1.0
    assert abs(residual[:lit_up].mean()) < 1.0


@pytest.mark.fault(17, how="every answer lost from 5 s on, in a run over a pty", times=1)
def test_board_without_answers_is_vented(tmp_path: Path) -> None:
    """A command is sent three times with one sequence number, then the unit is vented and the fault latched."""
    with drill(tmp_path, "ack_lost@20:1000", speed=10.0) as found:
        found.start(LONG)
        seen = found.reached(lambda s: s.state in OVER)
        assert seen.state is SessionState.FAULT
        found.reached(lambda _: found.vented(), 10)
        found.session.stop_recording()
    sent = found.commands()
    assert any(sent.count(one) == 3 for one in sent if isinstance(one[1], SetPressure | Heartbeat))
    assert isinstance(sent[-1][1], Vent | Heartbeat | Stop)


@pytest.mark.nightly
@pytest.mark.fault(17, how="a SET_PRESSURE refused with status 4 in a run, over a pty", times=1)
def test_refused_pressure_ends_the_run(tmp_path: Path) -> None:
    """A refused command is not taken for an executed one."""
    with drill(tmp_path, "ack_refused@60:4") as found:
        found.start(LONG)
        assert found.reached(lambda s: s.state in OVER).state is SessionState.FAULT
        found.reached(lambda _: found.vented(), 10)
        found.close()


@pytest.mark.fault(19, how="`overshoot` of 4 kPa at a limit of 20 kPa, in a run over a pty", times=1)
def test_overshoot_beyond_the_margin_aborts(tmp_path: Path) -> None:
    """24 kPa at a limit of 20 kPa: vented, the peak in the file."""
    plan = dataclasses.replace(SHORT, high_kpa=20.0, low_kpa=-20.0, step_kpa=20.0)
    with drill(tmp_path, "overshoot@0:6", unit=Unit("SA1", -40.0, 20.0)) as found:
        found.start(plan)
        seen = found.reached(lambda s: s.state in OVER)
        assert seen.state is not SessionState.IDLE
        found.reached(lambda _: found.vented(), 10)
        run = found.close()
    assert run.pressure_kpa.max() > 21.5
    assert found.truth()[:, 3].max() < 30.0


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param("stall@0:30", marks=pytest.mark.fault(21, how="`stall` at 30 kPa, in a run over a pty", times=1)),
        pytest.param(
            "dead_pump@60:0",
            marks=[pytest.mark.nightly, pytest.mark.fault(21, how="`dead_pump`, in a run over a pty", times=1)],
        ),
    ],
)
def test_unreached_target_ends_the_run(tmp_path: Path, fault: str) -> None:
    """The step times out, the unit is vented, the cycle is incomplete."""
    with drill(tmp_path, fault, speed=100.0) as found:
        found.start(LONG)
        seen = found.reached(lambda s: s.state in OVER)
        assert seen.state is not SessionState.IDLE
        found.reached(lambda _: found.vented(), 10)
        found.close()
    assert summarise(found.path).cycles.complete < LONG.cycles
    assert found.rows("SELECT status FROM step WHERE branch != 'end' ORDER BY id")[-1][0] in ("timeout", "aborted")


@pytest.mark.fault(22, how="`saturate` of sensor 1, recorded over a pty", times=1)
def test_saturated_sensor_is_flagged_and_left_out(tmp_path: Path) -> None:
    """Flagged in the file, left out of every figure, and counted."""
    with drill(tmp_path, "saturate@100:1") as found:
        found.reached(lambda s: s.recorded_s > 110)
        run = found.close()
    saturated = (run.flags & int(SampleFlag.SATURATED)) != 0
    assert not saturated[0]
    assert saturated[-1]
    assert np.count_nonzero(np.diff(saturated)) == 1
    assert not run.usable[saturated, 0].any()
    assert run.masked["saturated"] == saturated.sum()


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.fault(26, how="`record` stopped (SIGSTOP) for 0.5 s and 5 s under pressure, on a board at 1x", times=2)
@pytest.mark.parametrize("stall_s", [0.5, 5.0])
def test_suspended_host_loses_no_uncounted_sample(tmp_path: Path, stall_s: float) -> None:
    """Samples of that time are in the buffers, or an exact gap; after 5 s the board has vented by its watchdog."""
    truth = tmp_path / "truth.csv"
    with serve(BoardSettings(truth=str(truth))) as board:
        command = [sys.executable, "-m", "boat_daq", "record", "--port", board.url, "--plan", "repeatability"]
        host = subprocess.Popen(
            [*command, "--cycles", "1", "--out", str(tmp_path / "run.boat")], cwd=ROOT, stderr=subprocess.DEVNULL
        )
        while not truth.exists() or pressure_now(truth) < 10.0:
            time.sleep(0.1)
        host.send_signal(signal.SIGSTOP)
        time.sleep(stall_s)
        vented = abs(pressure_now(truth)) < 1.0
        host.send_signal(signal.SIGCONT)
        time.sleep(3.0)
        host.send_signal(signal.SIGINT)
        host.wait(60)
    assert vented == (stall_s > 2.0)
    found = Drill(tmp_path, None, truth=truth)  # type: ignore[arg-type]
    summary = summarise(found.path)
    first, last = found.ends()
    assert summary.samples + summary.lost_samples == last - first + 1


def pressure_now(truth: Path) -> float:
    """Return the board's own pressure at its newest sample, kPa; 0 before the first."""
    lines = truth.read_text(encoding="utf-8").splitlines()[2:-1]
    return float(lines[-1].split(",")[3]) if lines else 0.0


@pytest.mark.nightly
@pytest.mark.fault(11, how="`unplug` for 8 s of board time while only listening, over a pty", times=1)
def test_replugged_board_continues_in_a_new_segment(tmp_path: Path) -> None:
    """Data before and after are stored in two segments; the board is recognised by its identity."""
    link = tmp_path / "port"
    session = Session(Settings(), UnitLibrary(tmp_path / "units"))
    try:
        with serve(BoardSettings(speed=4.0, faults=("unplug@8:8",), link=str(link))):
            session.connect(str(link))
            session.wait_connected()
            session.start_recording(tmp_path / "run.boat")
            assert session.wait(lambda s: s.link is LinkState.LOST, 20).link is LinkState.LOST
            before = session.snapshot().recorded_s
            assert before > 3.0
            assert session.wait(lambda s: s.link is LinkState.UP, 30).link is LinkState.UP
            assert session.wait(lambda s: s.recorded_s > before + 2, 20).recorded_s > before + 2
            session.stop_recording()
    finally:
        session.close()
    with closing(open_recording(tmp_path / "run.boat")) as db:
        assert ("reconnected",) in db.execute("SELECT reason FROM segment").fetchall()
