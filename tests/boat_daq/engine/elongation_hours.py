"""Hours of board time with the elongation under control, faster than real time: limits, and the error over time.

    python -m tests.boat_daq.engine.elongation_hours --hours 24 --specimen SA1

Controller, interlock, link and virtual board are the program's own, advanced step by step without threads: 24 h take
about an hour of one core. Random steps, ramps and sines within the calibrated range are run as plans in millimetres,
and in turn as manual setpoints; the board has creep, noise, a clock fast by 200 ppm and a body that softens. A line is
printed for each board hour; at the end come the measurements as JSON. The exit code is 1 where a pressure, commanded or
true, was outside its limits, a command faster than the ramp, or the control ended by itself.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import asdict, dataclass, field

import numpy as np

from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import SessionState
from boat_daq.workflows.unit_control import as_regulator
from protocol.link.messages import SetPressure
from protocol.recording import Segment
from protocol.simulator.specimens import SPECIMEN_NAMES
from tests.analysis import twin_unit
from tests.boat_daq.engine.controller_rig import ControllerRig

STEP_S = 0.04
MARGIN_MM = 0.1  # of setpoints, from the ends of the calibrated range
FASTEST_MM_PER_S = 1.5
RAMP_KPA_PER_S = 36.0
DRIFTS = ("drift_ppm@0:200", "softening@0:0.3")
SETTLED_S = 1.0  # last part of a hold, which counts as its error


@dataclass
class Findings:
    """What a run of hours showed; pressures in kPa, errors in mm, of the true elongation."""

    specimen: str
    seed: int
    hours: float = 0.0
    seconds: float = 0.0
    plans: int = 0
    setpoints: int = 0
    commands: int = 0
    pressure_kpa: list[float] = field(default_factory=lambda: [0.0, 0.0])
    commanded_kpa: list[float] = field(default_factory=lambda: [0.0, 0.0])
    violations: list[str] = field(default_factory=list)
    hold_rms_mm: list[float] = field(default_factory=list)
    hold_worst_mm: list[float] = field(default_factory=list)
    moving_rms_mm: list[float] = field(default_factory=list)


class Hours:
    """One unit under control for hours."""

    def __init__(self, specimen: str, seed: int) -> None:
        self.rig = ControllerRig(*DRIFTS, seed=seed, specimen=specimen).connected()
        controller = twin_unit.regulator(specimen, ramp_kpa_per_s=RAMP_KPA_PER_S)
        self.control, self.regulator = self.rig.control, as_regulator(controller)
        low, high = controller.sensors.range_mm
        self.range_mm = low + MARGIN_MM, high - MARGIN_MM
        self.random = np.random.default_rng(seed)
        self.found = Findings(specimen, seed)
        self.limits_kpa = (0.0, 0.0)
        self._holding: list[float] = []
        self._moving: list[float] = []

    @property
    def hours(self) -> float:
        """Board time so far."""
        return float(self.rig.board.now_us) / 3.6e9

    def segment(self, start: float) -> Segment:
        """Return a random segment from an elongation on."""
        low, high = self.range_mm
        goal = float(self.random.uniform(low, high))
        match self.random.integers(3):
            case 0:
                return Segment("step", goal, hold_s=4.0)
            case 1:
                return Segment("ramp", goal, rate_per_s=float(self.random.uniform(0.05, FASTEST_MM_PER_S)), hold_s=3.0)
        room = min(start - low, high - start)
        amplitude = float(self.random.uniform(0.1, 1.0)) * max(room, 0.0)
        if amplitude < 0.05:
            return Segment("step", 0.5 * (low + high), hold_s=4.0)
        fastest = FASTEST_MM_PER_S / (2.0 * math.pi * amplitude)
        frequency = min(float(np.exp(self.random.uniform(math.log(0.02), math.log(0.5)))), fastest)
        return Segment("sine", start, amplitude=amplitude, frequency_hz=frequency, periods=2.0)

    def plan(self, segments: int) -> None:
        """Run a plan of random segments to its end, vented."""
        first = Segment("step", float(self.random.uniform(*self.range_mm)), hold_s=4.0)
        parts = [first]
        for _ in range(segments):
            parts.append(self.segment(parts[-1].target))
        plan = Plan("hours", "profile", 1, quantity="mm", min_dwell_s=4.0, segments=tuple(parts))
        self.rig.do(lambda: self.control.arm(plan, regulator=self.regulator), self.control.start)
        self.found.plans += 1
        self.advance(2.0)
        while self.rig.state is SessionState.RUNNING:
            self.advance(STEP_S)
        if self.rig.state is not SessionState.FINISHING:
            self.found.violations.append(f"{self.hours:.3f} h: a plan ended in {self.rig.state}: {self.last_note()}")
        self.advance(6.0)

    def manual(self, setpoints: int) -> None:
        """Hold random setpoints, one after the other, then vent."""
        for _ in range(setpoints):
            goal = float(self.random.uniform(*self.range_mm))
            self.rig.do(lambda goal=goal: self.control.control_elongation(goal, self.regulator))
            self.advance(float(self.random.uniform(1.0, 15.0)))
            if self.control.loop is None:
                self.found.violations.append(f"{self.hours:.3f} h: the control ended: {self.last_note()}")
            self.found.setpoints += 1
        self.rig.do(self.control.vent)
        self.advance(6.0)

    def last_note(self) -> str:
        """Return the newest message."""
        return self.rig.notes[-1].text if self.rig.notes else ""

    def advance(self, seconds: float) -> None:
        """Step on, and compare every pressure with its limits."""
        rig, begin_us = self.rig, self.rig.board.now_us
        steps = max(1, round(seconds / STEP_S))
        for i in range(steps):
            rig.step(STEP_S)
            limits = self.control.interlock.limits
            if limits is not None:
                self.limits_kpa = limits.min_kpa, limits.max_kpa
            self.compare(i >= steps - SETTLED_S / STEP_S and rig.board.now_us - begin_us > 3_000_000)

    def compare(self, settled: bool) -> None:
        """Compare a step's pressures with the limits, and keep its error. `settled`: of a setpoint long held."""
        rig, found, (low, high) = self.rig, self.found, self.limits_kpa
        for command in rig.sent_of(SetPressure):
            target, ramp = command.target_pa / 1000, command.ramp_pa_per_s / 1000
            found.commands += 1
            found.commanded_kpa = [min(found.commanded_kpa[0], target), max(found.commanded_kpa[1], target)]
            if not (low <= target <= high and ramp <= RAMP_KPA_PER_S + 1e-3):
                found.violations.append(f"{self.hours:.3f} h: {target} kPa at {ramp} kPa/s commanded")
        for pressure in rig.pressures:
            found.pressure_kpa = [min(found.pressure_kpa[0], pressure), max(found.pressure_kpa[1], pressure)]
            if not low <= pressure <= high:
                found.violations.append(f"{self.hours:.3f} h: {pressure:.2f} kPa, limits {low:g} to {high:g} kPa")
        rig.sent.clear()
        rig.pressures.clear()
        if self.control.loop is None:
            return
        point = self.control.sequencer.setpoint_mm(rig.board.now_us)
        if point is None:
            if settled:
                self._holding.append(rig.board.elongation_mm - self.control.loop.target_mm)
        elif any(point[1:]) and self.control.sequencer.cycle:
            self._moving.append(rig.board.elongation_mm - point[0])

    def run(self, hours: float) -> Findings:
        """Run for hours of board time, and return what was found."""
        begun, printed = time.perf_counter(), 0.0
        while self.hours < hours:
            self.plan(20)
            self.manual(20)
            for kept in (self.rig.notes, self.rig.ends, self.rig.breaks, self.rig.marks):
                kept.clear()
            if self.hours - printed >= min(1.0, hours):
                printed = self.hours
                self.note_hour(begun)
        self.found.hours, self.found.seconds = self.hours, time.perf_counter() - begun
        return self.found

    def note_hour(self, begun: float) -> None:
        """Keep and print the errors since the last time."""
        found, holding, moving = self.found, np.asarray(self._holding), np.asarray(self._moving)
        found.hold_rms_mm.append(float(np.sqrt(np.mean(holding**2))))
        found.hold_worst_mm.append(float(np.abs(holding).max()))
        found.moving_rms_mm.append(float(np.sqrt(np.mean(moving**2))))
        self._holding.clear()
        self._moving.clear()
        print(
            f"{self.hours:.2f} h in {time.perf_counter() - begun:.0f} s: {len(found.violations)} violations, "
            f"{found.pressure_kpa[0]:.2f} to {found.pressure_kpa[1]:.2f} kPa, "
            f"held to {found.hold_rms_mm[-1]:.4f} mm rms (worst {found.hold_worst_mm[-1]:.3f}), "
            f"moving {found.moving_rms_mm[-1]:.4f} mm rms", flush=True,
        )  # fmt: skip


def main() -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description="Control the elongation for hours of board time.")
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--specimen", default="SA1", choices=SPECIMEN_NAMES)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    found = Hours(options.specimen, options.seed).run(options.hours)
    print(json.dumps(asdict(found), indent=1))
    return 1 if found.violations else 0


if __name__ == "__main__":
    sys.exit(main())
