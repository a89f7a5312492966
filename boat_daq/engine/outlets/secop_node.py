"""A SECoP node: the session as modules that sample-environment clients read and, where it is allowed, drive.

Strategy: no input or output here. A line of a client becomes one call of `Session` and one line in answer, so that
every rule of the interlock and the pre-flight check holds as it does for a button; what carries the lines
(`secop_server`) decides only who may send them. Values are those of the session's snapshot.

Rules: without `allow_control`, and of a client without the token, every command but VENT is refused.
What a client sends is JSON of a bounded line, checked against the type that the description states.

Source: SECoP specification 1.0 (sampleenvironment.github.io/secop-site); the error classes are its own.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from boat_daq.engine.file_names import path_in
from boat_daq.engine.plan import Plan, built_in_plans
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from protocol.base.errors import BoatDaqError, DeviceError, StorageError
from protocol.recording import BoardState, ExtraChannel

if TYPE_CHECKING:
    from boat_daq.engine.session.session import Session

IDENT = "ISSE&SINE2020,SECoP,V2019-09-16,v1.0"
MAX_LINE = 8192  # bytes of a request
_IDLE, _BUSY, ERROR = 100, 300, 400
_CODES = {"IDLE": _IDLE, "BUSY": _BUSY, "ERROR": ERROR}
_STATUS = {"type": "tuple", "members": [{"type": "enum", "members": _CODES}, {"type": "string"}]}
_STATES = {str(state): number for number, state in enumerate(SessionState)}
_REQUEST = re.compile(r"([a-z*][A-Za-z?_]{0,31})(?: (\S*)(?: (.*))?)?", re.DOTALL)
_WORD = re.compile(r"[\w:.]{1,80}", re.ASCII)


class SecopError(Exception):
    """A refusal, by the class that the protocol names."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__(text)
        self.name = name


@dataclass(frozen=True, slots=True)
class _Parameter:
    """A value of a module: its type, how it is read, and how it is changed; None where it cannot be.

    What is measured is known while the board sends: the last value of a lost link is not given as one of now.
    """

    text: str
    datainfo: Mapping[str, Any]
    read: Callable[[SessionSnapshot], Any]
    change: Callable[[Any], None] | None = None
    measured: bool = False

    def value(self, seen: SessionSnapshot) -> Any:
        """Return the value now.

        Raises
        ------
        SecopError : there is none.
        """
        if self.measured and seen.link is not LinkState.UP:
            raise SecopError("CommunicationFailed", f"the board does not send: the link is {seen.link}")
        found = self.read(seen)
        if isinstance(found, float) and not math.isfinite(found):
            raise SecopError("Impossible", "there is no value now")
        return found


@dataclass(frozen=True, slots=True)
class _Command:
    """A command of a module: the type of its argument, None for none, and what it does."""

    text: str
    run: Callable[..., Any]
    argument: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class _Module:
    """A module: its class in the protocol and what can be accessed."""

    text: str
    kind: str
    parameters: Mapping[str, _Parameter]
    commands: Mapping[str, _Command] = field(default_factory=dict)


Elongation = Callable[[tuple[float, ...]], tuple[float, float, bool]]  # mm, U, whether U rests on a stand-in


