"""Parameters of a simulation: cavities, waveguide, light. Every number that the paper leaves out has a name here.

Each value checks itself when it is created: a number outside its physical range is rejected with cause and remedy
before any geometry is built. Lengths are in mm, angles in degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from protocol.base.errors import ChoiceError

Face = Literal["outer", "inner", "both", "midline"]
Order = Literal["time", "bounce", "index"]
Emission = Literal["uniform", "lambertian"]
By = Literal["count", "power"]
MOST_RAYS = 10_000_000  # more costs memory, 8 bytes each and thread, and changes no figure
PAPER_RAYS = 250
WAVELENGTH_MM = 860e-6
QUARTER_STEP = 0.25  # turn of the fan at which its two halves, mirrored into each other, interleave at half a step
ORDERS: tuple[Order, ...] = ("time", "bounce", "index")
STATES = 15  # of a sweep, from the most compressed to the most elongated
STEPS_MM = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # of width, spacing and depth in the paper's grid
FACES: tuple[Face, ...] = ("outer", "inner", "both", "midline")
BYS: tuple[By, ...] = ("count", "power")
PAPER_SECONDARY = 100
ALL = -1  # budget under which every reflected part above the faintest power is followed
FULL_FAINTEST, LEAST_FAINTEST = 1e-3, 1e-12
"""Faintest power where all reflected parts are followed: the default, and the least that ends."""


def _finite(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise ChoiceError(f"{name} is {value}, which is not a number", "give a finite number")


def _between(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    _finite(name, value)
    if not low <= value <= high:
        cause = f"{name} is {value:g}{unit}, outside {low:g} to {high:g}{unit}"
        raise ChoiceError(cause, f"choose {name} within {low:g} to {high:g}{unit}")


def _one_of(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise ChoiceError(f"{name} is '{value}', which is unknown", f"choose one of {', '.join(allowed)}")


@dataclass(frozen=True, slots=True)
class Design:
    """The cavities of one guide: a centred row of equal rectangular cavities in one of its faces."""

    cavities: int = 5  # how many, 0 (a plain guide) or more; the paper's are 3, 5 and 7
    width_mm: float = 1.0
    depth_mm: float = 0.5
    spacing_mm: float = 0.9  # distance of neighbours, wall to wall along the centreline
    face: Face = "outer"

    def __post_init__(self) -> None:
        if self.cavities != int(self.cavities) or not 0 <= self.cavities <= 99:
            raise ChoiceError(f"{self.cavities} cavities", "choose a whole number from 0 to 99")
        _one_of("face", self.face, FACES)
        _between("cavity width", self.width_mm, 0.01, 50.0, " mm")
        _between("cavity depth", self.depth_mm, 0.001, 50.0, " mm")
        _finite("cavity spacing", self.spacing_mm)
        if self.spacing_mm <= 0 and self.cavities > 1:
            cause = f"cavities overlap: a spacing of {self.spacing_mm:g} mm puts each into its neighbour"
            raise ChoiceError(cause, "choose a spacing above 0 mm")
        if self.spacing_mm < WAVELENGTH_MM and self.cavities > 1:
            raise ChoiceError(
                f"a spacing of {self.spacing_mm:g} mm is below the wavelength of the light, where rays mean nothing",
                f"choose a spacing above {WAVELENGTH_MM:g} mm",
            )

    @property
    def cut_mm(self) -> float:
        """Return the part of the thickness that a cavity, or two opposite ones, take away, mm."""
        return self.depth_mm * (2 if self.face == "both" else 1)

    @property
    def row_mm(self) -> float:
        """Return the length of the whole row along the centreline, mm."""
        return self.cavities * self.width_mm + max(self.cavities - 1, 0) * self.spacing_mm

    @property
    def values(self) -> tuple[float, float, float, float]:
        """Return cavities, width_mm, depth_mm, spacing_mm: the order used in tables and files."""
        return (float(self.cavities), self.width_mm, self.depth_mm, self.spacing_mm)


PAPER_OPTIMUM = Design(5, 1.0, 0.5, 0.9)


@dataclass(frozen=True, slots=True)
class Waveguide:
    """The guide: what the paper leaves out, with the default of each."""

    thickness_mm: float = 2.0
    index: float = 1.50  # refractive index of the resin at 860 nm, known to 0.02
    attenuation_db_per_cm: float = 0.0  # bulk loss
    stem_mm: float = 3.0  # emitter to junction and junction to receiver
    receiver_mm: float | None = None  # width of the receiver's segment; None is the whole end face. 0 receives nothing
    backing_mm: float = 0.1  # resin behind the emitter's point, 0.1 (the emitter is glued in with the same resin)
    knots: int = 10  # points of each guide's interpolating curve, 10 (paper); more where a file gives more

    def __post_init__(self) -> None:
        _between("guide thickness", self.thickness_mm, 0.05, 50.0, " mm")
        _between("refractive index", self.index, 1.0, 5.0)
        _between("attenuation", self.attenuation_db_per_cm, 0.0, 1000.0, " dB/cm")
        _between("stem", self.stem_mm, 0.1, 500.0, " mm")
        _between("emitter's backing", self.backing_mm, 1e-6, 100.0, " mm")
        if self.receiver_mm is not None:
            _between("receiver width", self.receiver_mm, 0.0, 500.0, " mm")
        if not 7 <= self.knots <= 200:
            raise ChoiceError(f"{self.knots} knots a guide", "choose 7 to 200")


def phase_of(rays: int) -> float:
    """Return the turn of a fan in its own steps: none for the paper's 250 rays, a quarter for other numbers.

    Without a turn, a scene that is its own mirror image counts every ray twice: half of the rays add no information.
    """
    return 0.0 if rays == PAPER_RAYS else QUARTER_STEP


@dataclass(frozen=True, slots=True)
class Light:
    """The released rays and how far they are followed.

    `secondary`: budget of reflected rays for the whole simulation, 100 (paper); `ALL` follows every one. `phase`: shift
    of the fan in steps of its own angle, -0.5..0.5; a repeat with another phase is an independent sample. `jitter`:
    seed of a random place of each ray in its own step, in place of a phase; None for an even fan.
    """

    rays: int = PAPER_RAYS  # number released by the emitter
    cone_deg: float = 120.0  # full aperture of the fan
    emission: Emission = "uniform"  # 'uniform' in angle, or 'lambertian' (as many rays in each equal step of sine)
    secondary: int = PAPER_SECONDARY
    order: Order = "time"
    path_cap_mm: float = 1000.0  # a ray is given up after this path length
    faintest: float = 1e-12  # a ray whose power falls below this part of a released one's is dropped
    phase: float = 0.0
    jitter: int | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.rays <= MOST_RAYS:
            raise ChoiceError(f"{self.rays} rays", f"choose 1 to {MOST_RAYS:,} rays".replace(",", " "))
        _between("cone", self.cone_deg, 0.001, 179.9, " degrees")
        _one_of("emission", self.emission, ("uniform", "lambertian"))
        if not ALL <= self.secondary <= 10_000_000:
            remedy = f"choose 0 to 10 000 000, or {ALL} for all"
            raise ChoiceError(f"a budget of {self.secondary} secondary rays", remedy)
        _one_of("order", self.order, ORDERS)
        _between("path cap", self.path_cap_mm, 1.0, 1e7, " mm")
        _between("faintest power", self.faintest, 0.0, 0.1)
        if self.secondary == ALL and self.faintest < LEAST_FAINTEST:
            cause = f"all reflected parts down to a power of {self.faintest:g} are too many to follow"
            raise ChoiceError(cause, f"choose a faintest power of {LEAST_FAINTEST:g} or more")
        _between("phase of the fan", self.phase, -0.5, 0.5)

    def with_rays(self, rays: int) -> Light:
        """Return the same model sampled by other rays: secondaries in proportion, an even fan turned by `phase_of`."""
        if rays == self.rays:
            return self
        budget = ALL if self.secondary == ALL else round(self.secondary * rays / self.rays)
        return replace(self, rays=rays, secondary=budget, phase=0.0 if self.jittered else phase_of(rays))

    @property
    def jittered(self) -> bool:
        """Return whether each ray has a random place in its own step."""
        return self.jitter is not None

    @property
    def shift(self) -> float:
        """Return the distance of the fan from its mirror image in steps, 0..1."""
        return 0.5 if self.jittered else (2.0 * self.phase) % 1.0


def light_by(by: By, rays: int) -> Light:
    """Return the light by which designs are ranked: the budget in proportion to the rays, or all reflections."""
    _one_of("ranking", by, BYS)
    light = Light() if by == "count" else Light(secondary=ALL, faintest=FULL_FAINTEST)
    return light.with_rays(rays)
