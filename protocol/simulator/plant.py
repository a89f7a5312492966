"""The plant of the virtual board: from a commanded pressure to elongation and signal.

The regulator steps every 10 ms of board time, as firmware does: a ramped setpoint (the pumps' rate at most), a pressure
that follows with lag and small overshoot, a leak that the pumps compensate, a valve that vents. Hysteresis and creep
turn blocks of pressure into elongation, the sensor's cubic and small loop turn elongation into signal. Noise is an
argument, so that the noise-free truth is computed by the same code.
"""

from __future__ import annotations

import math

import numpy as np

from protocol.base.arrays import FloatArray
from protocol.simulator.hysteresis import Hysteresis, PlaySum
from protocol.simulator.specimens import SpecimenActuator, SpecimenSensor

TICK_US = 10_000
TICK_S = TICK_US / 1e6

PUMP_KPA_PER_S = 40.0  # the pumps' rate
PUMP_NOISE = 0.15  # kPa/s a tick: some 0.03 kPa of ripple in the pressure
PUMP_REACH_KPA = (-70.0, 90.0)  # the pumps' range
_OMEGA = 9.0  # rad/s of the regulated pressure
_DAMPING = 0.6
RAMP_LAG_S = 2.0 * _DAMPING / _OMEGA  # of the pressure behind a ramped setpoint
_VENT_S = 0.25  # time constant of the open valve
_LINE_LEAK_PER_S = 0.002  # share of the pressure lost while the pumps are off


class Pneumatics:
    """Pressure in the line and in the bladder, stepped tick by tick."""

    def __init__(self) -> None:
        self.pressure_kpa = 0.0  # at the gauge
        self.bladder_kpa = 0.0  # stretches the body; differs by a leak behind the gauge
        self.setpoint_kpa = 0.0
        self.target_kpa = 0.0
        self.ramp_kpa_per_s = PUMP_KPA_PER_S
        self.regulated = False
        self.venting = False
        # Set by faults:
        self.pump_works = True
        self.reach_kpa = PUMP_REACH_KPA
        self.overshoot_kpa = 0.0
        self.leak_per_s = 0.0
        self._rate = 0.0
        self._lost_kpa = 0.0
        self._beyond_kpa = 0.0  # an exaggerated overshoot not yet reached, with its sign

    def command(self, target_kpa: float, ramp_kpa_per_s: float) -> None:
        """Regulate towards `target_kpa`; a ramp of 0 is as fast as the pumps can."""
        if not self.regulated:
            self.setpoint_kpa = self.pressure_kpa
        self.target_kpa = target_kpa
        self.ramp_kpa_per_s = min(ramp_kpa_per_s or PUMP_KPA_PER_S, PUMP_KPA_PER_S)
        self.regulated, self.venting = True, False
        self._beyond_kpa = math.copysign(self.overshoot_kpa, target_kpa - self.pressure_kpa)

    def vent(self) -> None:
        self.regulated, self.venting = False, True
        self._rate = 0.0

    @property
    def setpoint_arrived(self) -> bool:
        """Whether the setpoint has reached the target."""
        return self.setpoint_kpa == self.target_kpa

    def step(self, pump_noise: float) -> None:
        """Advance by one tick; `pump_noise` is a change of the pressure's rate, kPa/s."""
        if self.regulated:
            self._move_setpoint()
        if self.regulated and self.pump_works:
            wanted = min(max(self.setpoint_kpa, self.reach_kpa[0]), self.reach_kpa[1])
            error = wanted - self.pressure_kpa
            self._rate += (_OMEGA * _OMEGA * error - 2 * _DAMPING * _OMEGA * self._rate) * TICK_S + pump_noise
            self.pressure_kpa += self._rate * TICK_S
        else:
            self._rate = 0.0
            fade = 1.0 / _VENT_S if self.venting else _LINE_LEAK_PER_S
            self.pressure_kpa *= math.exp(-fade * TICK_S)
        if self.venting:
            self._lost_kpa *= math.exp(-TICK_S / _VENT_S)
        elif self.leak_per_s:
            self._lost_kpa += self.leak_per_s * (self.pressure_kpa - self._lost_kpa) * TICK_S
        self.bladder_kpa = self.pressure_kpa - self._lost_kpa

    def _move_setpoint(self) -> None:
        goal = self.target_kpa + self._beyond_kpa
        gap = goal - self.setpoint_kpa
        most = self.ramp_kpa_per_s * TICK_S
        if abs(gap) > most:
            self.setpoint_kpa += math.copysign(most, gap)
        else:
            self.setpoint_kpa = goal
            if abs(self.pressure_kpa - goal) < 0.5:
                self._beyond_kpa = 0.0


class Body:
    """Elongation under the bladder's pressure: a generalised Prandtl-Ishlinskii operator, then creep."""

    def __init__(self, actuator: SpecimenActuator) -> None:
        self._hysteresis = Hysteresis(actuator.hysteresis)
        self._creep = [[share, TICK_S / time_s, 0.0] for share, time_s in actuator.creep]

    def advance(self, pressure_kpa: FloatArray) -> FloatArray:
        """Return the elongation after each tick, mm, both shape (n,)."""
        at_once = self._hysteresis.advance(pressure_kpa)
        elongation = at_once * (1.0 - sum(share for share, _, _ in self._creep))
        targets = at_once.tolist()
        for term in self._creep:
            share, pace, level = term
            levels = []
            for target in targets:
                level += pace * (share * target - level)
                levels.append(level)
            term[2] = level
            elongation += levels
        return elongation


class Sensors:
    """Noise-free signals of a specimen's sensors: each one's cubic and its small hysteresis loop over elongation.

    The loop is lens-shaped: plays of growing radius about the middle of the range less their mean slope, so that on a
    full cycle it closes at both ends, with the branches about the cubic.
    """

    _PLAYS = 8

    def __init__(self, sensors: tuple[SpecimenSensor, ...], range_mm: tuple[float, float]) -> None:
        self._sensors = sensors
        self._middle = (range_mm[0] + range_mm[1]) / 2
        half = (range_mm[1] - range_mm[0]) / 2
        radii = half * (np.arange(self._PLAYS) + 0.5) / self._PLAYS
        # Half the width of the unweighted loop in the middle: the play's radius, or what is left of the half range.
        weight = 1.0 / float(np.minimum(radii, half - radii).sum())
        self._slope = weight * float((half - radii).sum()) / half
        self._lens = Hysteresis(PlaySum(tuple(radii.tolist()), (weight,) * self._PLAYS))

    def advance(self, elongation_mm: FloatArray) -> FloatArray:
        """Return the signals in mV, shape (n, sensors), for elongations of shape (n,)."""
        x = elongation_mm - self._middle
        lens = self._lens.advance(x) - self._slope * x
        return np.stack([cubic(s.coefficients, elongation_mm) + s.loop_mv * lens for s in self._sensors], axis=1)


def cubic(coefficients: tuple[float, float, float, float], elongation_mm: FloatArray) -> FloatArray:
    b0, b1, b2, b3 = coefficients
    return b0 + elongation_mm * (b1 + elongation_mm * (b2 + elongation_mm * b3))
