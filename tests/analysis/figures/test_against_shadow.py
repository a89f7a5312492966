"""A run beside the shadow, against a plant whose distance from nominal is known."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.figures.against_shadow import against_shadow
from analysis.reports.build import build_report
from tests.analysis.boat_builder import Plant, Staircase
from tests.conftest import mostly_at_night

QUICK = Options(mcmc=False, x_resolution_mm=0.0)


@dataclass(frozen=True)
class Line:
    """A nominal actuator without a loop: x a line of p, `shift_mm` off the plant's, with a band of 0.1 mm."""

    shift_mm: float = 0.0

    def nominal_elongation(self, pressure_kpa: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        p = np.asarray(pressure_kpa)
        return -2.7 + 6.5 * (p + 40.0) / 90.0 - self.shift_mm, np.full(p.shape, 0.1)

    def nominal_pressure(self, elongation_mm: np.ndarray) -> np.ndarray:
        return (np.asarray(elongation_mm) + self.shift_mm + 2.7) * 90.0 / 6.5 - 40.0


@pytest.mark.parametrize("shift_mm", mostly_at_night(0.15, 0.4))
def test_the_deviation_is_the_plants_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shift_mm: float) -> None:
    """Every cycle lies `shift_mm` from nominal and as much, in pressure, from the model; the report names it."""
    monkeypatch.setattr("analysis.shadow.model.table.load_table", lambda **_: Line(shift_mm))
    stairs = Staircase(Plant(noise_mv=(0.2, 0.2), pressure_noise_kpa=0.02), cycles=3)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=QUICK)
    compared = against_shadow(analysis)
    np.testing.assert_allclose(compared.level_mm, shift_mm, atol=0.005)
    np.testing.assert_allclose(compared.residual_kpa, shift_mm * 90.0 / 6.5, atol=0.1)
    content = compared.as_json()
    assert content["deviation_mean_mm"] == pytest.approx(shift_mm, abs=0.005)
    assert content["deviation_per_cycle_mm"] == pytest.approx([shift_mm] * 3, abs=0.005)
    assert [row["cycle"] for row in content["per_cycle"]] == [1, 2, 3]
    report = build_report([analysis], shadow=compared)
    section = next(s for s in report.sections if s.title == "Comparison with the digital shadow")
    stated = re.search(r"from the nominal one by ([\d.]+) mm on average", str(section.parts[0]))
    assert stated is not None
    assert float(stated[1]) == pytest.approx(shift_mm, abs=0.005)


def test_a_run_without_elongation_is_not_compared_and_has_a_reason() -> None:
    """No calibration, no comparison: the reason is in JSON and report."""
    analysis = analyse(Staircase(cycles=1).recording(), options=QUICK)
    compared = against_shadow(analysis)
    assert "no elongation was read" in compared.as_json()["void"]
    section = next(s for s in build_report([analysis], shadow=compared).sections if "shadow" in s.title)
    assert "Not compared" in str(section.parts[0])
