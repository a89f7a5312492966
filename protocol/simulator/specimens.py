"""The specimens of the virtual board: three fictitious sensorized actuators with known true values.

SA1 has the paper's figures: its published cubics; elongation -2.70 mm at -40 kPa and +3.80 mm at +50 kPa, the only
range whose end-to-end slopes give its sensitivities; noise of FSO / 10^(SNR/20); and loops of signal against pressure
of 4.95 and 4.46 % FSO over its continuous cycle, mostly actuator hysteresis (elongation against pressure), the rest
sensor hysteresis. SA2 and SA3 differ by a typical unit-to-unit variability. The voltage of "SA1-falling" falls with
elongation. "SA1x1" to "SA1x4" have that many sensors: first those of SA1, then those of the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from protocol.base.errors import ChoiceError
from protocol.link.messages import SIMULATED_PREFIX
from protocol.simulator.hysteresis import PlaySum

FALLING = "-falling"
SENSOR_COUNTS = ("1", "2", "3", "4")


@dataclass(frozen=True, slots=True)
class SpecimenActuator:
    """From pressure (kPa) to elongation (mm): hysteresis, then creep as (share, time constant in s) of a change."""

    hysteresis: PlaySum
    creep: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class SpecimenSensor:
    """From elongation (mm) to signal (mV).

    `coefficients`: b0..b3 of y(x) = b0 + b1 x + b2 x^2 + b3 x^3, mV per mm^k. `loop_mv`: half the width of its
    hysteresis loop (signal against elongation) in the middle of the range. `noise_mv`: rms of one sample's signal,
    quantisation included.
    """

    coefficients: tuple[float, float, float, float]
    loop_mv: float
    noise_mv: float

    def falling(self) -> SpecimenSensor:
        """Return the sensor with a stage that does not invert: mirrored about its signal at rest."""
        b0, b1, b2, b3 = self.coefficients
        return replace(self, coefficients=(b0, -b1, -b2, -b3), loop_mv=-self.loop_mv)


@dataclass(frozen=True, slots=True)
class Specimen:
    """One sensorized actuator. `range_mm` is its elongation at -40 and at +50 kPa."""

    name: str
    actuator: SpecimenActuator
    sensors: tuple[SpecimenSensor, ...]
    range_mm: tuple[float, float]

    @property
    def board_id(self) -> str:
        """The identity in HELLO, at most 16 characters; it names the board as simulated."""
        return SIMULATED_PREFIX + self.name.removesuffix(FALLING) + ("-F" if self.name.endswith(FALLING) else "")


def _actuator(elastic: float, hysteretic: float, curvature: float) -> SpecimenActuator:
    """Return an actuator of an elastic term and eight plays of equal weight (mm/kPa), radii up to 40 kPa."""
    radii = (0.0, *(5.0 * n for n in range(1, 9)))
    plays = PlaySum(radii, (elastic, *[hysteretic] * 8), curvature - 1e-4, curvature + 1e-4)
    return SpecimenActuator(plays, creep=((0.003, 1.0), (0.004, 12.0)))


_SPECIMENS = {
    specimen.name: specimen
    for specimen in (
        Specimen(
            "SA1",
            _actuator(0.06733402, 0.001095398, 1.102425e-03),
            (
                SpecimenSensor((1651.9842, 46.4413, -2.6934, -0.36251), 1.080306, 1.49),
                SpecimenSensor((1624.5567, 33.37911, -2.3102, -0.14139), 0.474745, 1.04),
            ),
            (-2.70, 3.80),
        ),
        Specimen(
            "SA2",
            _actuator(0.06451026, 0.001023766, 1.132803e-03),
            (
                SpecimenSensor((1588.40, 43.912, -2.3870, -0.33820), 0.890869, 1.37),
                SpecimenSensor((1671.25, 36.084, -2.5145, -0.17205), 0.638972, 1.12),
            ),
            (-2.58, 3.64),
        ),
        Specimen(
            "SA3",
            _actuator(0.06991210, 0.001125470, 1.038649e-03),
            (
                SpecimenSensor((1703.10, 49.276, -2.9052, -0.31140), 1.466129, 1.58),
                SpecimenSensor((1597.80, 31.145, -2.0516, -0.13010), 0.413190, 0.98),
            ),
            (-2.81, 3.93),
        ),
    )
}
RISING_NAMES = tuple(_SPECIMENS)
SPECIMEN_NAMES = (*RISING_NAMES, *(name + FALLING for name in RISING_NAMES))


def find_specimen(name: str) -> Specimen:
    """Return a specimen; `-falling` mirrors its sensors, `x1` to `x4` set their number. RequestError: unknown."""
    base, ending, sensors = name.removesuffix(FALLING).partition("x")
    specimen = _SPECIMENS.get(base)
    if specimen is None or (ending and (name.endswith(FALLING) or sensors not in SENSOR_COUNTS)):
        known = ", ".join(SPECIMEN_NAMES)
        raise ChoiceError(f"there is no virtual unit {name!r}", f"use one of {known}, or e.g. SA1x3 for three sensors")
    if sensors:
        others = (sensor for other in _SPECIMENS.values() if other is not specimen for sensor in other.sensors)
        return replace(specimen, name=name, sensors=(*specimen.sensors, *others)[: int(sensors)])
    if name.endswith(FALLING):
        return replace(specimen, name=name, sensors=tuple(sensor.falling() for sensor in specimen.sensors))
    return specimen
