"""The control on the rig: each fault a board can have, and what becomes of the run. No thread, no port."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from boat_daq.engine.control.board_commands import BoardCommands
from boat_daq.engine.control.preflight import ZERO_SAMPLES
from boat_daq.engine.control.watchdog import REAL_TIME_MS
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.sample_columns import Columns, passed_us
from boat_daq.engine.snapshot import RunEnding, SessionState
from protocol.base.errors import RequestError
from protocol.link.events import CommandDone, CommandLost
from protocol.link.messages import AckStatus, ClearFault, Heartbeat, SetLimits, SetPressure, Start, Vent
from protocol.recording import BoardState, RunEnd, SampleFlag
from tests.boat_daq.engine.controller_rig import QUICK, ControllerRig
from tests.conftest import mostly_at_night

RUN_S = 60.0
AGAIN = "check its cable: it reconnects automatically"


def vented(rig: ControllerRig) -> bool:
    return abs(rig.pressure_kpa) < 1.0


@pytest.mark.parametrize(("speed", "step_s"), mostly_at_night((50.0, 0.02), (1.0, 0.04)))
def test_a_calibration_runs_to_its_end(speed: float, step_s: float) -> None:
    """All plateaus of one cycle are reached and steady, at 1x as at 50x; pressure stays inside the limits."""
    plan = dataclasses.replace(built_in_plans()["calibration"], cycles=1)
    rig = ControllerRig(speed=speed).running(plan)
    assert rig.run(3 * plan.duration_s, lambda: rig.state is SessionState.IDLE, step_s=step_s)
    assert rig.ends == [RunEnding(RunEnd.FINISHED)]
    plateaus = [mark for mark in rig.marks.values() if mark.branch != "end"]
    assert [mark.target_kpa for mark in plateaus] == [step.target_kpa for step in plan.steps]
    assert all(mark.status == "reached" and mark.detail["steady"] for mark in plateaus)
    assert min(rig.pressures) > -42 and max(rig.pressures) < 52
    assert vented(rig)


def test_limits_and_watchdog_come_before_the_first_pressure() -> None:
    """HEARTBEAT and SET_LIMITS are acknowledged before SET_PRESSURE leaves, whatever is lost on the way."""
    rig = ControllerRig().connected()
    rig.fault("ack_lost", 1)
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start)
    assert not rig.sent_of(SetPressure)
    rig.run(1.0, lambda: bool(rig.sent_of(SetPressure)))
    kinds = [type(command) for command in rig.sent]
    first = kinds.index(SetPressure)
    assert Heartbeat in kinds[:first] and SetLimits in kinds[:first]
    assert rig.control.last is not None and rig.control.last.flags & 0x4


def test_a_second_press_of_start_is_one_start() -> None:
    """Start, start, start: one run."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start, rig.control.start)
    rig.run(1.0)
    assert len([n for n in rig.notes if n.kind == "run_started"]) == 1


