"""Parameters of the shadow's actuator: every length and modulus that a user may change, its default; and their file.

Values of the paper are marked (paper), the others (assumed) or (fitted, `tests/analysis/shadow/geometry_fit.py`). In a
TOML file each name is optional; an unknown one is rejected: no default replaces a misspelt name.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from analysis.shadow.fem.material import NeoHookean
from protocol.base.errors import RequestError
from protocol.base.toml_file import read_values

MOST_ELEMENTS = 20_000


@dataclass(frozen=True, slots=True)
class ActuatorParameters:
    """Geometry, materials and mesh of the actuator; lengths in mm, moduli in kPa."""

    cells: int = 6  # bladders in the row (assumed: six)
    pitch_mm: float = 12.5  # distance of neighbouring bladders, equal to the lattice's unit cell (paper: 12.5)
    # neck_radius_mm, belly_radius_mm: least (fitted) and greatest (assumed) inner radius of the bladders
    neck_radius_mm: float = 4.3165
    belly_radius_mm: float = 7.5
    wall_mm: float = 2.2  # thickness of the elastomer wall, measured along r (assumed)
    envelope_radius_mm: float = 25.0  # outer radius of the lattice (assumed: two unit cells)
    lattice_modulus_kpa: float = 18.34  # effective Young's modulus of the lattice (paper: 18.34 +- 1.86)
    lattice_modulus_sd_kpa: float = 1.86  # its standard deviation over three specimens (paper)
    lattice_poisson: float = 0.3  # with wall_poisson: Poisson's ratios (assumed)
    wall_modulus_kpa: float = 1298.4  # Young's modulus of the wall (fitted)
    wall_poisson: float = 0.49
    guide_bow_mm: float = 18.0  # greatest distance of a waveguide's centreline from the axis (assumed)
    guide_end_mm: float = 12.5  # length of each rigid end piece, in which the guides run to their junction (assumed)
    # axial_elements, wall_elements, lattice_elements: elements along one cell, across the wall, across the lattice
    axial_elements: int = 16
    wall_elements: int = 2
    lattice_elements: int = 4
    grading: float = 3.0  # ratio of the outermost to the innermost lattice element's width

    def __post_init__(self) -> None:
        for field in fields(self):
            check_number(field.name, getattr(self, field.name), whole=field.type == "int")
        _ = self.lattice, self.wall  # check themselves
        outer = self.belly_radius_mm + self.wall_mm
        along, wall, lattice = self.elements
        elements = self.cells * along * (wall + lattice)
        if self.neck_radius_mm > self.belly_radius_mm:
            cause = f"the neck ({self.neck_radius_mm} mm) is wider than the belly ({self.belly_radius_mm} mm)"
            raise RequestError(cause, "swap neck_radius_mm and belly_radius_mm")
        end = f"the lattice ends at {self.envelope_radius_mm:g} mm"
        if outer >= self.envelope_radius_mm:
            remedy = "make envelope_radius_mm larger than belly_radius_mm + wall_mm"
            raise RequestError(f"bladder and wall reach r = {outer:g} mm, {end}", remedy)
        if elements > MOST_ELEMENTS:
            cause = f"{elements} elements are more than the {MOST_ELEMENTS} allowed here"
            raise RequestError(cause, "choose fewer elements per cell")
        if self.guide_bow_mm >= self.envelope_radius_mm:
            cause = f"the guides bow out to {self.guide_bow_mm:g} mm, {end}"
            raise RequestError(cause, "make guide_bow_mm smaller than envelope_radius_mm")

    @property
    def elements(self) -> tuple[int, int, int]:
        """Return the elements along a cell, across the wall, across the lattice."""
        return self.axial_elements, self.wall_elements, self.lattice_elements

    @property
    def length_mm(self) -> float:
        """Return the length between base and tip plate at rest, mm."""
        return self.cells * self.pitch_mm

    @property
    def lattice(self) -> NeoHookean:
        return NeoHookean(self.lattice_modulus_kpa, self.lattice_poisson)

    @property
    def wall(self) -> NeoHookean:
        return NeoHookean(self.wall_modulus_kpa, self.wall_poisson)

    @property
    def digest(self) -> str:
        """Return the hash of all values, which names this actuator's cached table."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()[:16]


def check_number(name: str, value: float, *, whole: bool = False) -> None:
    """Reject what is not a finite, positive number (Poisson's ratios may be negative)."""
    if isinstance(value, int) and abs(value) >= 2**63:  # no float, and of too many digits to be printed
        raise RequestError(f"{name} is a number of more than 64 bits", f"give {name} as a plain number")
    if whole and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
        raise RequestError(f"{name} = {value} is not a whole number of 1 or more", f"give {name} as 1, 2, 3, ...")
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise RequestError(f"{name} = {value} is not a finite number", f"give {name} as a plain number")
    if value <= 0 and not name.endswith("poisson") and not (name.endswith("_sd_kpa") and value == 0):
        raise RequestError(f"{name} = {value} is not positive", f"give {name} above zero")


def read_parameters(path: Path) -> ActuatorParameters:
    """Read the parameters of an actuator."""
    known = [field.name for field in fields(ActuatorParameters)]
    return ActuatorParameters(**read_values(path, known, of="the actuator", example="wall_mm = 2.2"))
