"""The firmware and the virtual board, given the same bytes at the same board times, send the same messages."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from protocol.link.framing import encode_frame
from protocol.link.messages import (
    ClearFault,
    Command,
    Heartbeat,
    Identify,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    Vent,
    encode_command,
)
from protocol.simulator.faults import Fault, make_fault
from tests.firmware.board_pair import BoardPair, assert_the_same
from tests.firmware.firmware_build import FirmwareProcess

PRESSURES_PA = st.one_of(
    st.integers(-45, 55).map(lambda kpa: 1000 * kpa),
    st.sampled_from([-45_001, -45_000, 55_000, 55_001, 0, 1, -(2**31), 2**31 - 1]),
)
LIMITS_PA = st.sampled_from(
    [(-45_000, 55_000), (-20_000, 30_000), (5_000, 20_000), (-45_001, 0), (0, 55_001), (0, 0), (9_000, -9_000)]
)
COMMANDS: st.SearchStrategy[Command] = st.one_of(
    st.builds(SetPressure, PRESSURES_PA, st.sampled_from([0, 1, 999, 3_000, 20_000, 40_000, 2**32 - 1])),
    st.builds(SetPressure, st.integers(-20, 20).map(lambda kpa: 1000 * kpa), st.just(0)),
    st.builds(Vent),
    st.builds(ClearFault),
    st.builds(Heartbeat, st.sampled_from([0, 99, 100, 123, 500, 2000, 5000, 5001, 65_535])),
    LIMITS_PA.map(lambda limits: SetLimits(*limits)),
    st.builds(SetLimits, PRESSURES_PA, PRESSURES_PA),
    st.builds(Start, st.sampled_from([0, 1, 3, 62, 100, 250, 20_001, 65_535])),
    st.builds(Stop),
    st.builds(Identify),
)
COMMAND_FRAMES = st.builds(encode_command, COMMANDS, st.integers(0, 3))  # few numbers: some come twice running
OTHER_FRAMES = st.one_of(
    st.builds(encode_frame, st.integers(0x7F, 0x90), st.integers(0, 3), st.binary(max_size=12)),
    st.binary(max_size=40),
    st.just(b"A" * 300 + b"\0"),
)
FRAMES = st.one_of(*[COMMAND_FRAMES] * 6, OTHER_FRAMES)
STARTED = (0, encode_command(Start(100), 200))
SCRIPTS = st.lists(st.tuples(st.integers(0, 150), FRAMES), min_size=4, max_size=20).map(lambda steps: [STARTED, *steps])
AT_S = st.integers(1, 800).map(lambda tick: tick / 100)
FAULTS = st.lists(
    st.one_of(
        st.builds(make_fault, st.just("estop"), AT_S, st.sampled_from([0.5, 2.0, 0.0])),
        st.builds(make_fault, st.just("pressure_invalid"), AT_S, st.just(1.0)),
        st.builds(make_fault, st.just("beyond_limit"), AT_S, st.sampled_from([60, -60, 57, 57.001, -47, -47.001, 20])),
        st.builds(make_fault, st.sampled_from(["dead_pump", "stall", "leak"]), AT_S),
        st.builds(make_fault, st.just("saturate"), AT_S, st.sampled_from([1, 2])),
        st.builds(make_fault, st.just("dropped"), AT_S, st.sampled_from([1, 10])),
        st.builds(make_fault, st.just("reset"), AT_S, st.integers(0, 4)),
        st.builds(make_fault, st.just("clock_wrap"), AT_S),
    ),
    max_size=3,
    unique_by=(lambda fault: fault.name, lambda fault: fault.start_us),  # of two at one instant, either may be first
)
QUIET = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]


def play(process: FirmwareProcess, script: list[tuple[int, bytes]], faults: list[Fault], *, after: int) -> BoardPair:
    """Give a script to both boards and return the pair with the bytes of both."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        pair = BoardPair(process, monkeypatch, faults)
        for pause, frame in script:
            pair.wait(pause)
            pair.receive(frame)
        pair.wait(after)
    return pair


def frames(*steps: tuple[int, Command]) -> list[tuple[int, bytes]]:
    """Return commands, numbered consecutively, as a script."""
    return [(pause, encode_command(command, seq)) for seq, (pause, command) in enumerate(steps)]


STALLED = frames((10, Start(100)), (10, SetPressure(20_000, 20_000)), (850, Stop()))
FAULTY = frames((10, Start(100)), (60, Vent()), (10, ClearFault()), (60, SetPressure(20_000)), (90, ClearFault()))
UNFED = frames((10, Start(100)), (0, Heartbeat(500)), (0, SetPressure(55_000)), (45, Vent()), (50, Heartbeat(500)))
FED_BY_REPETITION = [(10, encode_command(Heartbeat(500), 7)), (40, encode_command(Heartbeat(500), 7))]
DISARMED = frames((10, Start(100)), (0, Heartbeat(0)), (9, Heartbeat(100)), (5, Heartbeat(0)))
PAUSED = frames((10, Start(100)), (60, Stop()), (140, Start(100)))
FASTEST = frames((10, Start(20_000)), (10, Start(20_001)), (10, Stop()))
TURNED_BACK = frames((10, Start(100)), (0, SetPressure(30_000)), (200, SetLimits(-45_000, 29_000)))
STARTED_TWICE = frames((10, Start(100)), (150, Start(100)), (10, SetPressure(20_000, 20_000)))


@settings(max_examples=30, deadline=None, suppress_health_check=QUIET)
@given(SCRIPTS, FAULTS)
@example(STALLED, [make_fault("stall", 0.5, 10)])
@example(STALLED, [make_fault("dropped", 8.65, 10)])
@example(STARTED_TWICE, [make_fault("dropped", 1.55, 10)])
@example(STARTED_TWICE, [make_fault("saturate", 1.0, 2), make_fault("reset", 1.5)])
@example(STARTED_TWICE, [make_fault("clock_wrap", 1.0)])
@example(FAULTY, [make_fault("beyond_limit", 0.5, 57.001)])
@example(FAULTY, [make_fault("beyond_limit", 0.5, 57)])
@example(FAULTY, [make_fault("estop", 0.5, 0.5)])
@example(FAULTY, [make_fault("estop", 0.5, 3)])
@example(FAULTY, [make_fault("beyond_limit", 0.72, 90)])
@example(UNFED, [])
@example(FED_BY_REPETITION, [])
@example(DISARMED, [])
@example(PAUSED, [make_fault("saturate", 0.5, 1)])
@example(FASTEST, [])
@example(TURNED_BACK, [])
def test_any_script_gives_the_same_messages(
    process: FirmwareProcess, script: list[tuple[int, bytes]], faults: list[Fault]
) -> None:
    """ACK statuses, states, flags, events and their values, sampling instants: the same, in the same order."""
    pair = play(process, script, faults, after=45)
    assert_the_same(pair.virtual, pair.firmware)


@pytest.mark.nightly
@settings(max_examples=3000, deadline=None, suppress_health_check=QUIET)
@given(SCRIPTS, FAULTS)
def test_long_scripts_give_the_same_messages(
    process: FirmwareProcess, script: list[tuple[int, bytes]], faults: list[Fault]
) -> None:
    """The same with three thousand scripts, each long enough for a target to count as not reached."""
    pair = play(process, script, faults, after=1000)
    assert_the_same(pair.virtual, pair.firmware)