def test_lost_vents_are_repeated_and_do_not_multiply() -> None:
    """Ten seconds of a link that reports each lost vent only 1.2 s later: one in each 0.75 s all the same."""
    sent_ms: list[int] = []
    dialogue = BoardCommands(lambda _: sent_ms.append(dialogue.now_ns // 1_000_000))
    dialogue.vent()
    for now_ms in range(0, 10_000, 10):
        dialogue.now_ns = now_ms * 1_000_000
        for _ in range(sent_ms.count(now_ms - 1200)):
            assert dialogue.lost(Vent(), watched=True) is None
        dialogue.tick(idle=True)
    assert len(sent_ms) == 14
    assert {after - before for before, after in pairwise(sent_ms)} == {760}


@pytest.mark.fault(60, how="the port stays unread for 1.5 s and for 3.5 s while bytes wait in it")
@pytest.mark.parametrize(("unread_s", "vents", "urgent"), [(1.5, False, True), (3.5, True, True), (3.5, True, False)])
def test_a_port_that_this_computer_reads_late_is_no_silence(unread_s: float, *, vents: bool, urgent: bool) -> None:
    """Bytes wait in the port: no silence for 3 s, then a trip that names this computer, and a priority not allowed."""
    rig = ControllerRig().running(built_in_plans()["repeatability"])
    rig.control.stream.urgent = urgent
    rig.run(1.0)
    heard_ns, waiting = rig.now_ns, b""
    for _ in range(round(unread_s / 0.02)):
        rig.now_ns += 20_000_000
        waiting += rig.board.advance(20_000)
        rig.control.tick(rig.now_ns, heard_ns)
        rig.flush()
    rig.control.events(rig.link.receive(waiting, rig.now_ns), rig.now_ns)
    rig.flush()
    rig.run(1.0)
    assert (rig.control.interlock.latched is not None) == vents
    if vents:
        assert "this computer was too busy" in rig.control.interlock.latched.cause
        assert ("higher priority" in rig.control.interlock.latched.remedy) != urgent


@pytest.mark.parametrize(("starved_s", "survives"), [(0.70, True), (0.40, False)])
def test_a_heartbeat_lost_over_a_pause_of_the_board_is_no_broken_link(starved_s: float, *, survives: bool) -> None:
    """Samples stay away for 0.7 s and come again just before its answer is given up; after 0.4 s none is excused."""
    rig = ControllerRig().running(built_in_plans()["repeatability"])
    rig.run(1.0)
    hears, makes, waiting = rig.board.receive, rig.board.advance, []
    rig.board.receive = waiting.append
    beats = len(rig.sent_of(Heartbeat))
    assert rig.run(0.5, lambda: len(rig.sent_of(Heartbeat)) > beats)
    rig.board.advance = lambda _: b""
    rig.run(starved_s)
    rig.board.advance = makes
    rig.run(0.80 - starved_s)
    rig.board.receive = hears
    hears(b"".join(waiting))
    rig.run(0.5)
    assert (rig.state is SessionState.RUNNING) is survives


@pytest.mark.fault(21, how="virtual board's faults in a run, stalled and dead pumps among them", times=9)
@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ("estop@4:3", "e-stop"),
        ("pressure_invalid@4:3", "pressure sensor"),
        ("beyond_limit@4:70", "over"),
        ("beyond_limit@4:-60", "under"),
        ("dead_pump@4:0", "not reached"),
        ("stall@1:20", "not reached"),
        ("silent@4:30", "no data"),
        ("reset@4:1", "restarted (watchdog)"),
        ("absurd_value@4:3", "5000 kPa"),
    ],
)
def test_a_fault_of_the_board_vents_and_latches(fault: str, text: str) -> None:
    """Whatever breaks: vented, latched with its reason, one end, and no pressure until it is cleared."""
    rig = ControllerRig(fault, rate_hz=100).running(dataclasses.replace(QUICK, cycles=5))
    assert rig.run(RUN_S, lambda: rig.state is SessionState.FAULT)
    rig.run(3.0)
    latched = rig.control.interlock.latched
    assert latched is not None and text in latched.cause
    assert rig.ends == [RunEnding(RunEnd.FAULT, latched.cause)]
    assert vented(rig) and rig.sent_of(Vent)
    with pytest.raises(RequestError):
        rig.control.set_pressure(10.0)


@pytest.mark.fault(12, how="no answer to SET_PRESSURE just before the samples stop", times=1)
def test_silence_after_a_lost_command_is_reported_too() -> None:
    """A command given up shortly before the silence is the trip; the operator reads of both."""
    rig = ControllerRig().running(built_in_plans()["repeatability"])
    rig.run(1.0)
    rig.do(lambda: rig.control.events([CommandLost(SetPressure(1000, 1000), 3)], rig.now_ns))
    rig.board.advance = lambda _: b""
    rig.run(3.0)
    assert rig.state is SessionState.FAULT
    assert [note.kind for note in rig.notes if note.kind in ("no_answer", "silent")] == ["no_answer", "silent"]


