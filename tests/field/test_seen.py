"""What a log shows of itself: held values, clipped sensors, short holds, like warnings, loops of strokes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import Options, PlateauSettings, analyse
from analysis.calibration.type_b import contributions
from analysis.certificates.certificate import Request, certificate_of
from analysis.certificates.dcc import dcc_xml
from analysis.certificates.document import certificate_document
from analysis.certificates.laboratory import Laboratory
from analysis.data.csv_import import import_csv
from analysis.figures.warnings import merged
from analysis.segmentation.strokes import find_strokes, stroke_figures
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, DataError
from tests.field.truth import FSO_MV, HYSTERESIS, NOISE_MV, Run, are_the_truth, put, signal, staircase


def codes(path: Path) -> dict[str, str]:
    """Return the warnings of a file by code."""
    return {str(w.code): w.text for w in analyse(import_csv(path), mcmc=False).warnings}


def value(path: Path, name: str, **options: PlateauSettings) -> float:
    """Return a figure of the first sensor."""
    return analyse(import_csv(path), options=Options(mcmc=False, **options)).sensors[0].figures[name].value


@pytest.mark.parametrize("name", ["m01_up_only", "m02_fast_vent"])
def test_one_branch_has_no_loop(cases: Path, name: str) -> None:
    """Steps up that are vented at once have no unloading level; a vent in 10 samples has none either."""
    assert np.isnan(value(cases / f"{name}.csv", "system_hysteresis_percent_fso"))


@pytest.mark.parametrize("hysteresis", [{}, {"hysteresis": {"u_mm": 0.03}}], ids=["not known", "stated"])
def test_a_certificate_says_that_one_branch_was_measured(cases: Path, hysteresis: dict[str, Any]) -> None:
    """Steps up only: without a stated loop there is no U and no certificate; with one it says which branch it is of."""
    run = import_csv(cases / "m01_up_only.csv")
    known = replace(run, meta={**run.meta, "unit": "U1", "started_utc": "2026-11-01T10:00:00+00:00"})
    options = Options(mcmc=False, type_b=contributions(hysteresis))
    found, request = analyse(known, cases / "m01_readings.csv", options=options), Request(Laboratory("Lab"), "C")
    if not hysteresis:
        with pytest.raises(DataError, match="only the loading branch was driven"):
            certificate_of([found], request)
        return
    certificate = certificate_of([found], request)
    assert "U1: s1: only the loading branch was measured." in repr(certificate_document(certificate))
    assert "only the loading branch was measured" in dcc_xml(certificate)


def test_a_saturated_sensor_is_named(cases: Path) -> None:
    """Dither of two counts at the end of the scale is no signal; a true maximum of many counts is one."""
    assert "clipped" in codes(cases / "m06_saturated_dither.csv")
    assert "clipped" not in codes(cases / "m00_reference.csv")


def counts(run: Run, full: float, low: float = -1e9) -> list[str]:
    """Return signals in steps of 0.5 mV with dither, clipped at both ends."""
    rng = np.random.default_rng(1)
    dithered = np.round(2 * run.signal_mv) / 2 + 0.5 * rng.integers(-1, 2, run.time_s.size)
    shown = np.clip(dithered, low, full)
    at_end = shown >= full - 0.5
    shown = np.where(at_end, full - 0.5 * rng.integers(0, 3, run.time_s.size), shown)
    rows = zip(run.time_s, run.pressure_kpa, shown, strict=True)
    return ["time_s,pressure_kpa,s1_mv", *(f"{t:.3f},{p:.4f},{s:.1f}" for t, p, s in rows)]


@pytest.mark.parametrize(("full", "named"), [(1850.0, True), (2500.0, False)])
def test_the_end_of_the_scale_is_told_from_a_maximum(tmp_path: Path, run: Run, full: float, named: bool) -> None:
    """A staircase cut at two thirds is clipped, one that only ends there is not."""
    assert ("clipped" in codes(put(tmp_path, counts(run, full)))) is named


def test_short_holds_name_a_settling_time(cases: Path) -> None:
    """With it the figures are those of the reference; the voids are one warning."""
    path = cases / "m20_half_second_holds.csv"
    found = codes(path)
    assert "state one of 0.1 s" in found["short_holds"]
    voids = [w for w in analyse(import_csv(path), mcmc=False).warnings if str(w.code) == "void"]
    assert len(voids) == 1
    settled = PlateauSettings(settling_s=0.1)
    assert abs(value(path, "system_hysteresis_percent_fso", plateau=settled) - HYSTERESIS) < 0.05


def test_noise_of_holds_too_short_is_that_of_the_signal(cases: Path) -> None:
    """Corners of the pressure are no noise."""
    noise = value(cases / "m20_holds_shorter_than_settling.csv", "noise_mv")
    assert np.isnan(noise) or abs(noise - NOISE_MV) < 0.05


@pytest.mark.parametrize("hold_s", [0.3, 0.4])
def test_noise_of_other_short_holds(tmp_path: Path, hold_s: float) -> None:
    """The same at other lengths."""
    run = staircase(hold_s=hold_s, ramp_kpa_s=400.0)
    noise = value(put(tmp_path, run.lines()), "noise_mv")
    assert np.isnan(noise) or abs(noise - NOISE_MV) < 0.1


@pytest.mark.parametrize(("held", "said"), [(10, True), (1, False)])
def test_held_values_are_said(tmp_path: Path, run: Run, held: int, said: bool) -> None:
    """A pressure that is repeated ten times has a tenth of the rate, and is interpolated."""
    kept = Run(run.time_s, np.repeat(run.pressure_kpa[::held], held)[: run.time_s.size], run.signal_mv)
    recording = import_csv(put(tmp_path, kept.lines()))
    notes = recording.meta.get("import_notes", [])
    are_the_truth(recording)
    assert any("holds each value for 10 rows" in note for note in notes) is said


def test_like_texts_are_one() -> None:
    """Hundreds with one reason are one with their count; few stay, and so do others."""
    many = [f"plateau {k}: {k} % lost" for k in range(200)]
    assert list(merged([*many, "cycle 1: paused"])) == ["plateau 0 and 199 more: 0 % lost", "cycle 1: paused"]
    assert list(merged(many[:5])) == many[:5]


def strokes(n: int, noise_kpa: float, shape: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return twelve cycles of n samples: times, pressures, signals."""
    rng = np.random.default_rng(5)
    share = (np.arange(12 * n) % n) / n
    if shape == "sine":
        p = 25 - 25 * np.cos(2 * np.pi * share)
    elif shape == "vent":  # slowly up, down as a volume empties
        p = np.where(share < 0.5, 100 * share, 50 * np.exp(-8 * (share - 0.5)))
    else:
        p = 50 * (1 - np.abs(2 * share - 1))
    y = signal(p, np.where(share < 0.5, 1.0, -1.0)) + rng.normal(0, 0.3, p.size)
    return np.arange(12 * n) / 50, p + rng.normal(0, noise_kpa, p.size), y


@pytest.mark.parametrize(
    ("n", "noise_kpa", "shape", "within"),
    [(1000, 0.02, "triangle", 0.1), (1000, 0.5, "triangle", 0.3), (40, 0.02, "sine", 0.2), (800, 0.02, "vent", 0.15)],
)
def test_the_half_width_is_at_equal_pressure(n: int, noise_kpa: float, shape: str, within: float) -> None:
    """5.7 mV in closed form, whatever the noise, the samples a cycle and the speeds of the branches."""
    z = np.linspace(-0.4, 0.4, 1001)
    found = find_strokes(*strokes(n, noise_kpa, shape))
    assert abs(found.half_width_mean - float((6 * (1 - z * z)).mean())) < within


def test_a_staircase_has_no_strokes(tmp_path: Path, run: Run) -> None:
    """It is refused, and its full scale is that of the analysis."""
    path = put(tmp_path, run.lines())
    with pytest.raises(BoatDaqError, match="plateaus"):
        stroke_figures(import_csv(path))
    assert abs(value(path, "fso_mv") - FSO_MV) < 0.5
