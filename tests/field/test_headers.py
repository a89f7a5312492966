"""Headers, units and preambles of other programs; the choice of columns by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.data.csv_import import import_csv, preview
from protocol.base.errors import BoatDaqError
from tests.field.truth import HEAD, Lines, Run, holds, is_the_truth, put

FOLDER = {
    "m07_9_sensors": "9 sensors, of which a recording holds 8: s9_mv left out",
    "m07_12_sensors": "s9_mv, s10_mv, s11_mv, s12_mv left out",
    "m12_nul_lines": "NUL bytes left out",
    "m12_nul_tail": "512 NUL bytes left out",
    "m19_unit_psig": "",
    "m19_unit_kPag": "",
    "m19_unit_barg": "",
    "m19_unit_kgfcm2": "",
    "m19_unit_cmH2O": "",
    "m19_savetxt": "",
    "m19_percent": "",
}


@pytest.mark.parametrize("name", FOLDER)
def test_the_cases_of_the_folder(cases: Path, name: str) -> None:
    """Each gives the figures of the reference, and what was left out is said."""
    is_the_truth(cases / f"{name}.csv", FOLDER[name])


def test_words_for_units(cases: Path) -> None:
    """Second and Volt are units; the transducer's 10 kPa a volt are stated by hand."""
    path = cases / "m19_words_for_units.csv"
    with pytest.raises(BoatDaqError, match="no column was recognised as pressure_kpa"):
        import_csv(path)
    is_the_truth(path, columns={"pressure_kpa": "CH1*10:kPa", "s1_mv": "CH2"})


def headed(*head: str, form: str = "{:.3f},{:.4f},{:.4f}", factor: float = 1.0) -> Lines:
    """Return what writes a table below such lines, with the pressures in another unit."""
    return lambda run: [
        *head,
        *(form.format(t, p * factor, s) for t, p, s in zip(run.time_s, run.pressure_kpa, run.signal_mv, strict=True)),
    ]