def test_after_the_e_stop_the_operator_clears_and_runs_again() -> None:
    """While it is pressed clearing is refused; released and cleared, a new run starts."""
    rig = ControllerRig("estop@4:8").running()
    rig.run(RUN_S, lambda: rig.state is SessionState.FAULT)
    rig.run(1.0)
    with pytest.raises(RequestError, match="e-stop"):
        rig.control.clear_fault()
    rig.run(10.0)
    rig.do(rig.control.clear_fault)
    assert rig.run(2.0, lambda: rig.state is SessionState.IDLE)
    assert rig.sent_of(ClearFault)
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start)
    assert rig.run(RUN_S, lambda: RunEnding(RunEnd.FINISHED) in rig.ends)


@pytest.mark.fault(20, how="e-stop pressed, or 70 kPa, before the program came", times=2)
@pytest.mark.parametrize("fault", ["estop@0:60", "beyond_limit@0.02:70"])
def test_a_level_at_the_start_is_found(fault: str) -> None:
    """Levels, not edges: what was so before the program came forbids the start."""
    rig = ControllerRig(fault).connected()
    with pytest.raises(RequestError):
        rig.control.arm(QUICK)
    assert not rig.sent_of(SetPressure)


@pytest.mark.fault(17, how="SET_PRESSURE refused with status 3", times=1)
def test_a_refused_pressure_is_not_done() -> None:
    """The board answers 3: vent and latch, not a run at another pressure than commanded."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start)
    rig.fault("ack_refused", 3)
    assert rig.run(3.0, lambda: rig.state is SessionState.FAULT)
    assert "out of its limits" in rig.ends[0].cause


@pytest.mark.parametrize("pressed", ["start", "pressure by hand", "nothing"])
def test_a_run_that_never_began_has_no_end(pressed: str) -> None:
    """A fault while the guards of a start, or of a pressure by hand, are not answered yet: nothing to end by it."""
    rig = ControllerRig("ack_late@0:200").connected()
    rig.do(lambda: rig.control.arm(QUICK))
    if pressed == "start":
        rig.do(rig.control.start)
    elif pressed == "pressure by hand":
        rig.do(lambda: rig.control.set_pressure(0.0, 1.0))
    rig.fault("estop", 1)
    rig.run(1.0)
    assert (rig.state, rig.ends, rig.reports(["run_started"])) == (SessionState.FAULT, [], [])


@pytest.mark.fault(17, how="every answer lost", times=1)
def test_an_unanswered_pressure_is_sent_three_times_then_vented() -> None:
    """ACKs lost for good: same seq three times, then vent and latch."""
    rig = ControllerRig().running()
    rig.run(5.0)
    rig.fault("ack_lost", 1000)
    assert rig.run(RUN_S, lambda: rig.state is SessionState.FAULT)
    assert "did not answer" in rig.ends[0].cause
    rig.run(2.0)
    assert vented(rig)
    assert len(rig.sent_of(Vent)) > 1, "a vent is repeated until it is acknowledged"


@pytest.mark.fault(11, how="the port gone for good, under pressure", times=1)
def test_unplugged_under_pressure_the_board_vents_by_itself() -> None:
    """Nothing reaches the board any more: its watchdog vents within its time; the run is in fault, not resumed."""
    rig = ControllerRig().running()
    rig.run(3.0)
    assert abs(rig.pressure_kpa) > 10
    rig.plugged = False
    rig.control.link_lost("the port is gone")
    rig.flush()
    assert rig.state is SessionState.FAULT
    assert rig.reports(["link_lost"])[0].remedy == f"{AGAIN}; the board vents by itself"
    rig.run(REAL_TIME_MS / 1e3 + 1.5)
    assert vented(rig)
    rig.replug()
    rig.run(5.0)
    assert rig.state is SessionState.FAULT and vented(rig)


@pytest.mark.fault(18, how="the host stops at instants of a run", times=4)
def test_a_dead_host_leaves_no_pressure() -> None:
    """The host stops at 4 instants of a run: at rest 1.5 s after its watchdog expires, every time."""
    for n in range(4):
        rig = ControllerRig(seed=n).running(dataclasses.replace(QUICK, cycles=2))
        rig.run(1.0 + 3.3 * n)
        rig.host_alive = False
        rig.run(REAL_TIME_MS / 1e3 + 1.5)
        assert vented(rig), n


@pytest.mark.fault(18, how="a board found vented by its watchdog", times=1)
def test_the_next_start_reports_what_happened() -> None:
    """A board that vented when its host was killed is found in FAULT, with its reason."""
    rig = ControllerRig().running()
    rig.run(3.0)
    rig.host_alive = False
    rig.run(5.0)
    later = ControllerRig()
    later.board = rig.board
    later.replug()
    later.run(1.0)
    assert later.control.interlock.latched is not None
    assert "host may have failed" in later.control.interlock.latched.cause
    later.do(later.control.clear_fault)
    later.run(10.0)
    assert later.state is SessionState.IDLE


def test_vent_is_executed_in_every_state() -> None:
    """Idle, armed, running, paused, finishing, aborted, fault: VENT is sent, and the state stays a legal one."""
    for prepare in (
        lambda b: None,
        lambda b: b.control.arm(QUICK),
        lambda b: b.running(),
        lambda b: (b.running(), b.control.pause()),
        lambda b: (b.running(), b.control.stop()),
        lambda b: (b.running(), b.control.vent()),
        lambda b: (b.running(), b.fault("estop", 1.0), b.run(1.0)),
    ):
        rig = ControllerRig().connected()
        prepare(rig)
        rig.flush()
        before = len(rig.sent_of(Vent))
        rig.do(rig.control.vent)
        assert len(rig.sent_of(Vent)) == before + 1
        rig.run(3.0)
        assert vented(rig) and len(rig.ends) <= 1


def test_manual_pressure() -> None:
    """Within limits it is reached and held; outside, or during a run, it is refused; stop vents it."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.set_pressure(20.0, 20.0))
    assert rig.run(5.0, lambda: abs(rig.pressure_kpa - 20) < 0.5)
    with pytest.raises(RequestError, match="limit"):
        rig.control.set_pressure(56.0)
    rig.do(rig.control.stop)
    rig.run(2.0)
    assert vented(rig)
    rig.running()
    with pytest.raises(RequestError, match="in state running"):
        rig.control.set_pressure(10.0)


