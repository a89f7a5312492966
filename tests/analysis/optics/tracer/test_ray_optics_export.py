"""Scenes for ray-optics; where that simulator is available, the same counts."""

from __future__ import annotations

import json
import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from analysis.optics.scene.curves import frame_of
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.ray_optics_export import ray_optics_scene
from analysis.optics.tracer.simulation import trace
from protocol.base.errors import DataError

PEER = os.environ.get("BOAT_RAY_OPTICS", "")

"""A node script that loads a scene and prints {"count": detected rays} as JSON; see METHODS.md, "ray-optics"."""


def test_scene_is_version_5_with_our_fan(frames: list[SceneFrame]) -> None:
    """Version 5; one glass with arc points, no two of them neighbours; the source's steps and turn give our angles."""
    scene = ray_optics_scene(frames[7], Design(), Waveguide(), Light(secondary=0))
    json.dumps(scene, allow_nan=False)
    assert scene["version"] == 5
    glass, source, detector, blocker = scene["objs"]
    assert [o["type"] for o in scene["objs"]] == ["Glass", "AngleSource", "Detector", "Blocker"]
    arcs = [p["arc"] for p in glass["path"]]
    assert any(arcs)
    assert not any(a and b for a, b in zip(arcs, [*arcs[1:], arcs[0]], strict=True))
    assert int(scene["rayModeDensity"] * 500) == 750
    turned = math.atan2(source["p2"]["y"] - source["p1"]["y"], source["p2"]["x"] - source["p1"]["x"])
    assert turned - math.pi / 2 == pytest.approx(math.radians(120 / 250 / 2), abs=1e-12)
    assert not glass["partialReflect"]
    assert blocker["p1"]["y"] > detector["p1"]["y"]
    assert scene["maxRayDepth"] > 1000


def test_other_fans_are_written_ray_by_ray(frames: list[SceneFrame]) -> None:
    """A Lambertian fan, or one whose steps do not divide a turn, becomes single rays."""
    for light in (Light(rays=30, emission="lambertian"), Light(rays=11, cone_deg=100.0)):
        scene = ray_optics_scene(frames[7], Design(), Waveguide(), light)
        assert sum(o["type"] == "SingleRay" for o in scene["objs"]) == light.rays


def test_a_scene_without_receiver_is_refused(curves: np.ndarray) -> None:
    """There is no place for the detector."""
    guide = Waveguide(receiver_mm=0.0)
    with pytest.raises(DataError, match="no receiver"):
        ray_optics_scene(frame_of(curves, 7, guide), Design(), guide, Light())


@pytest.mark.nightly
@pytest.mark.skipif(not PEER, reason="BOAT_RAY_OPTICS does not name a script that runs ray-optics")
@pytest.mark.parametrize("state", range(0, 15, 2))
@pytest.mark.parametrize(
    "design", [Design(), Design(3, 0.7, 0.7, 0.7), Design(7, 0.5, 1.0, 0.6), Design(5, 0.8, 0.6, 0.5, "inner")]
)
def test_ray_optics_counts_the_same(frames: list[SceneFrame], tmp_path: Path, state: int, design: Design) -> None:
    """The public 2D simulator, on the very scene we write, detects as many rays as we do."""
    light = Light(secondary=0)
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(ray_optics_scene(frames[state], design, Waveguide(), light)))
    theirs = json.loads(
        subprocess.run(["node", PEER, str(file)], capture_output=True, text=True, check=True, timeout=120).stdout
    )
    ours = trace(frames[state], design, Waveguide(), light).ledger["detected"]
    assert round(theirs["count"]) == ours
