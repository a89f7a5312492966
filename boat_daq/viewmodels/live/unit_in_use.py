"""The live conversion from signals to elongation, by the calibration of the unit on the bench.

It is prepared on a helper thread: the analysis takes a moment to load, which must not delay the window.
"""

from __future__ import annotations

from time import monotonic

from analysis.calibration.record import CalibrationRecord
from boat_daq.engine.control.elongation import Regulator
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.viewmodels.live.connection import ConnectionModel
from boat_daq.viewmodels.live.live_model import LiveModel
from boat_daq.workflows.calibration_in_force import newest_calibration
from boat_daq.workflows.jobs import Background
from boat_daq.workflows.live_conversion import Conversion, prepare
from boat_daq.workflows.unit_control import regulator_of

_LASTING_S = 3.0
_EVERY_S = 0.5
_NONE = "none"
TEXTS = {  # cause and remedy
    "mechanics": (
        "the elongation does not fit the pressure: both sensors agree on another one",
        "Check for a leak, a load on the unit, or a change of the actuator",
    ),
    "optics": (
        "one signal does not fit the elongation that the other shows",
        "Check emitter, guide and receiver of the sensors",
    ),
    "electronics": (
        "both signals are shifted alike, as by light, supply or reference voltage",
        "Check ambient light and the board's supply",
    ),
}


class UnitInUse:
    """Keeps the live conversion in step with the unit's calibration in force."""

    def __init__(self, units: UnitLibrary, connection: ConnectionModel, live: LiveModel) -> None:
        self._units, self._connection, self._live = units, connection, live
        self.preparation: Background[Conversion] = Background("calibration")
        self.conversion: Conversion | None = None
        self._record: CalibrationRecord | None = None
        self._followed = ("", False, 0, 0)  # name, whether simulated, revision of the library, stamp of the unit's file

    def name(self, snapshot: SessionSnapshot) -> str:
        return snapshot.unit or self._connection.unit

    def texts(self, snapshot: SessionSnapshot) -> tuple[str, str, str]:
        """Return the unit alone, with its calibration, and with the date of it."""
        name, record = self.name(snapshot), self._record
        start = f"{name}  \u00b7  {'not ' if record is None else ''}calibrated"
        date = f" {record.calibrated_utc[:10]}" if record is not None else ""
        end = ", out of tolerance" if record is not None and record.out_of_tolerance else ""
        return name, f"{start}{end}", f"{start}{date}{end}"

    @property
    def calibration_id(self) -> str:
        """Name the calibration in force: unit and time; empty without one."""
        name = f"{self._followed[0]} {self._record.calibrated_utc}" if self._record is not None else ""
        return name if self.conversion is None else self.conversion.named(name)

    @property
    def recording(self) -> str:
        """Name the recording of the calibration in force; empty without one."""
        return self._record.recording if self._record is not None else ""

    def follow(self, snapshot: SessionSnapshot, revision: int) -> None:
        """Use the calibration in force of the unit on the bench, again whenever `revision` grows."""
        name, units = self.name(snapshot), self._units.of(simulated=snapshot.simulated)
        followed = (name, snapshot.simulated, revision, units.stamp(name))  # a command may accept one meanwhile
        if followed != self._followed:
            self._followed = followed
            self.use(None)  # first: that of another board is not shown where this one cannot be read
            self.use(newest_calibration(units, name), units)
        self._live.loading = bool(self.preparation.pending)
        ready = self.preparation.take()
        if ready is not None:
            self._live.inverse = self.conversion = ready
            self._live.prediction = ready.prediction

    def use(self, record: CalibrationRecord | None, units: UnitLibrary | None = None) -> None:
        """Show elongation by this calibration, and with `units` predicted signals; none without a calibration."""
        record = record if record is None or record.signal_unit == "mV" else None  # a board sends no other signals
        self._record = record
        self._live.inverse = self.conversion = self._live.prediction = None
        self.preparation.pending.clear()  # of another calibration
        if record is not None:
            self.preparation.call(prepare, record, units)

    def regulator(self, snapshot: SessionSnapshot, step_mv: float) -> Regulator:
        """Return the regulator of the unit on the bench; `step_mv` is the signal of one count."""
        fusion = self.conversion.fusion if self.conversion is not None else None
        units = self._units.of(simulated=snapshot.simulated)
        return regulator_of(units, self.name(snapshot), fusion=fusion, step_mv=step_mv)

    def close(self) -> None:
        self.preparation.close()


class DisagreementWatch:
    """What disagrees with the predicted signals, reported once it has lasted, until something else disagrees."""

    def __init__(self, live: LiveModel) -> None:
        self._live = live
        self._next_s = 0.0
        self._word, self._since_s, self._reported = _NONE, 0.0, _NONE

    @property
    def over(self) -> bool:
        """Return whether what was reported disagrees no longer, or is not known any more."""
        return self._reported == _NONE or self._live.prediction is None

    def follow(self, *, connected: bool) -> tuple[str, str] | None:
        """Return cause and remedy where something has begun to disagree for good; None otherwise."""
        now_s = monotonic()
        if now_s < self._next_s or self._live.prediction is None or not connected:
            return None
        self._next_s = now_s + _EVERY_S
        word = self._live.disagreement()
        if word != self._word:
            self._word, self._since_s = word, now_s
        if now_s - self._since_s < _LASTING_S or word == self._reported:
            return None
        self._reported = word
        return TEXTS.get(word)