def test_the_zero_of_the_pressure_sensor_is_checked() -> None:
    """A vented unit that reads 10 kPa is not started."""
    rig = ControllerRig().connected()
    rig.control.preflight.recent_kpa.extend([10.0] * ZERO_SAMPLES)
    rig.control.arm(QUICK)
    with pytest.raises(RequestError, match="on a vented unit"):
        rig.control.start()


@pytest.mark.parametrize(("speed", "timeout_ms"), [(1.0, REAL_TIME_MS), (100.0, 5000)])
def test_the_watchdog_is_fed_through_a_run_at_any_speed(speed: float, timeout_ms: int) -> None:
    """At 1x with 3 s and at 100x with 5 s of the board's time, a healthy host never trips it."""
    rig = ControllerRig(speed=speed).running()
    assert rig.control.board.feeder.armed_ms == timeout_ms
    assert rig.run(300, lambda: rig.state is SessionState.IDLE)
    assert rig.ends == [RunEnding(RunEnd.FINISHED)]


@pytest.mark.fault(26, how="the host stalls for 0.5 s and 5 s", times=2)
def test_a_stall_of_the_host_is_survived_or_vented() -> None:
    """Half a second costs nothing; five seconds, and the board has vented by itself."""
    for stall_s, survives in ((0.5, True), (5.0, False)):
        rig = ControllerRig().running(dataclasses.replace(QUICK, cycles=3))
        rig.run(2.0)
        rig.stalled = True
        rig.run(stall_s)
        assert vented(rig) is not survives
        rig.stalled = False
        rig.run(1.0)
        assert (rig.state is SessionState.RUNNING) is survives


