"""Elongation as a setpoint: signals in, the next pressure out. Arrays and numbers only: no thread, port or clock.

Feed-forward through the inverse of the hysteresis, the lag taken out by the setpoint's own rate and acceleration, and
an integrator on what is left. A step is shaped by a critically damped filter with a limited rate; ramps and sines are
followed as they are. Every pressure lies inside the limits and changes no faster than the ramp; where it would not, the
integrator does not grow. The first pressure is that at the start. What cannot be controlled stops with a code:
elongation unknown, sensors in disagreement, uncertainty or deviation beyond its bound.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from analysis.calibration.inverse import Fusion
from analysis.elongation_control.dynamics import Lag, Margins, integral_for, loop_margins
from analysis.elongation_control.hysteresis import HysteresisModel
from analysis.elongation_control.measurement import FusedElongation, SensorWatch
from analysis.elongation_control.sensor_loop import SensorLoops
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError

PERIOD_S = 0.04
LEAST_RAMP_KPA_PER_S = 0.1
RATE_SHARE = 0.9  # of the ramp that a shaped step may use: the rest is for the integrator
_HISTORY = 64  # periods of the setpoint that are kept to compare with late samples


class StopCode(enum.StrEnum):
    """Why elongation is no longer controlled."""

    DISAGREEMENT = "sensors_disagree"
    UNKNOWN = "elongation_unknown"
    UNCERTAIN = "elongation_uncertain"
    NOT_FOLLOWING = "not_following"


_STOPS = {
    StopCode.DISAGREEMENT: ("the sensors disagree on the elongation", "check both sensors, or calibrate again"),
    StopCode.UNKNOWN: (
        "no sensor gives an elongation: their signals are outside the calibrated range",
        "check the sensors, or choose setpoints further inside the range",
    ),
    StopCode.UNCERTAIN: (
        "the uncertainty of the elongation is {u}, its bound {bound:g} mm",
        "choose setpoints where the sensors are steeper, or raise the bound",
    ),
    StopCode.NOT_FOLLOWING: (
        "the elongation does not follow: {away:+z.2f} mm from its setpoint",
        "check for a leak and that the pump runs, or identify the unit again",
    ),
}


@dataclass(frozen=True, slots=True)
class Tuning:
    """Gains of the controller."""

    integral_per_s: float
    lead_s: float  # with lead_s2: of the setpoint's rate and acceleration in the feed-forward
    lead_s2: float
    shape_rad_per_s: float
    ramp_kpa_per_s: float  # fastest change of the pressure
    margins: Margins
    lag: Lag | None = None  # identified by a step test; None where the gains are the cautious defaults
    period_s: float = PERIOD_S

    @classmethod
    def of(cls, lag: Lag, ramp_kpa_per_s: float, period_s: float = PERIOD_S) -> Tuning:
        """Return the gains for an identified lag: margins of 60 degrees and 10 dB."""
        gain = integral_for(lag, period_s)
        shape = min(0.6 * lag.omega_rad_per_s, 0.35 / max(lag.delay_s, 1e-3))  # what plant and delay can follow
        lead2 = 1.0 / lag.omega_rad_per_s**2
        return cls(
            gain, lag.lag_s, lead2, shape, ramp_kpa_per_s, loop_margins(lag, gain, period_s), lag, period_s
        )  # fmt: skip

    @classmethod
    def cautious(cls) -> Tuning:
        """Return slow gains for a unit without a step test."""
        return cls(0.5, 0.0, 0.0, 2.0, 10.0, loop_margins(Lag(0.1, 5.0, 1.0), 0.5, PERIOD_S))


@dataclass(frozen=True, slots=True)
class Bounds:
    """What stops the controller."""

    u_mm: float = 0.8  # largest expanded uncertainty (k = 2) of one sample's elongation
    deviation_mm: float = 0.5  # largest distance from the setpoint, for longer than `follow_s`
    follow_s: float = 3.0
    debounce_s: float = 0.2  # how long disagreement, uncertainty or loss must last


@dataclass(frozen=True, slots=True)
class Output:
    """What a period brought."""

    pressure_kpa: float  # with ramp_kpa_per_s: the command; the pressure is that of before where `stop` is set
    ramp_kpa_per_s: float
    setpoint_mm: float
    elongation_mm: float  # with u_mm: measured, k = 2; NaN where unknown
    u_mm: float
    saturated: bool  # the pressure is at a limit or at its ramp
    lost: tuple[int, ...] = ()  # sensors (from 1) newly lost
    stop: StopCode | None = None  # with cause, remedy: why to stop; None and empty where nothing is wrong
    cause: str = ""
    remedy: str = ""


class ElongationController:
    """One unit under control: `begin`, then `advance` once a period. Resolution and loops as in `SensorWatch`."""

    def __init__(
        self,
        model: HysteresisModel,
        fusion: Fusion,
        tuning: Tuning,
        bounds: Bounds | None = None,
        *,
        unit: str = "",
        step_mv: float = 0.0,
        loops: SensorLoops | None = None,
    ) -> None:
        self.model, self.tuning, self.bounds = model, tuning, bounds or Bounds()
        self.period_s, self.delay_margin_s = tuning.period_s, tuning.margins.delay_s
        self.unit, self._step_mv, self._loops = unit, step_mv, loops
        self.sensors = SensorWatch(fusion, step_mv, loops)
        fusion.evaluate(np.zeros((1, len(fusion.inverses))))  # compiles now, not on the reading thread

    def check(self, mm: float) -> None:
        """Refuse a setpoint outside the calibrated range. Raises RequestError where it is outside."""
        low, high = self.sensors.range_mm
        if not low <= mm <= high:
            cause = f"a setpoint of {mm:g} mm is outside the calibrated range, {low:.2f} to {high:.2f} mm"
            raise RequestError(cause, "Choose one inside, or calibrate over a wider range.")

    def begin(self, time_s: float, pressure_kpa: float, signal_mv: FloatArray) -> float:
        """Start without a bump and return the measured elongation, mm."""
        sent, calibrated = signal_mv.shape[1], len(self.sensors.fusion.inverses)
        if sent != calibrated:
            cause = f"the board sends {sent} sensors, the calibration of unit {self.unit} has {calibrated}"
            raise RequestError(cause, "mount that unit, or calibrate this one")
        self.sensors = SensorWatch(self.sensors.fusion, self._step_mv, self._loops)
        self._lasted_s = dict.fromkeys(StopCode, 0.0)
        found = self.sensors.measure(signal_mv, 0.0)
        if not math.isfinite(found.mm):
            raise RequestError(*_STOPS[StopCode.UNKNOWN])
        if found.disagreement:
            raise RequestError(*_STOPS[StopCode.DISAGREEMENT])
        self._time_s, self._pressure_kpa = time_s, pressure_kpa
        self._memory = self.model.rest(pressure_kpa, found.mm)
        self._offset = self.model.elongation(self._memory) - found.mm  # so that the first pressure is the present one
        self._reference, self._rate, self._shaped = found.mm, 0.0, True
        self._past = [(time_s, found.mm)]
        return found.mm

    def advance(
        self,
        time_s: float,
        sampled_s: float,
        setpoint: tuple[float, float, float],
        signal_mv: FloatArray,
        limits_kpa: tuple[float, float],
        *,
        shaped: bool = True,
    ) -> Output:
        """Return the next pressure.

        `sampled_s`: mean time of the samples. `setpoint`: mm, mm/s and mm/s2. `signal_mv`: [n, sensors] since the last
        call; NaN where a sample is not to be used. `shaped`: it is a step, which is made smooth.
        """
        dt = max(time_s - self._time_s, 1e-3)
        self._time_s = time_s
        found = self.sensors.measure(signal_mv, dt)
        acceleration = self._shape(setpoint, dt, shaped=shaped)
        self._past = [*self._past[-_HISTORY:], (time_s, self._reference)]
        times, references = np.asarray(self._past).T
        error = float(np.interp(sampled_s, times, references)) - found.mm
        grown_s = min(dt, 2.0 * self.period_s)  # a period that came late must not count as a larger gain
        grow = self.tuning.integral_per_s * grown_s * error if math.isfinite(error) else 0.0
        ahead = self._reference + self.tuning.lead_s * self._rate + self.tuning.lead_s2 * acceleration
        wanted_kpa = self.model.pressure(self._memory, ahead + self._offset + grow)
        step = self.tuning.ramp_kpa_per_s * dt
        pressure_kpa = min(max(wanted_kpa, self._pressure_kpa - step), self._pressure_kpa + step)
        pressure_kpa = min(max(pressure_kpa, limits_kpa[0]), limits_kpa[1])
        saturated = bool(pressure_kpa != wanted_kpa)
        if not saturated or (wanted_kpa - pressure_kpa) * grow < 0.0:
            self._offset += grow
        ramp = min(max(abs(pressure_kpa - self._pressure_kpa) / dt, LEAST_RAMP_KPA_PER_S), self.tuning.ramp_kpa_per_s)
        self._pressure_kpa = pressure_kpa
        self._memory = self.model.after(self._memory, pressure_kpa)
        stop, cause, remedy = self._stop(found, error, dt)
        return Output(
            pressure_kpa, ramp, self._reference, found.mm, found.u_mm, saturated, found.lost, stop, cause, remedy
        )

    def _shape(self, setpoint: tuple[float, float, float], dt_s: float, *, shaped: bool) -> float:
        """Move the reference towards the setpoint and return its acceleration, mm/s2."""
        goal, rate, acceleration = setpoint
        ended = not self._shaped and abs(goal - self._reference) <= 1.5 * abs(self._rate) * dt_s  # of a ramp or sine
        self._shaped = shaped
        if not shaped or ended:
            self._reference, self._rate = goal, rate
            return acceleration
        w = self.tuning.shape_rad_per_s
        fastest = RATE_SHARE * self.tuning.ramp_kpa_per_s * self.model.slope(self._pressure_kpa)
        before, parts = self._rate, max(1, math.ceil(dt_s / 0.005))
        for _ in range(parts):
            pull = w * w * (goal - self._reference) - 2.0 * w * self._rate
            self._rate = min(max(self._rate + pull * dt_s / parts, -fastest), fastest)
            self._reference += self._rate * dt_s / parts
        return (self._rate - before) / dt_s

    def _stop(self, found: FusedElongation, error: float, dt_s: float) -> tuple[StopCode | None, str, str]:
        """Return why to stop, with cause and remedy."""
        bounds = self.bounds
        present = {
            StopCode.UNKNOWN: not math.isfinite(found.mm),
            StopCode.DISAGREEMENT: found.disagreement,
            StopCode.UNCERTAIN: math.isfinite(found.mm) and not found.u_mm <= bounds.u_mm,
            StopCode.NOT_FOLLOWING: abs(error) > bounds.deviation_mm,
        }
        for code, now in present.items():
            self._lasted_s[code] = self._lasted_s[code] + dt_s if now else 0.0
            if self._lasted_s[code] > (bounds.follow_s if code is StopCode.NOT_FOLLOWING else bounds.debounce_s):
                cause, remedy = _STOPS[code]
                u = f"{found.u_mm:.2g} mm" if math.isfinite(found.u_mm) else "not known"
                return code, cause.format(u=u, bound=bounds.u_mm, away=-error), remedy
        return None, "", ""
