"""A unit under control, for tests: hysteresis and calibration of a specimen, from its noise-free truth."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

from analysis import fit_calibration
from analysis.calibration.inverse import Fusion, Inverse
from analysis.elongation_control.controller import Bounds, ElongationController, Tuning
from analysis.elongation_control.dynamics import Lag
from analysis.elongation_control.hysteresis import HysteresisModel, identify
from analysis.elongation_control.sensor_loop import find_loops
from protocol.base.arrays import FloatArray
from protocol.simulator.plant import Body, Sensors
from protocol.simulator.specimens import find_specimen

LAG = Lag(0.02, 9.3, 0.63)  # of the virtual board's pneumatics, as step tests find it
STEP_MV = 3300 / 4096


@lru_cache(maxsize=8)
def swings(specimen: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pressure [n], elongation [n] and signals [n, sensors] of three swings, 100 samples a second."""
    unit, ends = find_specimen(specimen), [0.0, 50.0, -40.0, 50.0, -40.0, 50.0]
    ramps = [np.linspace(a, b, round(abs(b - a) * 20)) for a, b in pairwise(ends)]
    pressure_kpa = np.concatenate(ramps)
    elongation_mm = Body(unit.actuator).advance(pressure_kpa)
    return pressure_kpa, elongation_mm, Sensors(unit.sensors, unit.range_mm).advance(elongation_mm)


@lru_cache(maxsize=8)
def identified(specimen: str) -> tuple[HysteresisModel, Fusion]:
    """Return hysteresis and fusion of a specimen."""
    pressure_kpa, x, signals = swings(specimen)
    sensors = find_specimen(specimen).sensors
    fits = [fit_calibration(x[1000::100], signals[1000::100, i], 3) for i in range(len(sensors))]
    noise = [sensor.noise_mv for sensor in sensors]
    inverses = [Inverse.of(fit, noise_sd=mv, model_sd=0.7) for fit, mv in zip(fits, noise, strict=True)]
    return identify(pressure_kpa, x), Fusion.of(inverses)


def regulator(
    specimen: str = "SA1", bounds: Bounds | None = None, *, ramp_kpa_per_s: float = 36.0
) -> ElongationController:
    """Return a controller of a specimen, tuned for the virtual board."""
    model, fusion = identified(specimen)
    _, x, signals = swings(specimen)
    x, signals = x[::100], signals[::100]
    residuals = [signals[:, i] - inverse.calibration.predict(x) for i, inverse in enumerate(fusion.inverses)]
    loops = find_loops(x, residuals)
    return ElongationController(
        model, fusion, Tuning.of(LAG, ramp_kpa_per_s), bounds, unit=specimen, step_mv=STEP_MV, loops=loops
    )  # fmt: skip