@pytest.mark.fault(16, how="virtual board's `frozen_channel` in a run", times=1)
def test_a_frozen_channel_is_reported_and_the_run_continues() -> None:
    """An alarm, not a vent: the pressure is safe, the operator decides."""
    rig = ControllerRig("frozen_channel@2:1").running()
    rig.run(30, lambda: bool(rig.reports(["flat_line"])))
    assert [note.value for note in rig.reports(["flat_line"])] == [1]
    assert rig.state is SessionState.RUNNING


def test_goodbye_leaves_the_board_at_rest() -> None:
    """Leaving vents, disarms the watchdog and stops the samples: the board does not end in FAULT afterwards."""
    rig = ControllerRig().running()
    rig.run(3.0)
    rig.do(rig.control.leave)
    rig.run(10.0)
    assert vented(rig)
    assert rig.board._control.state is BoardState.VENTED
    assert rig.ends == [RunEnding(RunEnd.STOPPED)]


def test_a_listener_sends_nothing_but_start() -> None:
    """A link that cannot command is refused a plan with the reason, and sends no vent."""
    rig = ControllerRig()
    rig.control.board.can_command = False
    rig.connected()
    with pytest.raises(RequestError, match="read only"):
        rig.control.arm(QUICK)
    rig.do(rig.control.vent, rig.control.leave)
    assert not rig.sent_of(Vent) and not rig.sent_of(Heartbeat) and not rig.sent_of(SetLimits)


@pytest.mark.parametrize("commands", [True, False])
def test_only_a_board_that_takes_commands_needs_limits(commands: bool) -> None:
    """A pasted RX8 line, which takes no commands, was refused because its board's limits are 0 to 0 kPa."""
    rig = ControllerRig()
    rig.control.board.can_command = commands
    rig.do(lambda: rig.control.preflight.take_limits(0.0, 0.0))
    assert [note.kind for note in rig.notes] == ["limits"] * commands


def test_a_board_that_resets_after_its_first_hello_is_introduced_again() -> None:
    """It answers, boots for a second, sends HELLO again: limits and START are sent again, and samples arrive."""
    rig = ControllerRig()
    rig.step()
    rig.board._boot_at_us = rig.board.now_us + 1_000_000
    rig.board._sampler.stop()
    rig.connected()
    assert len(rig.sent_of(SetLimits)) == 2 and rig.state is SessionState.IDLE


def test_a_vent_between_start_and_its_acknowledgements_cancels_the_run() -> None:
    """Start, then vent before limits and watchdog are acknowledged: no pressure ever leaves."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start, rig.control.vent)
    rig.run(2.0)
    assert not rig.sent_of(SetPressure) and rig.state is SessionState.IDLE


@pytest.mark.fault(4, how="an implausible sample during a manual pressure", times=1)
def test_a_trip_vents_a_manual_pressure() -> None:
    """Without a run as well: after an invalid sample VENT is sent although the board reports no fault."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.set_pressure(20.0, 20.0))
    rig.run(3.0)
    rig.fault("absurd_value", 1)
    rig.run(2.0)
    assert rig.state is SessionState.FAULT and rig.sent_of(Vent) and vented(rig)


@pytest.mark.fault(17, how="every answer lost for five seconds", times=1)
def test_a_vent_is_repeated_until_it_is_acknowledged() -> None:
    """Five seconds in which every answer is lost: the vent is repeated until it is acknowledged."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.set_pressure(20.0, 20.0))
    rig.run(3.0)
    rig.fault("ack_lost", 12)
    rig.do(rig.control.vent)
    rig.run(10.0)
    sent = len(rig.sent_of(Vent))
    assert sent > 1 and not rig.control.board.venting
    rig.run(5.0)
    assert len(rig.sent_of(Vent)) == sent


def test_a_restart_not_yet_seen_leaves_no_unwatched_pressure() -> None:
    """The board restarts, a pressure was already sent, and then the host is killed: vented all the same."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.set_pressure(20.0, 20.0))
    rig.run(3.0)
    rig.fault("reset", 0)
    rig.do(lambda: rig.control.set_pressure(40.0, 40.0))
    rig.host_alive = False
    rig.run(1.0 + 1.5)
    assert vented(rig)