OWN: dict[str, Lines] = {
    "inches of water": headed("Time (s),Pressure (inH2O),S1 (mV)", factor=1 / 0.24908891),
    "newtons a square": headed("Time (s),Pressure (N/mm2),S1 (mV)", factor=1e-3, form="{:.3f},{:.7f},{:.4f}"),
    "squares": headed("Time (s),Pressure (kg/cm²),S1 (mV)", factor=1 / 98.0665, form="{:.3f},{:.6f},{:.4f}"),
    "a word in the first row": headed("time_s,pressure_kpa,s1_mv", "0.000,0.0408,OVLD"),
    "a unit behind a word, gauge": headed("Elapsed Seconds,Pressure kPa (gauge),S1 mV"),
    "units in words": headed("Time,Pressure,Signal", "Seconds,Kilopascals,Millivolts"),
    "a row of units above": headed("s,kPa,mV", "Time,Pressure,Signal"),
    "a preamble with numbers": headed("Device,7", "Channels,3", "Rate,50", "", "Time [s],Pressure [kPa],Signal [mV]"),
    "names, units, kinds": headed('"TOA5","lab","CR1000"', "TIME,Pressure,Signal", "s,kPa,mV", "Smp,Smp,Smp"),
    "blanks behind a sign": headed("# bench 3", "# time_s pressure_kpa s1_mv", form="{:.3f}\t{:.4f}\t{:.4f}"),
    "letters for sensors": headed("Time (s),Pressure (kPa),Sensor A (mV)"),
    "voltages from zero": headed("Time\tPressure_0\tVoltage_0", form="{:.3f}\t{:.4f}\t{:.4f}"),
    "numbers from zero": headed("Time (s),Pressure (kPa),CH0 (mV)"),
    "an empty first row": headed("Time (s),Pressure (kPa),S1 (mV)", ",,", ",,"),
    "feet of water": headed("Time (s),Pressure (ft H2O),S1 (mV)", factor=1 / 2.98898, form="{:.3f},{:.6f},{:.4f}"),
    "a table above": headed("Root\tTitle\tGroups", "", "Group\tChannels\t", "Data\t2\t", "Time*\tp (kPa)\tSignal (mV)",
                            form="{:.3f}\t{:.4f}\t{:.4f}"),
    "settings as wide as the table": headed("Model,MSO24,", ",,", "Vertical Units,V,V", "Source,CH1,CH2", "Offset,0,0",
                                            "TIME,Pressure (kPa),CH2 (mV)"),
    "a setpoint before the pressure": headed("Time (s),Druck Soll (kPa),Druck Ist (kPa),S1 (mV)",
                                             form="{0:.3f},20,{1:.4f},{2:.4f}"),
    "units behind the numbers": headed("Time,Pressure,Signal", form="{:.3f} s,{:.4f} kPa,{:.4f} mV"),
    "a column of the unit": headed("Time (s);p;Units;Signal;Units", form="{:.3f};{:.6f};bar;{:.4f};mV", factor=0.01),
    "a header in each page": lambda run: [
        line for k, row in enumerate(run.lines(head="")) for line in ([HEAD] * (k % 500 == 0) + [row])],
    "Swiss numbers": lambda run: ["Zeit (s);Druck (Pa);Signal (mV)", *(
        f"{t:.3f};{1e3 * p:,.1f};{y:,.4f}".replace(",", "'")
        for t, p, y in zip(run.time_s, run.pressure_kpa, run.signal_mv, strict=True))],
    "a title that is no known sensor": headed("Time (s),Pressure (kPa),Transducer (mV)"),
    "a unit before the serial numbers": headed(
        '"Plot Title: bench"', '"#","Time, s","Pressure, kPa (LGR S/N: 2, SEN S/N: 2)","Voltage, mV (LGR S/N: 2)"',
        form="1,{:.3f},{:.4f},{:.4f}"),
    "a unit before the name": headed("Scan Sweep Time (s),102 (kPa)- Pressure,106 (mVdc)- S1"),
    "channels with units in brackets": headed('"Comment","Pressure","S1"', '"Time","CH1-1[kPa]","CH1-2[mV]"',
                                              form="{:.6E}, {:.6E}, {:.6E}"),
    "channels of which one is a pressure": headed("Time (s)\tChannel 1 (PSIG)\tChannel 2 (mV)",
                                                  form="{:.3f}\t{:.6f}\t{:.4f}", factor=1 / 6.894757),
    "Japanese": headed("モデル,NR-500", "サンプリング周期,20ms", "時間,圧力,センサ", "s,kPa,mV"),
    "cycles elapsed": headed('"Total Time (s)","Elapsed Cycles","Pressure(Linear:Pressure) (kPa)","S1 (mV)"',
                             form="{:.3f},1,{:.4f},{:.4f}"),
    "titles in two rows": headed('"Tag","","Kanal","Wert"', '"Unit","","kPa","mV"', '"Time","Reading","",""',
                                 form="{:.3f},7,{:.4f},{:.4f}"),
    "a blank behind the sign": lambda run: ["Time (s),Pressure (kPa),S1 (mV)", *(
        f"{t:.3f},{'-+'[int(p >= 0)]} {abs(p):.4f},+ {y:.4f}"
        for t, p, y in zip(run.time_s, run.pressure_kpa, run.signal_mv, strict=True))],
    "an interval above the columns": headed(
        "Channel\tPressure\tS1", "Unit\tkPa\tmV", "Increment\t0.02\t0.02", "Length\t99\t99", "",
        form="\t{1:.4f}\t{2:.4f}"),
    "an oscilloscope": headed("X,Pressure,CH2,Start,Increment,", "Sequence,KPA,mV,-3.0e+00,2.000000e-02",
                              form="{0:.0f},{1:.4f},{2:.4f},,"),
}  # fmt: skip


@pytest.mark.parametrize("name", OWN)
def test_other_headers(tmp_path: Path, run: Run, name: str) -> None:
    """Each has the samples of the run."""
    holds(import_csv(put(tmp_path, OWN[name](run))), run)


def test_titles_that_are_numbers(tmp_path: Path, run: Run) -> None:
    """The channels of an oscilloscope are mapped by number; a column without a unit is said to be taken as ours."""
    path = put(tmp_path, headed("x-axis,1,2", "second,Volt,Volt", form="{:+.6E},{:+.6E},{:+.6E}", factor=0.1)(run))
    holds(import_csv(path, columns={"pressure_kpa": "2*10:kPa", "s1_mv": "3:mV"}), run)
    path = put(tmp_path, headed("time_s,A,B")(run))
    holds(
        import_csv(path, columns={"pressure_kpa": "A", "s1_mv": "B"}), run, "'B' is mapped without a unit: taken as mV"
    )


