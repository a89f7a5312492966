"""How much more light arrives with both polarisations kept apart, for `analysis/optics/METHODS.md`.

    python -m tests.verification.polarisation

In a plane scene no polarisation turns into the other: the power detected is the mean of two traces, each with its own
reflectance. The tracer is compiled for each, in a process with an empty cache.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

STATES = (0, 7, 14)  # most compressed, rest, most elongated, of the paper's pattern and of seven deeper cavities
PART = """
import json
from analysis.compiled import inner
from analysis.optics.scene.curves import default_curves, frames_of
from analysis.optics.scene.parameters import ALL, PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.tracer import tracer
from analysis.optics.tracer.simulation import trace

def reflected_part(ratio, ci, ct):
    return ((ratio * ci - ct) / (ratio * ci + ct)) ** 2

def other_part(ratio, ci, ct):
    return ((ci - ratio * ct) / (ci + ratio * ct)) ** 2

if {part!r} != "mean":
    tracer.reflected_part = inner({{"s": reflected_part, "p": other_part}}[{part!r}])
frames, light = frames_of(default_curves(), Waveguide()), Light(rays=5000, phase=0.25, secondary=ALL, faintest=0.001)
designs = PAPER_OPTIMUM, Design(7, 0.7, 0.8, 1.0)
print(json.dumps([trace(frames[i], design, Waveguide(), light).power for design in designs for i in {states}]))
"""


def powers(part: str) -> list[float]:
    """Return the power detected in each scene with the reflectance of "s", "p" or their "mean"."""
    code = PART.format(part=part, states=STATES)
    with tempfile.TemporaryDirectory() as cache:
        apart = os.environ | {"NUMBA_CACHE_DIR": cache}
        done = subprocess.run([sys.executable, "-c", code], env=apart, stdout=subprocess.PIPE, check=True)
    return [float(power) for power in json.loads(done.stdout)]


def more_percent() -> list[float]:
    """Return by how much the power with both kept apart exceeds that of unpolarised light, in each scene."""
    rows = zip(powers("s"), powers("p"), powers("mean"), strict=True)
    return [100.0 * (0.5 * (s + p) / mean - 1.0) for s, p, mean in rows]


if __name__ == "__main__":
    print("more power: " + ", ".join(f"{each:.2f} %" for each in more_percent()))
