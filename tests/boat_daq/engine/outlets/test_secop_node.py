"""The SECoP node in random orders of requests, faults and timings: what holds for the buttons holds for clients."""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import invariant, rule

from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.engine.outlets.secop_node import SecopNode
from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from protocol.base.errors import RequestError
from protocol.link.messages import SetPressure, Vent
from protocol.recording import channels_of, sample_dtype
from tests.boat_daq.engine.control.test_controller_random_orders import ORDERS, Operators
from tests.boat_daq.engine.controller_rig import QUICK, ControllerRig

LINES = {
    "arm": 'do sequence:_arm "calibration"', "start": "do sequence:_start", "pause": "do sequence:_pause",
    "resume": "do sequence:_resume", "stop": "do sequence:_abort", "vent": "do vent:_vent",
    "clear_fault": "do sequence:clear_errors",
}  # fmt: skip
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=60)


class RigSession:
    """A session on a rig without threads."""

    def __init__(self, rig: ControllerRig) -> None:
        self.rig, self.live = rig, SimpleNamespace(ring=None)
        self.snapshot_of: dict[str, Any] = {}  # what a test shows instead
        for name in ("disarm", "start", "pause", "resume", "stop", "vent", "clear_fault", "set_pressure"):
            setattr(self, name, getattr(rig.control, name))

    def arm(self, _: Plan) -> None:
        self.rig.control.arm(QUICK)

    def snapshot(self) -> SessionSnapshot:
        control = self.rig.control
        link, latched = LinkState.UP if control.up else LinkState.LOST, control.interlock.latched
        seen = SessionSnapshot(
            control.sequencer.state,
            link,
            last=control.last,
            limits=control.interlock.limits,
            latched=latched.cause if latched else "",
            run_ended=control.sequencer.ended,
            progress=control.sequencer.progress(),
        )
        return dataclasses.replace(seen, **self.snapshot_of)

    def start_recording(self, path: Path) -> None:
        raise RequestError(f"{path} is not recorded here", "use a session")

    def stop_recording(self) -> None:
        self.rig.control.stop()


class Clients(Operators):
    """Two clients, one of which may only read, in place of the operator."""

    @functools.cached_property
    def nodes(self) -> tuple[SecopNode, SecopNode]:
        session = RigSession(self.rig)
        return SecopNode(session, Path("none"), allow_control=True), SecopNode(session, Path("none"))

    def press(self, button: Any, *arguments: Any, **options: Any) -> None:
        """Send the line of a button; a refusal has a class of the protocol."""
        name = button.__name__
        if name == "set_pressure":
            self.lines(f"change pressure:_ramp {arguments[1]}", f"change pressure:target {arguments[0]}")
        else:
            self.lines(LINES[name])

    def lines(self, *lines: str, control: bool = True) -> None:
        node = self.nodes[0 if control else 1]
        for line in lines:
            answers = list(node.answer(line, may_control=True))
            self.rig.flush()
            assert answers
            if answers[-1].startswith("error_"):
                assert len(json.loads(answers[-1].split(" ", 2)[2])) == 3

    @rule(action=st.sampled_from(sorted(LINES.values())))
    def a_reader_tries(self, action: str) -> None:
        """A client without control changes nothing, except that VENT is obeyed."""
        before = len(self.rig.sent)
        self.lines(action, "change pressure:target 20", control=False)
        if action != LINES["vent"]:
            assert self.rig.sent[before:] == []

    @rule(text=TEXT, start=st.sampled_from(["", "do ", "change pressure:target ", "do sequence:_arm "]))
    def garbage(self, text: str, start: str) -> None:
        """No line raises."""
        self.lines(start + text.replace("\n", " "))

    @rule()
    def read_all(self) -> None:
        for node in self.nodes:
            assert all(line.startswith(("update ", "error_update ")) for line in node.updates().values())
            json.dumps(node.description())

    @invariant()
    def values_are_json(self) -> None:
        if hasattr(self, "rig"):
            answer = next(self.nodes[1].answer("read sequence:status"))
            assert answer.startswith("reply ")


