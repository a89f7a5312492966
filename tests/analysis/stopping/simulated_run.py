"""A run of the virtual unit in memory: plant, converter and sequencer, without port or clock, and its readings."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pandas as pd

from analysis.data.recording import STEP_COLUMNS, Recording
from analysis.figures.pipeline import Analysis, analyse
from analysis.figures.sensor_analysis import Options
from analysis.stopping.criterion import StopAssessment, assess_calibration
from boat_daq.engine.control.sequencer import GoTo, Sequencer, StepChanged, VentNow
from boat_daq.engine.plan import Plan, StepMark
from boat_daq.engine.sample_columns import Columns
from boat_daq.engine.session.reading_sources import (
    READER_SD_MM,
    SIMULATED_RESOLUTION_MM,
    SIMULATED_SOURCE,
    simulated_reading,
)
from protocol.base.arrays import FloatArray
from protocol.simulator.plant import TICK_US, Body, Pneumatics, Sensors
from protocol.simulator.sampler import ADC_BITS, LSB_MV, PRESSURE_NOISE_PA, VREF_MV, FrontEnd
from protocol.simulator.specimens import find_specimen

BLOCK = 20
PUMP_NOISE = 0.15  # kPa/s a tick, as of the virtual board
QUICK = Options(mcmc=False, fidelity="draft")


class SimulatedRun:
    """A plan on a virtual unit, one sample a tick.

    Parameters
    ----------
    plan : plateaus only. unit : a name of `SPECIMEN_NAMES`.
    cycle_sd_mv : standard deviation of an offset common to one cycle's signals.
    resolution_mm : grid of the elongation readings.
    """

    def __init__(
        self, plan: Plan, *, unit: str = "SA1", seed: int = 0, cycle_sd_mv: float = 0.0,
        resolution_mm: float = SIMULATED_RESOLUTION_MM,
    ) -> None:  # fmt: skip
        specimen = find_specimen(unit)
        self.plan, self.seed, self.cycle_sd_mv, self.resolution_mm = plan, seed, cycle_sd_mv, resolution_mm
        self.marks: dict[int, StepMark] = {}
        self.sequencer = Sequencer()
        self._rng = np.random.default_rng((seed, 77))
        self._pneumatics, self._body = Pneumatics(), Body(specimen.actuator)
        self._sensors, self._front_end = Sensors(specimen.sensors, specimen.range_mm), FrontEnd(specimen.sensors)
        self._tick, self._offset_mv = 0, self._cycle_offset()
        self._blocks: list[tuple[FloatArray, ...]] = []
        self.sequencer.feed(self._block())
        self.sequencer.arm(plan)
        self.sequencer.start()
        self._act()

    def _cycle_offset(self) -> FloatArray:
        return np.full(len(self._sensors._sensors), self.cycle_sd_mv * self._rng.standard_normal())

    def _block(self) -> Columns:
        """Return the next samples."""
        bladder = []
        for noise in (PUMP_NOISE * self._rng.standard_normal(BLOCK)).tolist():
            self._pneumatics.step(noise)
            bladder.append(self._pneumatics.bladder_kpa)
        pressure = np.array(bladder)
        elongation = self._body.advance(pressure)
        signal = self._sensors.advance(elongation) + self._offset_mv
        time_us = TICK_US * np.arange(self._tick, self._tick + BLOCK, dtype=np.int64)
        self._tick += BLOCK
        counts = self._front_end.convert(signal, time_us, self._rng.standard_normal((BLOCK, signal.shape[1], 2)), {}, 0)
        lit, dark = counts[:, :, 0], counts[:, :, 1]
        measured = np.rint(1000.0 * pressure + PRESSURE_NOISE_PA * self._rng.standard_normal(BLOCK)) / 1000.0
        mv = (lit.astype(np.float64) - dark) * LSB_MV
        self._blocks.append((time_us, measured, mv, lit, dark, elongation))
        none = np.zeros(BLOCK, np.uint16)
        return Columns(time_us, measured, mv, lit.astype(np.float64), none.astype(np.uint8), none)

    def _act(self) -> None:
        for action in self.sequencer.take():
            match action:
                case GoTo(target, ramp):
                    self._pneumatics.command(target, ramp)
                    self.sequencer.commanded()
                case VentNow():
                    self._pneumatics.vent()
                case StepChanged(mark):
                    self.marks[mark.number] = mark

    @property
    def time_s(self) -> float:
        """Board time since the start."""
        return self._tick * TICK_US / 1e6

    def run_cycle(self) -> None:
        """Run until one more cycle is complete."""
        before = self.sequencer.complete_cycles
        while self.sequencer.complete_cycles == before:
            self.sequencer.feed(self._block())
            self._act()
        self._offset_mv = self._cycle_offset()

    def run_until(self, asked_mm: float, cycles: int) -> tuple[Analysis, StopAssessment]:
        """Run as `record --uncertainty` does: until U is the one asked for, or to the end of some cycles."""
        while True:
            self.run_cycle()
            analysis = analyse(self.recording(), options=QUICK)
            found = assess_calibration(analysis, asked_mm, cycles)
            if found.reached or self.sequencer.complete_cycles == cycles:
                return analysis, found
            self.sequencer.hold_at(found.hold)

    def recording(self) -> Recording:
        """Return the run so far, with a reading of each plateau."""
        time_us, pressure, mv, lit, dark, x = (np.concatenate(one) for one in zip(*self._blocks, strict=True))
        rng, steps, readings = np.random.default_rng(self.seed), [], []
        for mark in self.marks.values():
            row = {key: value for key, value in asdict(mark).items() if not key.endswith("_us")}
            times = {f"{key}_s": getattr(mark, f"{key}_us") for key in ("started", "arrived", "settled", "ended")}
            row |= {key: np.nan if us is None else us / 1e6 for key, us in times.items()}
            steps.append(row | {"id": mark.number, "segment": 0, "detail": json.dumps(dict(mark.detail))})
            if mark.status != "reached" or mark.settled_us is None or mark.ended_us is None:
                continue
            inside = (time_us >= mark.settled_us) & (time_us <= mark.ended_us)
            seen = simulated_reading(
                float(x[inside].mean()), rng, resolution_mm=self.resolution_mm, reader_sd_mm=READER_SD_MM
            )
            readings.append({"id": len(readings) + 1, "step": mark.number, "elongation_mm": seen,
                             "resolution_mm": self.resolution_mm, "source": SIMULATED_SOURCE, "note": ""})  # fmt: skip
        return Recording.from_arrays(
            time_us / 1e6, pressure, mv, lit=lit, dark=dark, steps=pd.DataFrame(steps, columns=list(STEP_COLUMNS)),
            readings=pd.DataFrame(readings), meta={"simulated": True, "vref_mv": VREF_MV, "adc_bits": ADC_BITS},
        )  # fmt: skip

    def new_readings(self) -> tuple[FloatArray, FloatArray]:
        """Run one more whole cycle; return signals [n, sensors] of its settled plateaus and true elongations [n]."""
        self.sequencer.hold_at(None)
        first, last = len(self._blocks), len(self.marks)
        self.run_cycle()
        time_us, _, mv, _, _, x = (np.concatenate(one) for one in zip(*self._blocks[first:], strict=True))
        inside = np.zeros(len(time_us), dtype=bool)
        for mark in list(self.marks.values())[last:]:
            if mark.settled_us is not None and mark.ended_us is not None:
                inside |= (time_us >= mark.settled_us) & (time_us <= mark.ended_us)
        return mv[inside], x[inside]
