"""Makes `references/jobs.json`: widths of bands and intervals of the calibration job by many draws.

Run as `python make_jobs_reference.py`; some four minutes.
"""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

import numpy as np

from analysis.figures.sensor_analysis import Options
from analysis.studies.tradeoff.jobs import calibrated, widths

SEEDS = range(1_000, 1_016)
DRAWN = 1e-6
"""Widths that vary by more between seeds, relative to their mean, are determined by draws."""

if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "analysis/studies/tradeoff/references/jobs.json")
    found = np.array([widths(calibrated(Options(seed=seed, fidelity="reference"))) for seed in SEEDS])
    mean = found.mean(axis=0)
    content = {
        "method": f"the calibration job at reference fidelity, mean of {len(SEEDS)} seeds",
        "made": datetime.date.today().isoformat(),
        "widths": mean.tolist(),
        "drawn": (found.std(axis=0) > DRAWN * mean).tolist(),
    }
    target.write_text(json.dumps(content) + "\n", encoding="utf-8")
