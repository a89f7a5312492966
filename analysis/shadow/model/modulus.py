"""The lattice's effective modulus from uniaxial compression tests (METHODS.md), with its uncertainty.

Specimens differ by more than the uncertainty of a single slope, so the uncertainty is between specimens. Signs are free
(compression may be recorded negative), order in time is not: the loading branch precedes the greatest displacement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from analysis.data.csv_table import Table, read_table
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, FileError, RequestError

FEWEST_POINTS = 5
WINDOW = (0.02, 0.10)  # strains of the line, from contact
CONTACT_SHARE = 0.01
STRAIGHT_R2 = 0.95
FORCE_N = {"n": 1.0, "mn": 1e-3, "kn": 1e3}
_LENGTH_MM = {"mm": 1.0, "m": 1e3, "um": 1e-3, "µm": 1e-3, "cm": 10.0}
FORCE_NAMES = ("force_n", "force", "load", "load_n", "f", "standard force", "load_cell")
DISPLACEMENT_NAMES = (
    "displacement_mm", "displacement", "extension", "deformation", "travel", "compression_mm", "compression", "disp",
    "disp_mm", "position", "crosshead", "stroke",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class CompressionTest:
    """One specimen: force in N and displacement in mm, both shape (n,), and its size at rest."""

    name: str
    force_n: FloatArray
    displacement_mm: FloatArray
    height_mm: float
    area_mm2: float


@dataclass(frozen=True, slots=True)
class SpecimenModulus:
    """One specimen's modulus: slope, kPa, its standard error, R2, points used."""

    name: str
    modulus_kpa: float
    standard_error_kpa: float
    r2: float
    points: int


@dataclass(frozen=True, slots=True)
class EffectiveModulus:
    """The modulus of all specimens together."""

    # mean_kpa, sd_kpa: over specimens (the form of the paper: 18.34 +- 1.86, N = 3); sd is NaN for one specimen
    mean_kpa: float
    sd_kpa: float
    standard_error_kpa: float  # sd / sqrt(N), or the slope's own for one specimen
    interval_kpa: tuple[float, float]  # 95 % interval of the mean, Student's t; NaN for one specimen
    specimens: tuple[SpecimenModulus, ...]


def read_compression_test(
    path: Path,
    height_mm: float,
    area_mm2: float,
    force_column: str | None = None,
    displacement_column: str | None = None,
) -> CompressionTest:
    """Read one specimen's CSV: a force column and a displacement column, in any of the common names and units."""
    table = read_table(path)
    force, force_unit = find_column(table, FORCE_NAMES, path, force_column)
    travel, travel_unit = find_column(table, DISPLACEMENT_NAMES, path, displacement_column)
    force_n, travel_mm = force * factor(FORCE_N, force_unit, path), travel * factor(_LENGTH_MM, travel_unit, path)
    return CompressionTest(path.stem, force_n, travel_mm, height_mm, area_mm2)


def find_column(table: Table, names: Sequence[str], path: Path, wanted: str | None = None) -> tuple[FloatArray, str]:
    """Return a column and its unit ('' if it has none). `wanted`: name or number of the column instead."""
    plain = [name.strip().lower() for name in table.names]
    known = [plain.index(name) for name in names if name in plain]
    if wanted is None and not known:
        having = ", ".join(table.names[:8])
        raise FileError(f"{path.name} has no column of {names[1]} (it has {having})", f"name the column {names[0]}")
    at = known[0] if wanted is None else table.position(wanted)
    return table.columns[at], table.units[at].strip().lower()


def factor(units: dict[str, float], unit: str, path: Path) -> float:
    """Return the factor of a unit; a column without a unit is in N or mm."""
    if unit and unit not in units:
        raise FileError(f"{path.name} has the unknown unit '{unit}'", f"use one of {', '.join(units)}")
    return units.get(unit, 1.0)