def test_extra_channels_are_modules_that_are_only_read() -> None:
    """Each has its unit and its newest value, none where it has none; no two names differ in their case alone."""
    rig = ControllerRig().connected()
    session = RigSession(rig)
    extra = channels_of([("temperature", "degC"), ("flow", "L/min"), ("vent", "")])
    session.live.ring = RingBuffer(2, mv_per_count=1.0, others=extra)
    node = SecopNode(session, Path("none"), allow_control=True)
    assert list(node.modules)[-3:] == ["temperature_degc", "flow_l_per_min", "channel_vent"]
    assert next(node.answer("read channel_vent")).startswith('error_read channel_vent ["Impossible"')
    samples = np.zeros(2, sample_dtype(2, "counts", 3))
    samples["channel"] = [[20.0, 1.0, 4.0], [21.5, np.nan, 5.0]]
    session.live.ring.append(samples)
    for module, value, unit in (
        ("temperature_degc", 21.5, "degC"),
        ("channel_vent", 5.0, None),
    ):
        about = node.description()["modules"][module]
        assert about["accessibles"]["value"]["datainfo"] == {"type": "double", **({"unit": unit} if unit else {})}
        assert about["accessibles"]["value"]["readonly"]
        assert json.loads(next(node.answer(f"read {module}")).split(" ", 2)[2])[0] == pytest.approx(value)
        assert next(node.answer(f"change {module}:value 1", may_control=True)).startswith(
            f'error_change {module}:value ["ReadOnly"'
        )
    assert next(node.answer("read flow_l_per_min")).startswith('error_read flow_l_per_min ["Impossible"')
    assert node.updates()["flow_l_per_min:value"].startswith("error_update flow_l_per_min:value")


def test_a_lost_link_gives_no_value_as_one_of_now() -> None:
    """What was measured last is an error until the board sends again; the state of the run and VENT are there."""
    rig = ControllerRig().connected()
    node = SecopNode(RigSession(rig), Path("none"))
    assert next(node.answer("read s1")).startswith("reply s1 ")
    rig.plugged = False
    rig.do(lambda: rig.control.link_lost("the port is gone"))
    for where in ("s1:value", "pressure:value", "pressure:target", "vent:value", "elongation:value"):
        assert next(node.answer(f"read {where}")).startswith(f'error_read {where} ["CommunicationFailed"')
        assert node.updates()[where].startswith(f'error_update {where} ["CommunicationFailed"')
    assert next(node.answer("read s1:status")).startswith('reply s1:status [[400, "lost"]')
    assert next(node.answer("read sequence:value")).startswith("reply sequence:value")
    assert next(node.answer("do vent:_vent")).startswith("done vent:_vent")
    rig.replug()
    rig.connected()
    assert next(node.answer("read s1")).startswith("reply s1 ")


def test_every_value_follows_the_board_and_the_run() -> None:
    """Before, while and after a pressure is commanded, in a run, and latched; a refusal names the remedy."""
    rig = ControllerRig()
    before = SecopNode(RigSession(rig), Path("none"))
    assert list(before.modules)[:4] == ["s1", "s2", "elongation", "pressure"]  # nothing has been measured yet
    assert next(before.answer("read pressure:target")).startswith("error_read pressure:target")
    rig.connected()
    session = RigSession(rig)
    node = SecopNode(session, Path("none"), allow_control=True, elongation=lambda mv: (mv[0], mv[1], True))

    def ask(line: str) -> list[Any]:
        answer: list[Any] = json.loads(next(node.answer(line, may_control=True)).split(" ", 2)[2])
        rig.flush()
        return answer

    def values(*names: str) -> list[Any]:
        return [ask(f"read {name}")[0] for name in names]

    s1, s2 = session.snapshot().last.signal_mv
    assert values("s1", "s2", "elongation", "elongation:_uncertainty") == [s1, s2, s1, s2]
    assert values("elongation:_uncertainty_stand_in", "pressure:status") == [True, [100, "idle"]]
    assert values("pressure:target", "pressure:_ramp", "vent") == [0.0, 5.0, False]
    assert values("s1:status", "recording", "recording:_file") == [[100, ""], False, ""]
    assert values("sequence:status", "sequence:_progress", "sequence:_plan") == [[100, "idle"], 0.0, ""]
    assert ask("change pressure:_ramp 0.05")[:2] == ["RangeError", "0.05 is outside 0.1 to 100"]
    assert ask("do pressure:stop")[0] is None  # nothing moves: nothing is sent
    assert rig.sent_of(SetPressure) == []
    assert ask("change pressure:target 10")[0] == 10.0
    rig.run(1.0)
    assert values("pressure:status", "pressure:target", "vent") == [[300, "ramping"], 10.0, False]
    assert ask("do pressure:stop")[0] is None
    held = rig.sent_of(SetPressure)[-1]
    assert 3.0 < held.target_pa / 1000 < 7.0
    assert held.target_pa / 1000 == pytest.approx(session.snapshot().last.pressure_kpa, abs=0.01)
    rig.run(3.0)
    assert values("pressure:status") == [[100, "holding"]]
    ask("do vent:_vent")
    rig.run(3.0)
    assert values("pressure:status", "pressure:target", "vent") == [[100, "vented"], 0.0, True]
    for name in ("run", "run.boat"):
        assert ask(f'do recording:_start "{name}"')[1] == "none/run.boat is not recorded here; use a session"
    progress = node.description()["modules"]["sequence"]["accessibles"]["_progress"]["datainfo"]
    assert progress == {"type": "double", "min": 0.0, "max": 1.0}
    ask('do sequence:_arm "calibration"')
    ask("do sequence:_start")
    rig.run(2.0)
    status, done = values("sequence:status", "sequence:_progress")
    seen = session.snapshot().progress
    assert (status, done) == ([300, "running"], seen.elapsed_s / (seen.elapsed_s + seen.time_left_s))
    rig.fault("estop", 1.0)
    rig.run(1.0)
    latched = session.snapshot().latched
    assert latched and values("s1:status", "pressure:status", "sequence:status") == 3 * [[400, latched]]


