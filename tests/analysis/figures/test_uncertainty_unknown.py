"""What was not assessed is never zero: a sensor that freezes, readings of one branch, one cycle."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.record import CalibrationRecord, SensorRecord
from analysis.calibration.type_b import ONE_CYCLE, contributions
from analysis.calibration_export.calibration_file import CalibrationFile, read_calibration
from analysis.calibration_export.conversion import convert_recording, convert_signals, converted_rows
from analysis.calibration_export.forms import calibration_text
from analysis.calibration_export.run_record import calibration_record
from analysis.calibration_export.verdict import verdict_of
from analysis.certificates.certificate import Request, certificate_of
from analysis.certificates.dcc import dcc_xml
from analysis.certificates.document import certificate_document
from analysis.certificates.laboratory import Laboratory
from analysis.data.export import samples_frame
from analysis.figures.pipeline import Analysis
from analysis.figures.uncertainty import signal_parts
from analysis.numbers import finite
from analysis.reports.run_section import budget as budget_section
from analysis.stopping.criterion import assess_calibration
from boat_daq.viewmodels.results.figure_tables import verdict_rows
from boat_daq.workflows.live_conversion import Conversion
from protocol.base.errors import DataError
from tests.analysis.boat_builder import Plant, Staircase

CASES = {
    "one cycle": ONE_CYCLE,
    "loading read only": "the loop of the sensor is not known: no cycle has both branches",
    "frozen half-way": "lost or left out",
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Analysis]:
    """The three cases, and two cycles, by name; the frozen sensor is the second of two."""
    file = tmp_path_factory.mktemp("runs") / "e.csv"
    options = Options(mcmc=False, x_resolution_mm=0.0)
    found = {}
    for name, cycles in (("one cycle", 1), ("two cycles", 2)):
        stairs = Staircase(Plant(loop_mm=0.25), cycles=cycles)
        stairs.elongations().to_csv(file, index=False)
        found[name] = analyse(
            stairs.recording(meta={"unit": "SA1", "started_utc": "2026-01-01T00:00:00+00:00"}), file, options=options
        )
    stairs = Staircase(Plant(loop_mm=0.25), cycles=3)
    run, read, levels = (
        stairs.recording(meta={"unit": "SA1", "started_utc": "2026-01-01T00:00:00+00:00"}),
        stairs.elongations(),
        stairs.levels(),
    )
    signal = run.signal_mv.copy()
    signal[run.n // 2 :, 1] = signal[run.n // 2, 1]
    read.to_csv(file, index=False)
    frozen = Recording.from_arrays(
        run.time_s, run.pressure_kpa, signal, meta={"unit": "SA1", "started_utc": "2026-01-01T00:00:00+00:00"}
    )
    found["frozen half-way"] = analyse(frozen, file, options=options)
    read["cycle"] = [cycle for _, _, cycle in levels]
    read["branch"] = ["loading" if up else "unloading" for _, up, _ in levels]
    read[read["branch"] == "loading"].to_csv(file, index=False)
    found["loading read only"] = analyse(run, file, options=options)
    return found


@pytest.mark.parametrize("name", CASES)
def test_u_that_rests_on_nothing_is_not_given(runs: dict[str, Analysis], name: str) -> None:
    """No U in JSON, budget, report and stopping rule, each with the reason; the calibration itself is there."""
    analysis = runs[name]
    assert analysis.sensors[1].calibration is not None
    shown = finite(analysis.to_json())["sensors"][1]
    assert shown["u_elongation_mm"] is None
    assert CASES[name] in shown["u_reason"]
    assert analysis.budgets is not None
    budget = analysis.budgets.budgets[1]
    assert np.isnan([budget.u, budget.expanded, budget.coverage]).all()
    assert finite(budget.as_json())["expanded_uncertainty_mm"] is None
    assert CASES[name] in budget.void
    assert all(c.source.startswith("not assessed") for c in budget.components if not c.assessed)
    shown_text = repr(budget_section(analysis.budgets, analysis=analysis))
    assert f"U is not known: {budget.void}" in shown_text
    assert "nan" not in shown_text.split("rows=")[-1].lower()
    if name != "frozen half-way":
        assert assess_calibration(analysis, 0.1, 5).void == budget.void


def test_two_cycles_hold_the_drift_in_the_repeatability(runs: dict[str, Analysis]) -> None:
    """Both make what two cycles differ by: U is known, and the budget says that the drift is not told apart."""
    analysis = runs["two cycles"]
    assert analysis.u_reason == ("", "")
    assert analysis.budgets is not None
    budget = analysis.budgets.budgets[0]
    by_name = {c.name: c for c in budget.components}
    assert by_name["repeatability"].assessed
    assert not by_name["zero drift"].assessed
    assert np.isfinite(budget.u)


@pytest.mark.parametrize("name", CASES)
def test_a_calibration_without_u_converts_without_u(runs: dict[str, Analysis], tmp_path: Path, name: str) -> None:
    """The elongation has a value and no U; stored, exported and read again alike. A sound sensor is used alone."""
    analysis = runs[name]
    record = calibration_record(analysis)
    again = CalibrationRecord.parse(finite(record.as_json()))
    file = CalibrationFile.of_run(analysis)
    (tmp_path / "c.json").write_text(file.text(), encoding="utf-8")
    assert file.as_json()["version"] == 2
    x = np.linspace(-2.0, 3.0, 6)
    signal = np.column_stack([s.calibration.predict(x) for s in analysis.sensors if s.calibration is not None])
    readers = (record.fusion(), again.fusion(), file.reader(), read_calibration(tmp_path / "c.json").reader())
    for reader in readers:
        found = reader.evaluate(signal)
        np.testing.assert_allclose(found.elongation_mm, x, atol=1e-6)
        assert np.isnan(found.standard_uncertainty_mm).all() == (name != "frozen half-way")
    if name == "frozen half-way":
        alone = record.sensors[0].inverse().standard_uncertainty(x)
        np.testing.assert_allclose(readers[0].evaluate(signal).standard_uncertainty_mm, alone, rtol=1e-9)
    converted = convert_signals(file, signal, np.zeros(6, dtype=np.int64))
    assert converted.valid.all()
    assert np.isnan(converted.u_mm).all() == (name != "frozen half-way")
    for form in ("c", "matlab", "csv"):
        assert "U is not known: " in calibration_text(file, form)
    rows = [line.split(",") for line in calibration_text(file, "csv").splitlines() if line.startswith("s2,")]
    assert {row[3] for row in rows} == {""}


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("name", ["one cycle", "frozen half-way"])
def test_exported_c_code_has_no_u_either(runs: dict[str, Analysis], tmp_path: Path, name: str) -> None:
    """Compiled, it gives the elongation of `convert`, and NaN or the U of the sound sensor."""
    analysis = runs[name]
    file = CalibrationFile.of_run(analysis)
    signal = np.array([float(s.calibration.predict(1.0)) for s in analysis.sensors if s.calibration is not None])
    signal[1] += 20.0
    expected = file.reader().evaluate(signal)
    (tmp_path / "c.h").write_text(calibration_text(file, "c"), encoding="utf-8")
    given = ", ".join(map(repr, signal.tolist()))
    main = f"""#include <stdio.h>
