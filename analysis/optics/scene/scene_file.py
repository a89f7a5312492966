"""An optical scene as a TOML file: what the paper leaves open about guides, light and ranking.

Every key is optional; an unknown one is refused by name. Options of a command precede the file.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path

from analysis.optics.scene.parameters import (
    ALL,
    BYS,
    FULL_FAINTEST,
    By,
    Emission,
    Face,
    Light,
    Order,
    Waveguide,
    phase_of,
)
from protocol.base.errors import RequestError
from protocol.base.toml_file import read_values

_KINDS: dict[str, tuple[tuple[type, ...], str]] = {
    "float": ((int, float), "a number"),
    "int": ((int,), "a whole number"),
}
NAMED_CURVES = ("default", "parametric", "shadow", "paper")


@dataclass(frozen=True, slots=True)
class OpticalScene:
    """Guide, light and states of a simulation; a value of None takes the default of the command."""

    thickness_mm: float = 2.0
    index: float = 1.50
    attenuation_db_per_cm: float = 0.0
    receiver_mm: float | None = None  # width of the receiver; None is the whole end face
    face: Face = "outer"
    curves: str = "default"  # one of NAMED_CURVES, or a CSV file
    emission: Emission = "uniform"
    order: Order = "time"
    secondary: int | None = None  # budget of reflected rays; ALL follows each
    phase: float | None = None  # turn of the fan, in its own steps
    faintest: float | None = None  # least power that is followed, parts of a released ray
    rank_by: By | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value, kind = getattr(self, field.name), str(field.type).removesuffix(" | None")
            kinds, text = _KINDS.get(kind, ((str,), "text"))
            if value is not None and (not isinstance(value, kinds) or isinstance(value, bool)):
                raise RequestError(f"{field.name} = {value!r:.60} is not {text}", f"give {field.name} as {text}")
        if self.rank_by not in (None, *BYS):
            raise RequestError(f"rank_by is '{self.rank_by}', which is unknown", f"choose one of {', '.join(BYS)}")

    @property
    def guide(self) -> Waveguide:
        return Waveguide(
            thickness_mm=self.thickness_mm,
            index=self.index,
            attenuation_db_per_cm=self.attenuation_db_per_cm,
            receiver_mm=self.receiver_mm,
        )

    def light(self, rays: int, secondary: int) -> Light:
        """Return the light of some rays with a budget of secondary ones."""
        turn = phase_of(rays) if self.phase is None else self.phase
        light = Light(rays=rays, secondary=secondary, phase=turn, order=self.order, emission=self.emission)
        least = FULL_FAINTEST if secondary == ALL and self.faintest is None else self.faintest
        return light if least is None else replace(light, faintest=least)

    def stated(self, *names: str) -> list[str]:
        return [name for name in names if getattr(self, name) != getattr(OpticalScene(), name)]


def read_scene(path: Path | None) -> OpticalScene:
    """Return the scene in a file; None is the default scene."""
    if path is None:
        return OpticalScene()
    known = [field.name for field in fields(OpticalScene)]
    values = read_values(path, known, of="the optical scene", example="thickness_mm = 2.0")
    scene = OpticalScene(**values)
    if scene.curves in NAMED_CURVES:
        return scene
    return replace(scene, curves=str(path.parent / scene.curves))  # as written beside the file
