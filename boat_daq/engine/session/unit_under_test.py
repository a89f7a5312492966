"""The unit under test of a session: its limits in force, also when another program changes them, and its board."""

from __future__ import annotations

import dataclasses

from boat_daq.engine.session.guarded_controller import GuardedController
from boat_daq.engine.session.journal import Journal
from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.engine.snapshot import MessageKind, SessionState
from protocol.base.errors import BoatDaqError, RequestError, StorageError
from protocol.base.units import Quantity, UnitText

_FREE = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT, SessionState.ARMED)


class UnitUnderTest:
    """Keeps the limits of one unit in force."""

    def __init__(self, library: UnitLibrary, control: GuardedController, journal: Journal) -> None:
        self.library, self.name = library, ""
        self._control, self._journal = control, journal
        self._stamp = 0  # of the file whose limits hold

    def mount(self, name: str, stamp: int) -> None:
        """Take another unit, whose limits of the file with this stamp hold already."""
        self.name, self._stamp = name, stamp

    def store(self, unit: Unit) -> None:
        """Store a unit; the limits of the one under test hold at once, and an armed plan is disarmed."""
        before = self.library.load(unit.name)
        limits, old = ((u.min_kpa, u.max_kpa) for u in (unit, before))
        under_test = unit.name == self.name
        if under_test:
            with self._control.acting() as control:
                control.use_unit_limits(limits)
        try:
            self.library.save(unit)
        except BoatDaqError:
            if under_test:
                with self._control.acting() as control:
                    control.use_unit_limits(old)
            raise

    def follow(self) -> None:
        """Take the limits of the unit where another program has changed its file; in a run, after it."""
        name, before = self.name, self._stamp
        stamp = self.library.stamp(name) if name else before
        if stamp == before:
            return
        with self._control.acting() as control:
            if control.sequencer.state not in _FREE:
                return
        self._stamp = stamp
        try:
            stored = self.library.load(name)
            with self._control.acting() as control:
                if control.use_unit_limits((stored.min_kpa, stored.max_kpa)):
                    low, high = Quantity(stored.min_kpa, "kPa", named=False), Quantity(stored.max_kpa, "kPa")
                    text = UnitText(f"the limits of unit {name} are now ", low, " to ", high)
                    self._journal.tell(MessageKind.UNIT_LIMITS, "info", text, "arm the plan again where one was armed")
        except RequestError as error:
            with self._control.lock:
                self._journal.tell(MessageKind.UNIT_LIMITS, "warning", error.cause, error.remedy)

    def remember_board(self, usb_serial: str) -> None:
        """Store the USB serial number of a real board with its unit, by which it is found again."""
        try:
            stored = self.library.load(self.name)
            if stored.usb_serial != usb_serial:
                self.library.save(dataclasses.replace(stored, usb_serial=usb_serial))
        except (RequestError, StorageError) as error:
            with self._control.lock:
                cause = f"the board's USB serial number is not stored with unit {self.name}: {error.cause}"
                self._journal.tell(MessageKind.STORAGE, "warning", cause, error.remedy)