#include "c.h"
int main(void) {{
    double signals[2] = {{ {given} }}, u;
    unsigned flags;
    double x = boat_elongation(signals, &u, &flags);
    printf("%.9f %.9f %u", x, u, flags);
    return 0;
}}
"""
    (tmp_path / "m.c").write_text(main, encoding="utf-8")
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-o", tmp_path / "m", tmp_path / "m.c"], check=True)
    x, u, flags = subprocess.run([tmp_path / "m"], check=True, capture_output=True, text=True).stdout.split()
    assert float(x) == pytest.approx(float(expected.elongation_mm), abs=1e-6)
    assert float(u) == pytest.approx(2.0 * float(expected.standard_uncertainty_mm), abs=1e-6, nan_ok=True)
    assert np.isnan(float(u)) == (name == "one cycle")
    assert flags == "0"


@pytest.mark.parametrize("name", ["one cycle", "loading read only"])
def test_no_certificate_without_u(runs: dict[str, Analysis], name: str) -> None:
    """Refused with the cause and what to do."""
    request = Request(Laboratory("Lab"), "C", ("SA1",))
    with pytest.raises(DataError, match="its U is not known") as caught:
        certificate_of([runs[name]], request)
    assert "two cycles" in caught.value.remedy
    assert CASES[name].removesuffix(": run two or more") in caught.value.cause  # which the remedy says


def test_a_certificate_has_no_results_of_the_sensor_without_u(runs: dict[str, Analysis]) -> None:
    """The sound sensor is certified, the frozen one named with its reason."""
    made = certificate_of([runs["frozen half-way"]], Request(Laboratory("Lab"), "C", ("SA1",)))
    sound, frozen = made.items[0].sensors
    assert sound.levels
    assert not frozen.levels
    assert frozen.void.startswith("its U is not known: ")


def test_a_u_wider_than_the_range_is_not_certified(tmp_path: Path) -> None:
    """The cables of two sensors, one rising and one falling, exchanged between the two cycles of a run."""
    rising, falling = (1650.0, 40.0, 0.0, 0.0), (1900.0, -30.0, 0.0, 0.0)
    stairs = Staircase(Plant(cubics=(rising, falling), noise_mv=(1.0, 1.0), loop_mm=0.25), cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    run = stairs.recording(meta={"unit": "SA1", "started_utc": "2026-01-01T00:00:00+00:00"})
    signal = np.where(stairs.trace()[2][:, None] > 1, run.signal_mv[:, ::-1], run.signal_mv)
    swapped = Recording.from_arrays(run.time_s, run.pressure_kpa, signal, meta=dict(run.meta))
    found = analyse(swapped, tmp_path / "e.csv", options=Options(mcmc=False, x_resolution_mm=0.0))
    with pytest.raises(DataError) as caught:
        certificate_of([found], Request(Laboratory("Lab"), "C", ("SA1",)))
    assert "mm is wider than its range" in caught.value.cause


def test_no_verdict_is_green_by_what_was_not_measured(runs: dict[str, Analysis], tmp_path: Path) -> None:
    """A lost sensor, whose range counts no more, and a staircase up only whose loop no limit can be compared with."""
    lost = verdict_of(runs["frozen half-way"])
    assert (lost.state, lost.doubts) == ("check", ("without sensor 2",))
    assert "; without sensor 2" in str(lost.headline)
    stairs = Staircase(Plant(loop_mm=0.25), cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    full = stairs.recording()
    clipped = Recording.from_arrays(full.time_s, full.pressure_kpa, np.minimum(full.signal_mv, [9e9, 1660.0]))
    seen = verdict_of(analyse(clipped, tmp_path / "e.csv", options=Options(mcmc=False, x_resolution_mm=0.0)))
    assert seen.doubts == ("without sensor 2",)
    assert seen.range_mm == pytest.approx((-2.7, 3.8), abs=0.02)
    run = runs["two cycles"].recording
    up = Recording.from_arrays(
        run.time_s, np.where(np.gradient(run.pressure_kpa) < -0.1, 0, run.pressure_kpa), run.signal_mv
    )
    found = verdict_of(analyse(up, options=Options(mcmc=False, fidelity="draft")))
    assert found.state != "ok", str(found.sentence)


def test_unknown_parts_are_stored_as_unknown(runs: dict[str, Analysis]) -> None:
    """No zero in the stored form: null, with the reason; older records keep their numbers."""
    stored = finite(calibration_record(runs["one cycle"]).as_json())["sensors"][0]
    assert stored["between_cycles_mv"] is None
    assert stored["u_reason"] == ONE_CYCLE
    assert SensorRecord.parse({"name": "s1", "model_mv": 2.0}).between_cycles_mv == 2.0
    loading = finite(calibration_record(runs["loading read only"]).as_json())["sensors"][0]
    assert loading["half_loop_mv"] is None
    assert np.isfinite(signal_parts(runs["loading read only"], 0).repeatability)


STATED = {
    "repeatability": {"u_mm": 0.04, "source": "history of SA1"},
    "hysteresis": {"half_width_mm": 0.06, "distribution": "rectangular"},
}


def stated(runs: dict[str, Analysis], name: str, folder: Path, *given: str) -> Analysis:
    """Return a run analysed again with stand-ins of the unit."""
    run = runs[name]
    assert run.elongations is not None
    stairs = Staircase(Plant(loop_mm=0.25), cycles=run.cycles.as_json()["complete"])
    read = stairs.elongations()
    if name == "loading read only":
        read["cycle"] = [cycle for _, _, cycle in stairs.levels()]
        read["branch"] = ["loading" if up else "unloading" for _, up, _ in stairs.levels()]
        read = read[read["branch"] == "loading"]
    read.to_csv(folder / "e.csv", index=False)
    type_b = contributions({key: STATED[key] for key in given})
    options = Options(mcmc=False, x_resolution_mm=0.0, type_b=type_b)
    return analyse(run.recording, folder / "e.csv", options=options)


@pytest.mark.parametrize(("name", "key"), [("one cycle", "repeatability"), ("loading read only", "hysteresis")])
def test_a_stated_stand_in_gives_u_and_is_named_wherever_it_is(
    runs: dict[str, Analysis], tmp_path: Path, name: str, key: str
) -> None:
    """JSON, budget, stored record, export, certificate; the other component alone leaves U unknown."""
    analysis = stated(runs, name, tmp_path, key)
    shown = finite(analysis.to_json())["sensors"][0]
    assert shown["u_elongation_mm"] is not None
    assert shown["u_reason"].startswith(f"U includes a stated value for what the run did not show: {key} (u = ")
    assert analysis.budgets is not None
    budget = analysis.budgets.budgets[0]
    u = 0.04 if key == "repeatability" else 0.06 / np.sqrt(3.0)
    assert {c.name: c.contribution for c in budget.components}[f"{key}, stated"] == pytest.approx(u)
    assert budget.u > u
    record = CalibrationRecord.parse(finite(calibration_record(analysis).as_json()))
    reader = record.sensors[0].inverse()
    assert 2.0 * reader.standard_uncertainty(analysis.budgets.x_mm) == pytest.approx(budget.expanded, rel=0.05)
    assert record.sensors[0].u_stand_in == shown["u_reason"]
    file = CalibrationFile.of_run(analysis)
    for form in ("c", "matlab", "csv"):
        assert "U includes a stated value" in calibration_text(file, form)
    assert "#define BOAT_U_STAND_IN 1" in calibration_text(file, "c")
    (tmp_path / "c.json").write_text(file.text(), encoding="utf-8")
    assert {
        one.u_stand_in for one in (record.fusion(), file.reader(), read_calibration(tmp_path / "c.json").reader())
    } == {shown["u_reason"]}
    converted = convert_recording(analysis.recording, file)
    assert set(converted_rows(analysis.recording.time_s, analysis.recording.signal_mv, converted)["u_stand_in"]) == {1}
    assert set(samples_frame(analysis.recording, slice(0, 9), converted)["u_stand_in"]) == {1}
    verdict = verdict_of(analysis)
    assert "(k = 2, with a stated value)" in str(verdict.headline)
    assert (verdict.as_json()["u_stand_in"], verdict.state) == (shown["u_reason"], "check")
    assert budget.stand_in
    made = certificate_of([analysis], Request(Laboratory("Lab"), "C", ("SA1",)))
    assert any("U includes a stated value" in text for text in made.items[0].warnings)
    assert "U includes a stated value" in dcc_xml(made)
    one_branch = "s1: only the loading branch was measured" in made.items[0].warnings
    assert one_branch == (name == "loading read only")
    other = next(each for each in STATED if each != key)
    assert not np.isfinite(stated(runs, name, tmp_path, other).budgets.budgets[0].u)  # type: ignore[union-attr]


def judged(run: Analysis, curve: CurveVerdict) -> Analysis:
    """Return a run whose curves are judged so."""
    fits = [sensor.calibration for sensor in run.sensors]
    assert all(fit is not None and fit.adequacy is not None for fit in fits)
    fits = [replace(fit, adequacy=replace(fit.adequacy, verdict=curve)) for fit in fits]  # type: ignore[union-attr,type-var]
    return replace(run, sensors=tuple(replace(s, calibration=f) for s, f in zip(run.sensors, fits, strict=True)))


@pytest.mark.parametrize("curve", [CurveVerdict.DOUBTFUL, CurveVerdict.INADEQUATE])
def test_a_curve_that_misses_is_marked_wherever_u_is(runs: dict[str, Analysis], curve: CurveVerdict) -> None:
    """Verdict (never green), JSON, report, window, certificate, exported code and file, and the live calibration."""
    plain, analysis = judged(runs["two cycles"], CurveVerdict.ADEQUATE), judged(runs["two cycles"], curve)
    verdict, said = verdict_of(analysis), f"curve of sensor 1 is {curve}"
    assert (verdict_of(plain).state, verdict.state) == ("ok", "check")
    assert said in str(verdict.headline)
    assert verdict.as_json()["doubts"][0] == f"the {said}"
    assert verdict_rows(analysis.sensors)[0][1][0] == curve
    certificate = certificate_of([analysis], Request(Laboratory("Lab"), "C", ("SA1",)))
    assert certificate.as_json()["items"][0]["sensors"][0]["verdict"] == curve
    assert f"Curve {curve}." in repr(certificate_document(certificate))
    file = CalibrationFile.of_run(analysis)
    assert file.as_json()["sensors"][0]["adequacy"]["verdict"] == curve
    for form in ("c", "matlab", "csv"):
        assert f"s1: the curve is {curve}" in calibration_text(file, form)
    assert Conversion(calibration_record(analysis).fusion()).named("SA1") == f"SA1, curve {curve}"


def test_a_stand_in_that_is_not_needed_does_not_count(runs: dict[str, Analysis], tmp_path: Path) -> None:
    """Two cycles show both: U is that without it, and the budget says so."""
    plain, analysis = stated(runs, "two cycles", tmp_path), stated(runs, "two cycles", tmp_path, *STATED)
    assert plain.budgets is not None
    assert analysis.budgets is not None
    assert analysis.budgets.budgets[0].u == plain.budgets.budgets[0].u
    assert analysis.u_reason == ("", "")
    verdict = verdict_of(analysis)
    assert (verdict.u_stand_in, "stand-in" in str(verdict.headline)) == ("", False)
    assert "u_stand_in" not in samples_frame(
        analysis.recording, slice(0, 9), convert_recording(analysis.recording, CalibrationFile.of_run(analysis))
    )
    unused = [c.source for c in analysis.budgets.budgets[0].components if c.name.endswith(", stated")]
    assert unused == ["not used: the run shows it"] * 2
    assert calibration_record(analysis).sensors[0].type_b == {}


def test_an_older_record_of_one_cycle_has_no_u(runs: dict[str, Analysis]) -> None:
    """It counts as zero what one cycle cannot show; read now, U is unknown; with more cycles as before."""
    stored = finite(calibration_record(runs["two cycles"]).as_json())
    for sensor in stored["sensors"]:
        for key in ("u_reason", "u_stand_in"):
            del sensor[key]
    for cycles, known in ((1, False), (2, True), (0, True)):
        inverse = CalibrationRecord.parse({**stored, "cycles": cycles}).sensors[0].inverse()
        assert np.isfinite(inverse.standard_uncertainty(0.5)) == known
        assert (inverse.u_void == ONE_CYCLE) != known