def specimen_modulus(test: CompressionTest) -> SpecimenModulus:
    """Return one specimen's modulus: the slope of the line between the strains of `WINDOW`, counted from contact."""
    for name, value in (("height", test.height_mm), ("area", test.area_mm2)):
        if not (np.isfinite(value) and value > 0.0):
            raise RequestError(f"the specimen's {name} is {value}", f"give the {name} at rest, above zero")
    strain, stress, contact = loading_branch(test)
    inside = (strain - contact >= WINDOW[0]) & (strain - contact <= WINDOW[1])
    if inside.sum() < FEWEST_POINTS or np.ptp(strain[inside]) < 0.5 * (WINDOW[1] - WINDOW[0]):
        raise DataError(
            f"{test.name}: {int(inside.sum())} points between {100 * WINDOW[0]:g} and {100 * WINDOW[1]:g} % "
            f"strain (the test reaches {100 * (strain.max() - contact):.1f} %)",
            "compress further, or sample faster",
        )
    fit = stats.linregress(strain[inside], stress[inside])
    slope, r2 = float(fit.slope), float(fit.rvalue) ** 2
    if slope <= 0.0 or r2 < STRAIGHT_R2:
        raise DataError(
            f"{test.name} is not a compression test: force against displacement is not a rising line between "
            f"{100 * WINDOW[0]:g} and {100 * WINDOW[1]:g} % strain (slope {slope:.3g} kPa, R2 {r2:.2f})",
            "check the columns; the lattice must not buckle in it",
        )
    return SpecimenModulus(test.name, slope, float(fit.stderr), r2, int(inside.sum()))


def loading_branch(test: CompressionTest) -> tuple[FloatArray, FloatArray, float]:
    """Return strain, stress in kPa up to the greatest displacement, both positive, and the strain at contact."""
    known = np.isfinite(test.force_n) & np.isfinite(test.displacement_mm)
    force, travel = test.force_n[known], test.displacement_mm[known]
    if len(force) < FEWEST_POINTS:
        raise DataError(f"{test.name} has {len(force)} usable points", f"give {FEWEST_POINTS} or more")
    travel = travel - travel[0]
    turn = int(np.argmax(np.abs(travel)))
    force, travel = force[: turn + 1], travel[: turn + 1]
    if len(travel) < FEWEST_POINTS or travel[-1] == 0.0:
        cause = f"{test.name} is not a compression test: the displacement does not grow"
        raise DataError(cause, "check which column is the displacement")
    travel, force = travel * np.sign(travel[-1]), force * np.sign(force[np.argmax(np.abs(force))] or 1.0)
    height = float(np.ptp(force))
    if height == 0.0:
        remedy = "check which column is the force"
        raise DataError(f"{test.name} is not a compression test: the force never changes", remedy)
    touched = int(np.argmax(force - force[: max(3, len(force) // 50)].mean() >= CONTACT_SHARE * height))
    strain = travel / test.height_mm
    if strain[-1] >= 1.0:
        raise DataError(
            f"{test.name} was compressed by {travel[-1]:.1f} mm, more than its height of {test.height_mm:g} mm",
            "check height and units",
        )
    return strain, 1e3 * force / test.area_mm2, float(strain[touched])


def effective_modulus(tests: Sequence[CompressionTest]) -> EffectiveModulus:
    """Return the modulus over specimens. Raises RequestError if no test is given."""
    if not tests:
        raise RequestError("no compression test is given", "give one CSV a specimen")
    specimens = tuple(specimen_modulus(test) for test in tests)
    values = np.array([s.modulus_kpa for s in specimens])
    mean, n = float(values.mean()), len(values)
    if n == 1:
        return EffectiveModulus(mean, np.nan, specimens[0].standard_error_kpa, (np.nan, np.nan), specimens)
    sd = float(values.std(ddof=1))
    error = sd / np.sqrt(n)
    reach = float(stats.t.ppf(0.975, n - 1)) * error
    return EffectiveModulus(mean, sd, float(error), (mean - reach, mean + reach), specimens)