class SecopNode:
    """The modules of one session. `elongation`: of signals, see `Elongation`; None without a calibration."""

    def __init__(
        self,
        session: Session,
        recordings: Path,
        *,
        allow_control: bool = False,
        elongation: Elongation | None = None,
        plans: Callable[[], Mapping[str, Plan]] = built_in_plans,
    ) -> None:
        self._session, self._recordings, self._elongation, self._plans = session, recordings, elongation, plans
        self.allow_control = allow_control
        self._ramp_kpa_per_s = 5.0
        self._target_set_kpa = math.nan  # by a client
        seen = session.snapshot()
        sensors = len(seen.last.signal_mv) if seen.last else 2
        ring = session.live.ring
        others = ring.others if ring is not None else ()
        self.modules = {f"s{n}": self._sensor(n) for n in range(1, sensors + 1)} | {
            "elongation": self._elongation_module(),
            "pressure": self._pressure(seen),
            "sequence": self._sequence(),
            "vent": self._vent(),
            "recording": self._recording(),
        }
        self.modules |= self._channels(others)
        self._simulated = seen.simulated
        self._name = f"boat-daq.{seen.hello.board_id if seen.hello else 'board'}"

    # ---- what a client sends ---------------------------------------------------------------------------------------

    def answer(self, line: str, *, may_control: bool = False) -> Iterator[str]:
        """Yield the lines that answer a request, in order; `activate` and `deactivate` are the carrier's to act on.

        `may_control`: whether this client has sent the token.
        """
        found = _REQUEST.fullmatch(line.strip())
        action, where, data = (found[1], found[2] or "", found[3]) if found else ("request", "", None)
        try:
            yield from self._answer(action, where, data, may_control=may_control)
        except SecopError as error:
            yield self._error(action, where, error.name, str(error))
        except BoatDaqError as error:
            name = {DeviceError: "CommunicationFailed", StorageError: "HardwareError"}.get(type(error), "Impossible")
            yield self._error(action, where, name, f"{error.cause}; {error.remedy}" if error.remedy else error.cause)

    def updates(self, where: str = "") -> dict[str, str]:
        """Return an update of every parameter, or of those of one module, by name."""
        seen, now_s = self._session.snapshot(), time.time()
        chosen = {where.partition(":")[0]: self._module(where)} if where else self.modules
        found = {}
        for name, module in chosen.items():
            for key, parameter in module.parameters.items():
                where = f"{name}:{key}"
                try:
                    found[where] = f"update {where} {_json([parameter.value(seen), {'t': now_s}])}"
                except SecopError as error:
                    found[where] = f"error_update {where} {_json([error.name, str(error), {'t': now_s}])}"
        return found

    def _answer(self, action: str, where: str, data: str | None, *, may_control: bool) -> Iterator[str]:
        match action:
            case "*IDN?":
                yield IDENT
            case "describe":
                yield f"describing . {_json(self.description())}"
            case "ping":
                yield f"pong {where} {_json([None, {'t': time.time()}])}"
            case "activate":
                yield from self.updates(where).values()
                yield f"active {where}".rstrip()
            case "deactivate":
                yield f"inactive {self._known(where)}".rstrip()
            case "read":
                yield f"reply {where} {self._value(where, 'value')}"
            case "change":
                value = self._change(where, data, may_control=may_control)
                yield f"changed {where} {_json([value, {'t': time.time()}])}"
            case "do":
                result = self._do(where, data, may_control=may_control)
                yield f"done {where} {_json([result, {'t': time.time()}])}"
            case "logging":
                yield f'logging {self._known(where)} "off"'  # whatever was requested: nothing is logged to clients
            case "help":
                yield "helping 1 " + _json("*IDN? describe activate deactivate ping read change do")
            case _:
                raise SecopError("ProtocolError", "there is no such request")

    def description(self) -> dict[str, Any]:
        """Return the description of the node."""
        about = "A board for soft optical sensors in a pneumatic actuator, by boat-daq."
        return {
            "modules": {name: self._described(module) for name, module in self.modules.items()},
            "equipment_id": self._name,
            "firmware": "boat-daq",
            "description": f"SIMULATED. {about}" if self._simulated else about,
        }

    def _described(self, module: _Module) -> dict[str, Any]:
        parameters = {
            key: {"description": p.text, "datainfo": p.datainfo, "readonly": p.change is None or not self.allow_control}
            for key, p in module.parameters.items()
        }
        commands = {
            key: {
                "description": command.text,
                "datainfo": {"type": "command"} | ({"argument": command.argument} if command.argument else {}),
            }
            for key, command in module.commands.items()
        }
        kind = module.kind if self.allow_control else "Readable"
        return {"accessibles": parameters | commands, "description": module.text, "interface_classes": [kind]}

    def vent_abandoned(self, hold_s: float) -> None:
        """Vent a pressure whose client left `hold_s` ago; a run, or a pressure of the window, is left alone."""
        seen = self._session.snapshot()
        running = seen.state in (SessionState.RUNNING, SessionState.PAUSED)
        if not running and seen.last is not None and seen.last.target_kpa == self._target_set_kpa:
            self._session.vent(f"vented: the SECoP client that set the pressure left {hold_s:g} s ago")

    # ---- inside ----------------------------------------------------------------------------------------------------

    def _error(self, action: str, where: str, name: str, text: str) -> str:
        echoed = where if _WORD.fullmatch(where) else "."  # nothing that would break the line
        return f"error_{action} {echoed} {_json([name, text, {}])}"

    def _module(self, where: str) -> _Module:
        name = where.partition(":")[0]
        if not name:
            raise SecopError("ProtocolError", "the name of a module is missing")
        if name not in self.modules:
            raise SecopError("NoSuchModule", f"there is no module {name[:32]!r}")
        return self.modules[name]

    def _known(self, where: str) -> str:
        if where:
            self._module(where)
        return where

    def _parameter(self, where: str, usual: str) -> _Parameter:
        key = where.partition(":")[2] if ":" in where else usual
        found = self._module(where).parameters.get(key)
        if found is None:
            raise SecopError("NoSuchParameter", f"there is no parameter {key[:32]!r}")
        return found

    def _value(self, where: str, usual: str) -> str:
        return _json([self._parameter(where, usual).value(self._session.snapshot()), {"t": time.time()}])

    def _require_token(self, *, may_control: bool) -> None:
        if not may_control:
            raise SecopError("Disabled", "control needs the token: send _authenticate TOKEN first")

    def _change(self, where: str, data: str | None, *, may_control: bool) -> Any:
        parameter = self._parameter(where, "target")
        if parameter.change is None or not self.allow_control:
            raise SecopError("ReadOnly", "this value cannot be changed; control is allowed where the program runs")
        self._require_token(may_control=may_control)
        value = _checked(_parsed(data), parameter.datainfo)
        parameter.change(value)
        return value

    def _do(self, where: str, data: str | None, *, may_control: bool) -> Any:
        module, key = self._module(where), where.partition(":")[2]
        command = module.commands.get(key)
        if command is None:
            raise SecopError("NoSuchCommand", f"there is no command {key[:32]!r}")
        if not is_vent(where):
            if not self.allow_control:
                raise SecopError("Disabled", "only VENT is accepted; control is allowed where the program runs")
            self._require_token(may_control=may_control)
        given = None if data is None or data.strip() == "null" else _parsed(data)
        if command.argument is None:
            if given is not None:
                raise SecopError("WrongType", "the command has no argument")
            return command.run()
        return command.run(_checked(given, command.argument))

    # ---- the modules -----------------------------------------------------------------------------------------------

    def _readable(self, unit: str, read: Callable[[SessionSnapshot], Any], text: str) -> dict[str, _Parameter]:
        info = {"type": "double"} | ({"unit": unit} if unit not in ("", "1") else {})
        return {
            "value": _Parameter(text, info, read, measured=True),
            "status": _Parameter("Status.", _STATUS, _link_status),
        }

    def _sensor(self, number: int) -> _Module:
        def read(seen: SessionSnapshot) -> float:
            return seen.last.signal_mv[number - 1] if seen.last and len(seen.last.signal_mv) >= number else math.nan

        return _Module(f"Sensor {number}.", "Readable", self._readable("mV", read, "Signal, lit less dark."))

    def _channels(self, channels: Iterable[ExtraChannel]) -> dict[str, _Module]:
        """Return a module of each extra channel; a name that is taken is preceded by ``channel_``."""

        def module(channel: ExtraChannel) -> _Module:
            def read(_: SessionSnapshot) -> float:
                ring = self._session.live.ring
                newest = ring.view(last=1).get(channel.column) if ring is not None else None
                return float(newest[-1]) if newest is not None and newest.size else math.nan

            return _Module(
                f"Channel of the board: {channel.title}.", "Readable", self._readable(channel.unit, read, channel.title)
            )

        taken, found = {name.lower() for name in self.modules}, {}
        for channel in channels:
            name = channel.column
            while name.lower() in taken:  # clients take no notice of the case
                name = f"channel_{name}"
            taken.add(name.lower())
            found[name] = module(channel)
        return found

    def _elongation_module(self) -> _Module:
        def read(seen: SessionSnapshot, which: int = 0) -> float:
            known = self._elongation is not None and seen.last is not None
            return (
                self._elongation(seen.last.signal_mv)[which] if known and self._elongation and seen.last else math.nan
            )

        def stands_in(seen: SessionSnapshot) -> bool:
            return bool(self._elongation and seen.last and self._elongation(seen.last.signal_mv)[2])

        parameters = self._readable("mm", read, "Elongation by the calibration; none without one or outside its range.")
        u = _Parameter(
            "Expanded uncertainty, k = 2.", {"type": "double", "unit": "mm"}, lambda seen: read(seen, 1), measured=True
        )
        mark = _Parameter("Whether the uncertainty includes a stated value.", {"type": "bool"}, stands_in)
        more = {"_uncertainty": u, "_uncertainty_stand_in": mark}
        return _Module("Elongation of the actuator.", "Readable", parameters | more)

    def _pressure(self, seen: SessionSnapshot) -> _Module:
        limits = seen.limits
        info: dict[str, Any] = {"type": "double", "unit": "kPa"}
        if limits is not None:
            info |= {"min": limits.min_kpa, "max": limits.max_kpa}

        def go(kpa: float) -> None:
            now = self._session.snapshot().limits
            if now is not None and not now.min_kpa <= kpa <= now.max_kpa:
                raise SecopError("RangeError", f"{kpa:g} kPa is outside {now.min_kpa:g} to {now.max_kpa:g} kPa")
            self._session.set_pressure(kpa, self._ramp_kpa_per_s)
            self._target_set_kpa = kpa

        def set_ramp(kpa_per_s: float) -> None:
            self._ramp_kpa_per_s = kpa_per_s

        def hold() -> None:
            last = self._session.snapshot().last
            if last is not None and last.state is BoardState.RAMPING:
                go(last.pressure_kpa)

        ramp = {"type": "double", "unit": "kPa/s", "min": 0.1, "max": 100.0}
        parameters = self._readable("kPa", lambda s: s.last.pressure_kpa if s.last else math.nan, "Gauge pressure.") | {
            "status": _Parameter("BUSY while it changes.", _STATUS, _pressure_status),
            "target": _Parameter("Commanded pressure.", info, _target_kpa, go, measured=True),
            "_ramp": _Parameter("Rate towards the target.", ramp, lambda _: self._ramp_kpa_per_s, set_ramp),
        }
        return _Module(
            "Pressure in the actuator.", "Drivable", parameters, {"stop": _Command("Hold the pressure.", hold)}
        )

    def _sequence(self) -> _Module:
        def arm(name: str) -> None:
            plans = dict(self._plans())
            if name not in plans:
                raise SecopError("RangeError", f"there is no plan {name[:32]!r}; there are {', '.join(plans)}")
            self._session.arm(plans[name])

        def fraction(seen: SessionSnapshot) -> float:
            if seen.progress is None:
                return 0.0
            return seen.progress.elapsed_s / max(seen.progress.elapsed_s + seen.progress.time_left_s, 1e-9)

        session = self._session
        states = {"type": "enum", "members": _STATES}
        names = {"type": "array", "maxlen": 1000, "members": {"type": "string"}}
        parameters = {
            "value": _Parameter("State of the run.", states, lambda seen: _STATES[str(seen.state)]),
            "status": _Parameter("Status.", _STATUS, _run_status),
            "_progress": _Parameter("Share of the run.", {"type": "double", "min": 0.0, "max": 1.0}, fraction),
            "_plan": _Parameter("Armed plan.", {"type": "string"}, lambda seen: seen.plan.name if seen.plan else ""),
            "_plans": _Parameter("Plans that can be armed.", names, lambda _: list(self._plans())),
        }
        commands = {
            "_arm": _Command("Check one of `_plans` and make it ready.", arm, {"type": "string"}),
            "_disarm": _Command("Discard the armed plan.", session.disarm),
            "_start": _Command("Run the armed plan.", session.start),
            "_pause": _Command("Vent and wait.", session.pause),
            "_resume": _Command("Continue at the next whole cycle.", session.resume),
            "_abort": _Command("End the run and vent.", session.stop),
            "clear_errors": _Command(
                "Clear a fault whose cause is gone.", lambda: session.clear_fault("a SECoP client")
            ),
        }
        return _Module("The run of a plan.", "Readable", parameters, commands)

    def _vent(self) -> _Module:
        def is_open(seen: SessionSnapshot) -> bool:
            return bool(seen.last and seen.last.state is BoardState.VENTED)

        vented = _Parameter("Whether the valve is open.", {"type": "bool"}, is_open, measured=True)
        parameters = {"value": vented, "status": _Parameter("Status.", _STATUS, _link_status)}
        return _Module("The vent valve.", "Readable", parameters, {"_vent": _Command("Vent now.", self._session.vent)})

    def _recording(self) -> _Module:
        def begin(name: str) -> None:
            self._session.start_recording(path_in(self._recordings, name if name.endswith(".boat") else f"{name}.boat"))

        parameters = {
            "value": _Parameter("Whether samples are recorded.", {"type": "bool"}, lambda s: s.recording is not None),
            "status": _Parameter("Status.", _STATUS, _link_status),
            "_file": _Parameter("Its file.", {"type": "string"}, lambda s: s.recording.name if s.recording else ""),
        }
        commands = {
            "_start": _Command("Record into a new file of this name.", begin, {"type": "string"}),
            "_stop": _Command("Close the recording; a run is stopped and vented.", self._stop_recording),
        }
        return _Module("The recording.", "Readable", parameters, commands)

    def _stop_recording(self) -> None:
        self._session.stop_recording()