def test_sampled_time_goes_on_over_a_restart() -> None:
    """The time in the header went back from 0:43 to 0:29; a clock that begins anywhere adds nothing."""
    rig = ControllerRig().connected()
    rig.run(5.0)
    before = rig.control.sampled_us
    rig.fault("reset", 0)
    rig.run(3.0)
    assert before < rig.control.sampled_us <= before + 3_100_000
    time_us = np.array([64_000_000, 64_010_000, 3_622_000_000, 3_622_010_000])
    ahead = Columns(time_us, *(np.zeros((4, 2)),) * 3, *(np.zeros(4, np.uint8),) * 2)
    assert passed_us(ahead, 63_990_000, 2.5) == (30_000, 3557.99)


def answer(rig: ControllerRig, command: object, status: AckStatus) -> None:
    """The board's answer, as the link reports it."""
    rig.control.events([CommandDone(command, 0, status)], rig.now_ns)
    rig.flush()


def test_a_refused_start_is_named_with_its_remedy() -> None:
    """Why no samples arrive: cause and remedy of the refusal; none once they do."""
    rig = ControllerRig()
    rig.control.hold_samples = True
    rig.run(0.5)
    answer(rig, Start(100), AckStatus.OUT_OF_LIMITS)
    assert rig.control.no_samples is not None
    cause, remedy = rig.control.no_samples
    assert "refused START" in cause and "100 Hz" in cause and "rate" in remedy
    rig.do(rig.control.release_samples)
    rig.connected()
    assert rig.control.no_samples is None


@pytest.mark.parametrize("command", [Heartbeat(1000), SetLimits(-1, 1)])
def test_a_refused_guard_is_an_error_once_it_matters(command: Heartbeat | SetLimits) -> None:
    """At the greeting it forbids nothing yet; before a pressure it is an error, once, with its remedy."""
    rig = ControllerRig().connected()
    answer(rig, command, AckStatus.OUT_OF_LIMITS)
    assert [note.level for note in rig.reports({"refused"})] == ["info"]
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start)
    answer(rig, command, AckStatus.OUT_OF_LIMITS)
    assert [note.level for note in rig.reports({"refused"})] == ["info", "error"]
    assert rig.reports({"refused"})[-1].remedy


@pytest.mark.parametrize("by", ["the operator", "`record` before its run"])
def test_who_cleared_a_fault_is_in_the_recording(by: str) -> None:
    """A program that clears a fault by itself does not record it as cleared by the operator."""
    rig = ControllerRig("estop@4:3").running()
    rig.run(RUN_S, lambda: rig.state is SessionState.FAULT)
    rig.run(5.0)
    rig.do(lambda: rig.control.clear_fault(by))
    rig.run(1.0)
    assert [note.text for note in rig.reports({"fault_cleared"})] == [f"fault cleared by {by}"]


def test_a_goodbye_answered_late_leaves_the_watchdog_off() -> None:
    """While the disarming waits for its turn, no heartbeat arms the watchdog again."""
    rig = ControllerRig("ack_late@3:200").connected()
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start)
    rig.run(RUN_S, lambda: rig.state is SessionState.IDLE)
    rig.do(rig.control.leave)
    rig.run(3.0)
    assert rig.sent_of(Heartbeat)[-1] == Heartbeat(0)
    assert rig.board._control.watchdog_us is None
    rig.run(6.0)
    assert rig.board._control.state is BoardState.VENTED


