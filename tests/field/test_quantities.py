"""Displacement columns as elongation; signals of other quantities, with scale and offset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import analyse, load_recording
from analysis.data.boat_writer import write_boat_file
from analysis.data.csv_import import import_csv
from analysis.reports.build import write_report
from protocol.base.errors import BoatDaqError
from tests.field.truth import FSO_MV, Run, is_the_truth, put

SLOPE_MM = 0.08  # a kPa
UNIT_OF = {"Force (N)": "N", "Resistance (kOhm)": "kohm", "Capacitance [pF]": "pF", "Wavelength (nm)": "nm",
           "S1 (counts)": "counts"}  # fmt: skip


def with_laser(run: Run, form: str = "{:.3f},{:.4f},{:.4f},{:.4f}", head: str = "Laser (mm)") -> list[str]:
    """Return a table with a displacement sensor of 1 um, 2 um noise."""
    rng = np.random.default_rng(4)
    x = SLOPE_MM * run.pressure_kpa + rng.normal(0, 0.002, run.time_s.size)
    rows = zip(run.time_s, run.pressure_kpa, run.signal_mv, np.round(x, 3), strict=True)
    return [f"time_s,pressure_kpa,s1_mv,{head}", *(form.format(*row) for row in rows)]


@pytest.mark.parametrize(("head", "mapped"), [("Laser (mm)", ""), ("Ch 4", "4:mm"), ("LVDT (um)", "4*1000:um")])
def test_a_displacement_column_is_the_elongation(tmp_path: Path, run: Run, head: str, mapped: str) -> None:
    """A calibration without a typed reading: 6 mV/kPa over 0.08 mm/kPa, also from the stored recording."""
    path = put(tmp_path, with_laser(run, head=head))
    recording = import_csv(path, columns={"elongation_mm": mapped} if mapped else None)
    write_boat_file(tmp_path / "a.boat", recording, original=path)
    for one in (recording, load_recording(tmp_path / "a.boat")):
        found = analyse(one, mcmc=False)
        assert found.kind == "calibration"
        assert found.sensors[0].figures["sensitivity_mv_per_mm"].value == pytest.approx(6 / SLOPE_MM, rel=0.01)
        assert found.elongations.resolution_mm < 0.01


@pytest.mark.parametrize("title", UNIT_OF)
def test_signals_of_other_quantities_keep_their_unit(tmp_path: Path, run: Run, title: str) -> None:
    """The figures are in the unit of the signal: in JSON, and in the report no mV is left."""
    path = put(tmp_path, run.lines(head=f"time_s,pressure_kpa,{title}"))
    recording = import_csv(path)
    assert recording.signal_unit == UNIT_OF[title]
    found = analyse(recording, mcmc=False)
    assert found.to_json()["signal_unit"] == UNIT_OF[title]
    assert found.sensors[0].figures["fso_mv"].value == pytest.approx(FSO_MV, abs=0.5)
    if title == "Force (N)":
        write_report([found], tmp_path / "a.html")
        text = (tmp_path / "a.html").read_text(encoding="utf-8")
        assert "Full-scale output, N" in text
        assert " mV<" not in text


def test_scale_and_offset_are_of_the_map(tmp_path: Path, run: Run) -> None:
    """A transducer of 25 kPa a volt from 0.5 V on, and an amplifier of 2, inverted."""
    rows = zip(run.time_s, run.pressure_kpa / 25 + 0.5, 2000 - run.signal_mv / 2, strict=True)
    lines = ["time_s,AI1,AI2-a", *(f"{t:.3f},{p:.6f},{s:.4f}" for t, p, s in rows)]
    path = put(tmp_path, lines)
    columns = {"pressure_kpa": "AI1*25-12.5:kPa", "s1_mv": "AI2-a*-2+4000:mV"}
    is_the_truth(path, columns=columns)
    again = import_csv(path, columns=import_csv(path, columns=columns).meta["import_map"])
    np.testing.assert_allclose(again.pressure_kpa, run.pressure_kpa, atol=1e-4)


def test_signals_of_two_quantities_are_refused(tmp_path: Path, run: Run) -> None:
    """One recording has one unit of signals."""
    rows = [f"{line},1" for line in run.lines(head="")]
    path = put(tmp_path, ["time_s,pressure_kpa,S1 (mV),S2 (N)", *rows])
    with pytest.raises(BoatDaqError, match="in N, another signal in mV"):
        import_csv(path)