def test_what_may_be_changed_is_described_and_checked_against_the_limits_of_now() -> None:
    """Names that do not exist are cut; a limit that a plan tightened holds although it is not described."""
    rig = ControllerRig().connected()
    session = RigSession(rig)
    reader = SecopNode(session, Path("none")).description()["modules"]["pressure"]
    node = SecopNode(session, Path("none"), allow_control=True)
    driver = node.description()["modules"]["pressure"]
    assert (reader["accessibles"]["target"]["readonly"], driver["accessibles"]["target"]["readonly"]) == (True, False)
    assert (reader["accessibles"]["value"]["readonly"], driver["accessibles"]["value"]["readonly"]) == (True, True)
    assert (reader["interface_classes"], driver["interface_classes"]) == (["Readable"], ["Drivable"])
    commands = node.description()["modules"]["sequence"]["accessibles"]
    assert commands["_arm"]["datainfo"] == {"type": "command", "argument": {"type": "string"}}
    assert commands["_start"]["datainfo"] == {"type": "command"}

    def ask(line: str) -> list[Any]:
        answer: list[Any] = json.loads(next(node.answer(line, may_control=True)).split(" ", 2)[2])[:2]
        return answer

    long, cut = "x" * 40, f"{'x' * 32!r}"
    assert ask(f"read {long}") == ["NoSuchModule", f"there is no module {cut}"]
    assert ask(f"read s1:{long}") == ["NoSuchParameter", f"there is no parameter {cut}"]
    assert ask(f"do s1:{long}") == ["NoSuchCommand", f"there is no command {cut}"]
    assert ask(f'do sequence:_arm "{long}"')[1].startswith(f"there is no plan {cut}; there are ")
    for length in (200, 201):
        assert ask(f'do sequence:_arm "{"x" * length}"')[0] == ("RangeError" if length == 200 else "WrongType")
    assert ask("change pressure:target 1e300")[0] == ask('do sequence:_arm "a\\u0007"')[0] == "WrongType"
    assert ask("change pressure:target 9e299")[0] == "RangeError"
    limits = session.snapshot().limits
    for kpa in (limits.min_kpa, limits.max_kpa):
        assert ask(f"change pressure:target {kpa}")[0] == kpa
        assert ask(f"change pressure:target {1.001 * kpa}")[0] == "RangeError"
    session.snapshot_of = {"limits": dataclasses.replace(limits, min_kpa=-5.0, max_kpa=20.0)}
    for kpa in (-5.0, 20.0):
        assert ask(f"change pressure:target {kpa}")[0] == kpa
        beyond = f"{1.01 * kpa:g} is outside -5 to 20 kPa".replace(" is", " kPa is")
        assert ask(f"change pressure:target {1.01 * kpa}") == ["RangeError", beyond]


def test_only_a_pressure_that_a_client_left_is_vented() -> None:
    """Not one that the window set since, and not in a run."""
    rig = ControllerRig().connected()
    session = RigSession(rig)
    node = SecopNode(session, Path("none"), allow_control=True)

    def set_by_client() -> None:
        assert next(node.answer("change pressure:target 10", may_control=True)).startswith("changed")
        rig.flush()
        rig.run(1.0)

    set_by_client()
    rig.do(lambda: session.set_pressure(12.0, 5.0))
    rig.run(1.0)
    node.vent_abandoned(30.0)
    assert rig.sent_of(Vent) == []
    set_by_client()
    for state in (SessionState.RUNNING, SessionState.PAUSED):
        session.snapshot_of = {"state": state}
        node.vent_abandoned(30.0)
        rig.flush()
        assert rig.sent_of(Vent) == []
    session.snapshot_of = {"last": None}
    node.vent_abandoned(30.0)
    session.snapshot_of = {}
    node.vent_abandoned(30.0)
    rig.flush()
    assert len(rig.sent_of(Vent)) == 1


class TestRandomRequests(Clients.TestCase):  # type: ignore[misc, name-defined]
    """What every change must pass."""

    settings = settings(ORDERS, max_examples=5)


@pytest.mark.nightly
@pytest.mark.timeout(3 * 3600)
class TestTenThousandRandomRequests(Clients.TestCase):  # type: ignore[misc, name-defined]
    """The same, ten thousand times."""

    settings = settings(ORDERS, max_examples=10_000)
