"""Why the interlock opens, and the wording of every fault: of a level that a sample shows, of an event of the board."""

from __future__ import annotations

from dataclasses import dataclass

from boat_daq.engine.snapshot import MessageKind
from protocol.base.units import Quantity, UnitText
from protocol.link.messages import EventCode


@dataclass(frozen=True, slots=True)
class Trip:
    """Why the interlock opened."""

    kind: MessageKind
    cause: str
    remedy: str = ""
    value: float | None = None  # in the unit of the kind: kPa for pressures
    time_us: int | None = None


_CLEAR_ESTOP = "release it when it is safe, then clear the fault"
_LOWER_SPEED = "keep this computer awake and close its other programs; lower the speed of a virtual board"
_WORDING: dict[MessageKind, tuple[str, str]] = {  # cause and remedy
    # a level of the samples; the values by name
    MessageKind.ESTOP: ("the e-stop is pressed", _CLEAR_ESTOP),
    MessageKind.PRESSURE_INVALID: (
        "the board reports its pressure sensor as invalid",
        "check the sensor and its cable",
    ),
    MessageKind.IMPLAUSIBLE: ("the pressure reads {pressure}, which no unit reaches", "check the sensor"),
    MessageKind.OVER_PRESSURE: (
        "{pressure}, more than {margin} above the limit of {high}",
        "let it vent; check the supply and its valve",
    ),
    MessageKind.UNDER_PRESSURE: (
        "{pressure}, more than {margin} below the limit of {low}",
        "let it vent; check the vacuum line and its valve",
    ),
    MessageKind.BOARD_FAULT: ("the board has latched a fault and vented", "find its cause, then clear the fault"),
    # an event of the board, with its value
    MessageKind.BOARD_OVER_PRESSURE: ("the board vented: over-pressure, {value}", "check supply and valve"),
    MessageKind.BOARD_UNDER_PRESSURE: ("the board vented: under-pressure, {value}", "check vacuum and valve"),
    MessageKind.BOARD_HEARTBEAT_LOST: ("the board vented: nothing received for {value}", _LOWER_SPEED),
    MessageKind.BOARD_ESTOP_PRESSED: ("the e-stop was pressed", _CLEAR_ESTOP),
    MessageKind.BOARD_TARGET_NOT_REACHED: (
        "the board vented: target not reached, {value}",
        "check for a leak, and that the pump runs",
    ),
}
_EVENTS: dict[int, MessageKind] = {
    EventCode.OVER_PRESSURE: MessageKind.BOARD_OVER_PRESSURE,
    EventCode.UNDER_PRESSURE: MessageKind.BOARD_UNDER_PRESSURE,
    EventCode.HEARTBEAT_LOST: MessageKind.BOARD_HEARTBEAT_LOST,
    EventCode.ESTOP_PRESSED: MessageKind.BOARD_ESTOP_PRESSED,
    EventCode.TARGET_NOT_REACHED: MessageKind.BOARD_TARGET_NOT_REACHED,
}


def trip_of_level(kind: MessageKind, pressure_kpa: float, time_us: int, **bounds_kpa: float) -> Trip:
    """Return the trip of a sample; `bounds_kpa` are `low`, `high` and `margin`."""
    cause, remedy = _WORDING[kind]
    named = {name: Quantity(kpa, "kPa") for name, kpa in bounds_kpa.items()}
    form = ".0f" if kind is MessageKind.IMPLAUSIBLE else ".1f"
    text = UnitText.filled(cause, pressure=Quantity(pressure_kpa, "kPa", form), **named)
    return Trip(kind, text, remedy, pressure_kpa, time_us)


def trip_of_event(code: EventCode | int, value: int) -> Trip | None:
    """Return the trip of an event of the board; None where the event is none."""
    kind = _EVENTS.get(code)
    if kind is None:
        return None
    cause, remedy = _WORDING[kind]
    unit = "ms" if kind is MessageKind.BOARD_HEARTBEAT_LOST else "Pa"
    return Trip(kind, UnitText.filled(cause, value=Quantity(value, unit, ".0f")), remedy, float(value))
