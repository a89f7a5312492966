"""One design in one state of the actuator, traced: the optical model for scripts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analysis.optics.scene.curve_file import curves_named
from analysis.optics.scene.curves import REST_STATE, frame_of
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.parameters import Design, Face, Light, Waveguide
from analysis.optics.scene.scene_file import OpticalScene
from analysis.optics.tracer import simulation
from analysis.optics.tracer.simulation import TraceResult
from analysis.optics.tracer.tolerance import trace_within
from analysis.progress import Progress
from protocol.base.errors import ChoiceError


@dataclass(frozen=True, slots=True)
class Scene:
    """What `boat-daq optics trace` takes; a `state` of None is the state at rest."""

    cavities: int = 5
    width_mm: float = 1.0
    depth_mm: float = 0.5
    spacing_mm: float = 0.9
    face: Face = "outer"
    state: int | None = None
    rays: int = 250
    secondary: int = 100
    index: float = 1.5
    curves: str | Path = "default"

    @property
    def design(self) -> Design:
        return Design(self.cavities, self.width_mm, self.depth_mm, self.spacing_mm, self.face)

    @property
    def guide(self) -> Waveguide:
        return OpticalScene(index=self.index).guide

    @property
    def light(self) -> Light:
        return OpticalScene().light(self.rays, self.secondary)

    @property
    def frame(self) -> SceneFrame:
        """The surfaces in its state. ChoiceError: there is no such state."""
        curves = curves_named(str(self.curves))
        number = REST_STATE if self.state is None else self.state
        if not 0 <= number < len(curves):
            raise ChoiceError(f"there is no state {number}", f"choose 0 to {len(curves) - 1}")
        return frame_of(curves, number, self.guide)


def trace(scene: Scene, *, tolerance: float | None = None, progress: Progress | None = None) -> TraceResult:
    """Trace the light of a scene; `tolerance`, the largest error of `ndr` (rays of 250, 95 %), chooses the rays."""
    parts = scene.frame, scene.design, scene.guide, scene.light
    if tolerance is None:
        return simulation.trace(*parts, progress=progress)
    return trace_within(*parts, tolerance, progress=progress).result