def test_two_pressures_are_a_choice(tmp_path: Path, run: Run) -> None:
    """Which one is the actuator's nobody can tell; the same pressure in two units is one."""
    lines = [f"{t:.3f},{2 * p:.4f},{p:.4f},{s:.4f}" for t, p, s in zip(run.time_s, run.pressure_kpa, run.signal_mv)]  # noqa: B905
    path = put(tmp_path, ["time_s,Pressure A (kPa),Pressure B (kPa),s1_mv", *lines])
    with pytest.raises(BoatDaqError, match=r"columns 2 \(Pressure A\) and 3 \(Pressure B\) may both be"):
        import_csv(path)
    holds(import_csv(path, columns={"pressure_kpa": "3"}), run)
    both = [f"{t:.3f},{10 * p:.3f},{p:.4f},{s:.4f}" for t, p, s in zip(run.time_s, run.pressure_kpa, run.signal_mv)]  # noqa: B905
    holds(import_csv(put(tmp_path, ["time_s,Pressure (mbar),Pressure (kPa),s1_mv", *both])), run)


def test_lines_are_skipped_by_hand(tmp_path: Path, run: Run) -> None:
    """A table of settings above the table: nobody can tell, so the user may."""
    path = put(tmp_path, [*(f"{k},{k / 7:.3f},{k % 5}" for k in range(400)), *run.lines()])
    is_the_truth(path, skip=400)
    assert preview(path, skip=400)["first_data_line"] == 402


def test_an_absolute_pressure_is_refused_with_what_to_do(tmp_path: Path, run: Run) -> None:
    """Pressures are gauge: the ambient pressure is stated."""
    rows = [f"{t:.3f},{p + 101.3:.4f},{s:.4f}" for t, p, s in zip(run.time_s, run.pressure_kpa, run.signal_mv)]  # noqa: B905
    path = put(tmp_path, ["Time (s),Pressure (kPa abs),S1 (mV)", *rows])
    with pytest.raises(BoatDaqError, match="absolute pressure") as refused:
        import_csv(path)
    assert "--map pressure_kpa=2-AMBIENT:kPa" in refused.value.remedy
    is_the_truth(path, columns={"pressure_kpa": "2-101.3:kPa"})


def test_a_number_is_a_number_and_a_name_a_name(tmp_path: Path, run: Run) -> None:
    """A column that is called 3 is the third one only where it stands there."""
    rows = zip(run.time_s, run.signal_mv, run.pressure_kpa, strict=True)
    path = put(tmp_path, ["time_s,3,2", *(f"{t:.3f},{s:.4f},{p:.4f}" for t, s, p in rows)])
    found = import_csv(path, columns={"pressure_kpa": "3", "s1_mv": "2"})
    np.testing.assert_allclose(found.pressure_kpa, run.pressure_kpa, atol=1e-4)
    again = import_csv(path, columns=found.meta["import_map"])
    np.testing.assert_array_equal(again.pressure_kpa, found.pressure_kpa)
    with pytest.raises(BoatDaqError, match="there is no column 4"):
        import_csv(path, columns={"pressure_kpa": "4", "s1_mv": "2"})


def test_the_sensors_of_twelve_are_chosen_by_hand(cases: Path) -> None:
    """The remedy that is named works."""
    found = import_csv(cases / "m07_12_sensors.csv", columns={"s1_mv": "s12_mv", "s2_mv": "s9_mv"})
    assert found.n_sensors == 2
    assert found.signal_mv[0, 0] - found.signal_mv[0, 1] == pytest.approx(3.0)


@pytest.mark.parametrize(("count", "title"), [(10, "CH{} (mV)"), (16, "Sensor {} (mV)")])
def test_more_sensors_than_a_recording_holds_are_said(tmp_path: Path, run: Run, count: int, title: str) -> None:
    """The first eight are taken, the others named."""
    titles = [title.format(k) for k in range(1, count + 1)]
    rows = [f"{row}{f',{s:.3f}' * (count - 1)}" for row, s in zip(run.lines(head=""), run.signal_mv, strict=True)]
    found = import_csv(put(tmp_path, [",".join(["Time (s)", "Pressure (kPa)", *titles]), *rows]))
    assert found.n_sensors == 8
    note = f"{count} sensors, of which a recording holds 8: {title.split(' (')[0].format(9)}"
    assert any(text.startswith(note) for text in found.meta["import_notes"])
