"""The one stored form of a calibration: the curves with their points, the uncertainty of a new signal, the origin.

A run gives it (`analysis.calibration_export.run_record`); acceptance stores its JSON in the unit's file; live
conversion, control, history, export and certificate read it. Lengths are in mm, signals in `signal_unit`. The points
are fitted again, so that curve, covariance and inverse are those accepted; older records lack branches, loop and
ambient light.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from analysis.calibration.curve_choice import SPLINE
from analysis.calibration.type_b import ONE_CYCLE, contributions
from analysis.numbers import finite
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

if TYPE_CHECKING:
    from analysis.calibration.fit import Calibration
    from analysis.calibration.inverse import Fusion, Inverse


@dataclass(frozen=True, slots=True)
class SensorRecord:
    """The calibration of one sensor; none where `void` gives the reason. What was not assessed is NaN.

    `noise_mv` is the sd of one signal: None for the residual sd of the fit, a list at equally spaced elongations.
    """

    name: str = ""
    fit: Mapping[str, Any] = field(default_factory=dict)  # curve, covariance, range, tests: as `fit --json`
    elongation_mm: FloatArray = field(default_factory=lambda: np.zeros(0))
    signal_mv: FloatArray = field(default_factory=lambda: np.zeros(0))
    positions: FloatArray | None = None  # [n] labels for `fit_by_branch`; None in the oldest records
    branches: FloatArray | None = None
    ambient_mv: FloatArray | None = None  # [n] error by ambient light, alike in every cycle; None without
    reading_sd_mm: float = 0.0
    noise_mv: float | Sequence[float] | None = None
    between_cycles_mv: float = 0.0  # sd from cycle to cycle
    half_loop_mv: FloatArray = field(default_factory=lambda: np.zeros(1))  # at equally spaced elongations
    type_b: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    void: str = ""
    u_reason: str = ""  # why U is not known
    u_stand_in: str = ""  # what it rests on besides the run
    fitted: Calibration | None = None  # the calibration of the run, if the record was not read from a file

    @classmethod
    def parse(cls, stored: Mapping[str, Any]) -> SensorRecord:
        """Return the record of a sensor of a stored calibration."""
        between, half_loop = stored.get("between_cycles_mv"), stored.get("half_loop_mv")
        u_reason, u_stand_in = (str(stored.get(key) or "") for key in ("u_reason", "u_stand_in"))
        if u_reason or u_stand_in:
            between, half_loop = (np.nan if one is None else one for one in (between, half_loop))
        elif between is None or half_loop is None:  # the loop's rms is in the model
            between, half_loop = stored.get("model_mv") or 0.0, 0.0
        return cls(
            name=str(stored.get("name", "")),
            fit=stored.get("fit") or {},
            elongation_mm=np.asarray(stored.get("elongation_mm", ()), dtype=np.float64),
            signal_mv=np.asarray(stored.get("signal_mv", ()), dtype=np.float64),
            positions=_array(stored.get("positions")),
            branches=_array(stored.get("branches")),
            ambient_mv=_array(stored.get("ambient_mv")),
            reading_sd_mm=float(stored.get("reading_sd_mm") or 0.0),
            noise_mv=stored.get("noise_mv"),
            between_cycles_mv=float(between),
            half_loop_mv=np.atleast_1d(np.asarray(half_loop, dtype=np.float64)),
            type_b=stored.get("type_b") or {},
            figures=stored.get("figures") or {},
            u_reason=u_reason,
            u_stand_in=u_stand_in,
        )

    def as_json(self) -> dict[str, Any]:
        stored = {
            "name": self.name,
            "fit": self.fit,
            "elongation_mm": self.elongation_mm.tolist(),
            "signal_mv": self.signal_mv.tolist(),
            "positions": _list(self.positions),
            "branches": _list(self.branches),
            "reading_sd_mm": self.reading_sd_mm,
            "noise_mv": self.noise_mv,
            "model_mv": float(np.sqrt(self.between_cycles_mv**2 + np.mean(self.half_loop_mv**2))),
            "between_cycles_mv": self.between_cycles_mv,
            "half_loop_mv": self.half_loop_mv.tolist() if np.isfinite(self.half_loop_mv).all() else None,
            "u_reason": self.u_reason,
            "u_stand_in": self.u_stand_in,
            "type_b": dict(self.type_b),
            "figures": dict(self.figures),
        }
        return stored if self.ambient_mv is None else stored | {"ambient_mv": self.ambient_mv.tolist()}

    def calibration(self) -> Calibration:
        """Return the curve: that of the run, or its points fitted again; raises DataError if there is none."""
        from analysis.calibration.fit import fit_by_branch, fit_calibration

        if self.void:
            raise DataError(f"{self.name} is not calibrated: {self.void}", "Give its elongations.")
        if self.fitted is not None:
            return self.fitted
        x, y, degree = self.elongation_mm, self.signal_mv, int(self.fit["degree"])
        if self.branches is None or self.positions is None:
            return fit_calibration(x, y, degree).with_reading(self.reading_sd_mm, self.positions)
        curve: int | Literal["spline"] = SPLINE if self.fit.get("curve") == SPLINE else degree
        return fit_by_branch(
            x, y, curve, positions=self.positions, branch=self.branches, reading_sd=self.reading_sd_mm,
            shared=self.ambient_mv,
        )  # fmt: skip

    def inverse(self) -> Inverse:
        """Return the inverse of the curve, with the uncertainty of one new signal; raises BoatDaqError without one."""
        from analysis.calibration.inverse import Inverse

        return Inverse.of(
            self.calibration(), noise_sd=self.noise_mv, model_sd=float(np.nan_to_num(self.between_cycles_mv)),
            half_loop=np.nan_to_num(self.half_loop_mv), type_b=contributions(self.type_b), u_void=self.u_reason,
            u_stand_in=self.u_stand_in,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class CalibrationRecord:
    """The calibration of a unit; `unit` is empty if the run names none.

    `calibrated_utc` is when the run began or its calibration was accepted; `posterior` has figures of each sampled
    curve, `out_of_tolerance` a sentence for each sensor out of tolerance.
    """

    sensors: tuple[SensorRecord, ...]
    simulated: bool
    unit: str = ""
    recording: str = ""
    recording_id: str = ""
    calibrated_utc: str = ""
    operator: str = ""
    program_version: str = ""
    curve: str = ""
    cycles: int = 0
    signal_unit: str = "mV"
    posterior: tuple[Mapping[str, Any], ...] = ()
    out_of_tolerance: tuple[str, ...] = ()

    @classmethod
    def parse(cls, content: Mapping[str, Any], **origin: str) -> CalibrationRecord:
        """Return the record of a stored calibration; `origin` (unit, recording, ...) is stored beside the content."""
        cycles, sensors = int(content.get("cycles") or 0), tuple(map(SensorRecord.parse, content.get("sensors", ())))
        if cycles == 1:  # older records count what one cycle cannot show as zero
            sensors = tuple(s if s.u_reason or s.u_stand_in else replace(s, u_reason=ONE_CYCLE) for s in sensors)
        return cls(
            sensors=sensors,
            simulated=bool(content.get("simulated")),
            recording_id=str(content.get("recording_id") or ""),
            curve=str(content.get("curve") or ""),
            cycles=cycles,
            signal_unit=str(content.get("signal_unit") or "mV"),
            posterior=tuple(content.get("posterior", ())),
            out_of_tolerance=tuple(content.get("poor", ())),
            **origin,
        )

    def as_json(self) -> dict[str, Any]:
        """Return the content that is stored: numbers that are not finite are None."""
        return dict(
            finite({
                "sensors": [sensor.as_json() for sensor in self.sensors],
                "simulated": self.simulated,
                "cycles": self.cycles,
                "recording_id": self.recording_id,
                "curve": self.curve,
                **({"signal_unit": self.signal_unit} if self.signal_unit != "mV" else {}),
                "posterior": [dict(one) for one in self.posterior],
                "poor": list(self.out_of_tolerance),
            })
        )  # fmt: skip

    def fusion(self) -> Fusion:
        """Return the conversion of signals to elongation, all sensors fused; BoatDaqError if one has no inverse."""
        from analysis.calibration.inverse import Fusion

        return Fusion.of([sensor.inverse() for sensor in self.sensors])


def _array(values: Sequence[float] | None) -> FloatArray | None:
    return None if values is None else np.asarray(values, dtype=np.float64)


def _list(values: FloatArray | None) -> list[float] | None:
    return None if values is None else values.tolist()