def is_vent(where: str) -> bool:
    """Return whether a command is VENT, which is never refused."""
    return where == "vent:_vent"


def _link_status(seen: SessionSnapshot) -> list[Any]:
    if seen.link is LinkState.UP:
        return [ERROR, seen.latched] if seen.latched else [_IDLE, "SIMULATED" if seen.simulated else ""]
    return [ERROR, str(seen.link)]


def _pressure_status(seen: SessionSnapshot) -> list[Any]:
    if seen.link is not LinkState.UP or seen.latched:
        return _link_status(seen)
    ramping = seen.last is not None and seen.last.state is BoardState.RAMPING
    return [_BUSY, "ramping"] if ramping else [_IDLE, str(seen.last.state.name).lower() if seen.last else ""]


def _target_kpa(seen: SessionSnapshot) -> float:
    """Return the commanded pressure; 0 where none is: the unit is vented, or will be."""
    return seen.last.target_kpa if seen.last is not None and math.isfinite(seen.last.target_kpa) else 0.0


def _run_status(seen: SessionSnapshot) -> list[Any]:
    if seen.state in (SessionState.FAULT, SessionState.ABORTED):
        return [ERROR, seen.latched or (seen.run_ended.text if seen.run_ended else str(seen.state))]
    return [_BUSY if seen.state in (SessionState.RUNNING, SessionState.FINISHING) else _IDLE, str(seen.state)]


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, separators=(", ", ": "))


def _no_constant(text: str) -> Any:
    raise SecopError("BadJSON", f"{text} is not JSON")


def _parsed(data: str | None) -> Any:
    if data is None:
        raise SecopError("ProtocolError", "a value is missing")
    try:
        return json.loads(data, parse_constant=_no_constant, parse_int=float)  # of any length
    except (ValueError, RecursionError) as error:
        raise SecopError("BadJSON", "the value is not JSON") from error


def _checked(value: Any, info: Mapping[str, Any]) -> Any:
    """Return a value of the type that a description states."""
    if info["type"] == "string":
        if not isinstance(value, str) or len(value) > 200 or not value.isprintable():
            raise SecopError("WrongType", "a short text is expected")
        return value
    if not isinstance(value, float) or not abs(value) < 1e300:
        raise SecopError("WrongType", "a number is expected")
    if not info.get("min", -math.inf) <= value <= info.get("max", math.inf):
        raise SecopError("RangeError", f"{value:g} is outside {info.get('min'):g} to {info.get('max'):g}")
    return value
