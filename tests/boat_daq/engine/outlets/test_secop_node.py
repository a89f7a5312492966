"""The SECoP node in random orders of requests, faults and timings: what holds for the buttons holds for clients."""

from __future__ import annotations

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
from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from protocol.base.errors import RequestError
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
        for name in ("disarm", "start", "pause", "resume", "stop", "vent", "clear_fault", "set_pressure"):
            setattr(self, name, getattr(rig.control, name))

    def arm(self, _: Plan) -> None:
        self.rig.control.arm(QUICK)

    def snapshot(self) -> SessionSnapshot:
        control = self.rig.control
        link, latched = LinkState.UP if control.up else LinkState.LOST, control.interlock.latched
        return SessionSnapshot(
            control.sequencer.state,
            link,
            last=control.last,
            limits=control.interlock.limits,
            latched=latched.cause if latched else "",
            run_ended=control.sequencer.ended,
            progress=control.sequencer.progress(),
        )

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


def test_a_pressure_is_busy_until_it_holds() -> None:
    """Its status follows the board; before, no pressure is commanded, and a refusal names the remedy."""
    rig = ControllerRig().connected()
    node = SecopNode(RigSession(rig), Path("none"), allow_control=True)

    def ask(line: str) -> list[Any]:
        answer: list[Any] = json.loads(next(node.answer(line, may_control=True)).split(" ", 2)[2])
        rig.flush()
        return answer

    assert ask("read pressure:status")[0] == [100, "idle"]
    assert ask("read pressure:target")[0] == 0.0
    assert ask("change pressure:_ramp 0.05")[:2] == ["RangeError", "0.05 is outside 0.1 to 100"]
    assert ask("change pressure:target 10")[0] == 10.0
    rig.run(1.0)
    assert ask("read pressure:status")[0] == [300, "ramping"]
    assert ask("read pressure:target")[0] == 10.0
    rig.run(3.0)
    assert ask("read pressure:status")[0] == [100, "holding"]
    assert ask('do recording:_start "run"')[1] == "none/run.boat is not recorded here; use a session"
    progress = node.description()["modules"]["sequence"]["accessibles"]["_progress"]["datainfo"]
    assert progress == {"type": "double", "min": 0.0, "max": 1.0}
    assert list(node.modules)[:3] == ["s1", "s2", "elongation"]


class TestRandomRequests(Clients.TestCase):  # type: ignore[misc, name-defined]
    """What every change must pass."""

    settings = settings(ORDERS, max_examples=5)


@pytest.mark.nightly
@pytest.mark.timeout(3 * 3600)
class TestTenThousandRandomRequests(Clients.TestCase):  # type: ignore[misc, name-defined]
    """The same, ten thousand times."""

    settings = settings(ORDERS, max_examples=10_000)
