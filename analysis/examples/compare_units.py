"""Compare several runs: figures side by side, within-run and between-run spread, one report.

python -m analysis.examples.compare_units report.html run1.boat run2.boat ...
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from analysis import AnalysisError, analyse, write_report
from analysis.history.between_runs import sensor_spread


def main(report: str, runs: Sequence[str]) -> int:
    """Write the comparison; return the number of runs compared."""
    analyses = [analyse(run, mcmc=False) for run in runs]
    for run, analysis in zip(runs, analyses, strict=True):
        figures = [sensor.figures["system_hysteresis_percent_fso"].value for sensor in analysis.sensors]
        print(f"{run} ({analysis.recording.unit}): hysteresis {', '.join(f'{f:.2f}' for f in figures)} % FSO")
    try:
        spread = sensor_spread(analyses, 0).pooled
        print(f"s1: within a run {spread.repeatability:.3f} mV, between runs {spread.between:.3f} mV")
    except AnalysisError as error:
        print(f"no spread: {error.cause}")
    write_report(analyses, report)
    return len(analyses)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
