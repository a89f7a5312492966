"""The unit on the bench and its calibration in force, by which the live page shows elongation."""

from __future__ import annotations

from boat_daq.engine.settings import StoredCalibration, UnitLibrary
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.viewmodels.live.connection import ConnectionModel
from boat_daq.viewmodels.live.conversion import Conversion, Preparation
from boat_daq.viewmodels.live.live_model import LiveModel


class UnitInUse:
    """Keeps the live conversion in step with the unit's calibration in force.

    Parameters
    ----------
    units : the units and their calibrations.
    connection : names the unit while no board is connected.
    live : shows elongation by the conversion.
    """

    def __init__(self, units: UnitLibrary, connection: ConnectionModel, live: LiveModel) -> None:
        self._units, self._connection, self._live = units, connection, live
        self.preparation = Preparation()
        self.conversion: Conversion | None = None
        self._stored: StoredCalibration | None = None
        self._followed = ("", 0)  # name, revision of the library

    def name(self, snapshot: SessionSnapshot) -> str:
        """Return the unit on the bench."""
        return snapshot.unit or self._connection.unit

    def text(self, snapshot: SessionSnapshot) -> str:
        """Return unit and calibration in a line."""
        stored = self._stored
        words = f"calibrated {stored.utc[:10]}" if stored is not None else "not calibrated"
        words += ", poor" if stored is not None and stored.content.get("poor") else ""
        return f"{self.name(snapshot)}  \u00b7  {words}"

    def follow(self, snapshot: SessionSnapshot, revision: int) -> None:
        """Use the calibration in force of the unit on the bench.

        Parameters
        ----------
        snapshot : of the session.
        revision : grows whenever a calibration in force changes.

        Raises
        ------
        OperatorError : the unit's file is refused.
        AnalysisError : the calibration has no inverse.
        """
        name = self.name(snapshot)
        if (name, revision) != self._followed:
            self._followed = (name, revision)
            self.use(self._units.load(name).calibration if name else None)
        ready = self.preparation.poll()
        if ready is not None:
            self._live.inverse = self.conversion = ready

    def use(self, stored: StoredCalibration | None) -> None:
        """Show elongation by this calibration from now on; show none without one."""
        self._stored = stored
        self._live.inverse = self.conversion = None
        if stored is not None:
            self.preparation.ask(stored.content)

    def close(self) -> None:
        """End the helper thread."""
        self.preparation.close()