def test_a_board_that_vents_by_itself_ends_what_it_held() -> None:
    """It ramped on at 0 kPa until the step timed out, and by hand for ever: a board vented without an event."""
    for prepare in (lambda b: b.running(), lambda b: b.do(lambda: b.control.set_pressure(20.0, 20.0))):
        rig = ControllerRig().connected()
        prepare(rig)
        rig.run(1.0)
        assert rig.control.interlock.latched is None and abs(rig.pressure_kpa) > 5
        rig.board._control._vent()
        rig.run(0.2)
        assert rig.state is SessionState.FAULT
        assert [note.text for note in rig.reports(["board_vented"])] == ["the board vented by itself"]


def test_a_new_pressure_right_after_a_vent_is_no_board_that_vented() -> None:
    """Samples from between the two commands still report a vented board."""
    rig = ControllerRig("ack_late@0:200").connected()
    rig.do(lambda: rig.control.set_pressure(20.0, 20.0))
    rig.run(3.0)
    rig.do(rig.control.vent)
    rig.run(1.0, lambda: abs(rig.pressure_kpa) < 0.5)
    rig.run(2.0)
    rig.do(lambda: rig.control.set_pressure(30.0, 20.0))
    rig.run(3.0)
    assert (rig.control.interlock.latched, round(rig.pressure_kpa)) == (None, 30)


def test_a_clock_that_goes_forward_ends_a_run() -> None:
    """A run went on over it, or ended as a leak: "50 kPa was not reached in time". At rest it is a warning."""
    for prepare, state in ((lambda b: b.running(), SessionState.FAULT), (lambda b: None, SessionState.IDLE)):
        rig = ControllerRig().connected()
        prepare(rig)
        rig.run(1.0)
        before_us, stream = rig.control.sampled_us, rig.link._stream
        stream._time += 5_000_000
        rig.run(0.5)
        assert rig.state is state and rig.control.sampled_us < before_us + 600_000
        assert [note.text for note in rig.reports(["board_clock"])] == ["the board's clock went forward by 5.01 s"]


def test_a_fault_is_not_cleared_while_no_data_arrive() -> None:
    """Cleared, it was "Idle" while nothing told what the pressure was."""
    rig = ControllerRig("silent@3:20").running()
    assert rig.run(6.0, lambda: rig.state is SessionState.FAULT)
    with pytest.raises(RequestError, match="nothing tells"):
        rig.control.clear_fault()


def test_a_vent_that_reached_no_board_is_repeated_when_it_is_back() -> None:
    """It was "vented by the operator" although nothing was sent; a board without watchdog held its pressure on."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.set_pressure(20.0, 20.0))
    rig.run(3.0)
    rig.plugged = False
    rig.control.last = dataclasses.replace(rig.control.last, flags=SampleFlag(0))  # no watchdog
    rig.control.link_lost("the port is gone")
    rig.flush()
    assert rig.reports(["link_lost"])[0].remedy == f"{AGAIN}; no watchdog vents the unit"
    rig.do(lambda: rig.control.vent(unreachable=True))
    assert [note.text for note in rig.reports(["vent"])] == ["VENT was not sent: no board is connected"]
    rig.board._control._timeout_us = 0  # no watchdog
    sent = len(rig.sent_of(Vent))
    rig.replug()
    rig.run(1.0)
    assert len(rig.sent_of(Vent)) > sent and vented(rig)


def test_a_burst_of_late_samples_leaves_the_watchdog_of_a_real_board_armed() -> None:
    """After two seconds that arrived at once it looked like a virtual board, whose watchdog is off at rest."""
    rig = ControllerRig().connected()
    rig.control.board._simulated = False
    rig.do(rig.control.board.adopt_watchdog)
    rig.run(5.0)
    rig.stalled = True
    rig.run(2.2)
    late, rig.buffer, rig.stalled = rig.buffer, b"", False
    for i in range(0, len(late), 1000):
        rig.now_ns += 6_000_000
        rig.control.events(rig.link.receive(late[i : i + 1000], rig.now_ns), rig.now_ns)
        rig.flush()
    rig.run(2.0)
    assert Heartbeat(0) not in rig.sent
