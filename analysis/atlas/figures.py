"""Where the figures of a sensor lose their meaning: no span, no noise, branches that do not overlap."""

from __future__ import annotations

import numpy as np

from analysis.atlas.runs import STEPS, Stairs, analysed, analysed_with, off_percent, warnings_of
from analysis.atlas.sweep import Axis, Study, StudyResult, joined

FULL_MV = 255.5
BULGE_PERCENT = 5.0


def snr(span_mv: float, noise_mv: float) -> StudyResult:
    """Return the signal-to-noise ratio of a staircase whose signal spans `span_mv`, dB off its stated interval."""
    run = Stairs(scale=span_mv / FULL_MV, noise_mv=noise_mv)
    found = analysed(run)
    figure = found.sensors[0].figures["snr_db"]
    with np.errstate(divide="ignore", invalid="ignore"):
        truth = float(20.0 * np.log10(np.float64(run.truth["fso_mv"]) / noise_mv))
    message = joined([figure.void, figure.note, warnings_of(found)])
    if np.isnan(figure.value) or (np.isinf(figure.value) and figure.void):
        return StudyResult(float("nan"), message)
    low, high = (figure.low, figure.high) if np.isfinite(figure.low + figure.high) else (figure.value, figure.value)
    return StudyResult(max(low - truth, truth - high, 0.0), message)


def overlap(read_percent: float, bulge_at: float) -> StudyResult:
    """Return the sensor's loop over x where only the first part of each branch was read."""
    run = Stairs(bulge_percent=BULGE_PERCENT, bulge_at=bulge_at)
    kept = round(read_percent / 100.0 * STEPS)
    levels, branch = run.holds
    text = "cycle,branch,pressure_kpa,elongation_mm\n"
    for hold, (p, up, x) in enumerate(zip(levels, branch, run.elongation(levels, branch), strict=True)):
        cycle, step = divmod(hold - 1, 2 * STEPS)
        if hold == 0:
            text += f"1,start,{p:.6f},{x:.9f}\n"
        elif step % STEPS < kept:
            text += f"{cycle + 1},{'loading' if up else 'unloading'},{p:.6f},{x:.9f}\n"
    found = analysed_with(run.recording(), text)
    figure = found.sensors[0].figures["sensor_hysteresis_percent_fso"]
    full = found.sensors[0].figures["fso_mv"].value
    truth = BULGE_PERCENT * run.truth["fso_mv"] / full
    message = joined([figure.void, figure.note, warnings_of(found)])
    return StudyResult(off_percent(figure, "percent_fso", truth), message)


STUDIES = (
    Study(
        "figures-snr", "figures", "Signal-to-noise ratio: no span, no noise",
        "20 log10 of the span over the noise put in", "dB", 1.0,
        Axis("span of the signal", "mV", (0.0, 1e-9, 1e-3, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 255.0)),
        Axis("noise, sd", "mV", (0.0, 1e-9, 1e-3, 0.1, 1.49, 10.0, 100.0, 1000.0)), snr,
    ),
    Study(
        "figures-overlap", "figures", "Hysteresis: branches that were read in part", "the width of the loop put in",
        "% FSO", 0.5, Axis("part of each branch that was read", "%", (100.0, 89.0, 78.0, 67.0, 56.0, 44.0, 33.0)),
        Axis("the loop is widest at", "of the range", (0.1, 0.3, 0.5, 0.7, 0.9)), overlap,
    ),
)  # fmt: skip
