"""Numbers of the documents beside what the commands named there compute now."""

from __future__ import annotations

import argparse
import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student
from typer.testing import CliRunner

from analysis.optics.scene.parameters import Light
from analysis.optics.sweep.figure_of_merit import merit
from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import MESH_ERROR_PERCENT
from analysis.shadow.model.reduced import ReducedModel, TableSettings
from analysis.shadow.monitoring.cusum import smallest_shift, threshold_for
from analysis.signal_prediction import light_table
from analysis.signal_prediction.prediction import published_prediction
from boat_daq.cli import app
from boat_daq.workflows.measured_methods import tradeoff_methods
from tests.docs.pages import ROOT
from tests.verification.alarm_delays import FAULTS, delays
from tests.verification.mesh_error import errors
from tests.verification.polarisation import more_percent
from tests.verification.sensing_principle import ENVELOPE_MM, FOUND, MODULUS_KPA, RANGES, drawn, repeated
from tests.verification.uncertainty_coverage import table as table_of_u

ENDS = ("50", "-40")  # kPa
TRADEOFF = "analysis/studies/tradeoff/METHODS.md"
OPTICS, PAPER = "docs/reproduction/optics.md", "docs/reproduction/paper.md"
SHADOW, TRACER = "analysis/shadow/METHODS.md", "analysis/optics/METHODS.md"
METHODS = "analysis/METHODS.md"


def called(*words: str) -> Any:
    """Return the JSON object of a command."""
    result = CliRunner().invoke(app, [*words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def cells(page: str, row: str) -> list[str]:
    """Return the cells of the row of a page's table that begins so."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.search(rf"^\| *{re.escape(row)} *\|(.*)\|$", text, re.MULTILINE)
    assert found, f"{page} has no row {row!r}"
    return [cell.strip() for cell in found[1].split("|")]


def says(page: str, text: str) -> None:
    """Assert that a page holds a text, wherever its lines break."""
    assert text in " ".join((ROOT / page).read_text(encoding="utf-8").split())


def test_baselines_beside_the_light_are_those_of_twin_predict() -> None:
    """Four fits of both published cubics."""
    rows = {
        "light of the default actuator": [f"{one.before.r2:.3f}" for one in published_prediction()],
        "the same, with a loss of the guide (at its bound)": [f"{one.after.r2:.3f}" for one in published_prediction()],
        "straight line in elongation": [f"{one.line.r2:.3f}" for one in published_prediction()],
        "parabola in elongation": [f"{one.parabola.r2:.4f}" for one in published_prediction()],
    }
    for name, r2 in rows.items():
        assert cells(OPTICS, name)[:2] == r2
    assert all(one.after.at_bound for one in published_prediction())


def test_limits_of_the_shadow_are_those_of_shadow_solve() -> None:
    """Where the default actuator buckles, and its ends."""
    found = called("shadow", "solve", "--pressure", "-40")
    says(SHADOW, f"becomes oval (n = 2) at {found['critical_pressure_kpa']:.1f} kPa")
    assert cells(PAPER, "shadow: pressure of buckling")[2] == f"{found['critical_pressure_kpa']:.6g}"
    assert cells(PAPER, "shadow: elongation at -40 kPa")[2] == f"{found['elongation_mm']:.6g}"
    stretched = called("shadow", "solve", "--pressure", "50")["elongation_mm"]
    assert cells(PAPER, "shadow: elongation at +50 kPa")[2] == f"{stretched:.6g}"


def test_errors_of_the_shadow_are_those_of_shadow_solve_and_table() -> None:
    """Of mesh and table, and the range of the table; what history finds of an alarm's shift."""
    solved, made = called("shadow", "solve", "--pressure", "50", "--model", "reduced"), called("shadow", "table")
    says(SHADOW, "one for all, {} x ({} + {}) elements".format(*solved["mesh"]))
    says(SHADOW, f"(`error_mm`) is {solved['error_mm']:g} mm")
    says(SHADOW, f"are within {MESH_ERROR_PERCENT:g} % of the elongation")  # see tests/verification/test_mesh_error.py
    says(SHADOW, f"held-out states: {made['error_bound_mm']:.1e} mm".replace("e-04", "e-4"))
    (low, high), (least, greatest) = made["pressure_range_kpa"], made["elongation_range_mm"]
    says(SHADOW, f"{low:.1f} to {high:+.0f} kPa and {least:.1f} to {greatest:+.1f} mm")
    shifts = [smallest_shift(cycles, threshold_for(1000.0, 10)) for cycles in (20, 100)]
    says(SHADOW, "d = {:.1f} after 20 cycles and {:.1f} after 100.".format(*shifts))


def numbers(text: str) -> list[float]:
    """Return the numbers of a text; a comma before three digits separates thousands."""
    found = re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", re.sub(r"(?<=\d),(?=\d{3})", "", text))
    return [float(number) for number in found]


def test_settings_of_the_tradeoff_are_those_in_use() -> None:
    """Tolerance, and the settings of draft, normal and reference."""
    for name in ("tracer", "ranking", "full-fem", "reduced-fem", "posterior", "inverse", "segmentation", "bootstrap",
                 "tracking"):  # fmt: skip
        method, (_, tolerance, settings) = tradeoff_methods()[name], cells(TRADEOFF, name)
        assert set(numbers(settings)) == set(numbers(" ".join(method.in_code.values()))), name
        assert any(number == pytest.approx(method.tolerance, rel=0.01) for number in numbers(tolerance)), name


def test_settings_of_the_models_are_those_in_use() -> None:
    """Actuator, table and light; ranges of the search; U of few degrees of freedom."""
    size, table = ActuatorParameters(), TableSettings()
    assert cells(SHADOW, "wall modulus, neck radius")[0] == f"{size.wall_modulus_kpa} kPa, {size.neck_radius_mm} mm"
    assert cells(SHADOW, "wall")[0] == f"{size.wall_mm} mm"
    says(SHADOW, f"prescribed at {table.pressures} x {table.elongations} Chebyshev points")
    says(SHADOW, f"value decomposition to {table.modes} shapes")
    says(SHADOW, f"tracked point over {table.held_out} held-out states")
    says(METHODS, f"at {light_table._SHAPES} solved shapes, three losses of the guide (0, 0.5 and 1 dB/cm) and ")
    says(METHODS, f"{light_table._RAYS:,} rays, with every reflection")
    says(METHODS, f"Losses are traced at {light_table.FIRST} elongations")
    (_, belly, wall, nu), (low, high) = RANGES.values(), ENVELOPE_MM
    says(OPTICS, "belly {:g} to {:g} mm, wall {:g} to {:g} mm, Poisson's ratio of the".format(*belly, *wall))
    says(OPTICS, "of the lattice {:g} to {:g}, envelope {:g} to {:g} mm".format(*nu, low, high))
    says(OPTICS, "wall ({:g} to {:g} MPa)".format(*(kpa / 1000.0 for kpa in MODULUS_KPA)))
    covered = [100.0 * (2.0 * student.cdf(2.0, dof) - 1.0) for dof in (1e6, 5)]
    says(METHODS, "covers {:.0f} % with many degrees of freedom and {:.0f} % with 5".format(*covered))


def test_no_design_of_figure_3d_falls_throughout() -> None:
    """Else P as printed were infinite there, and a map divided by its maximum could not be drawn."""
    designs = tuple(one for one in paper_grid() if (one.cavities, one.width_mm) == (5, 1.0))
    assert len(designs) == 36
    for rays in (250, 1000):
        found = run_sweep(SweepRequest(designs, light=Light().with_rays(rays)))
        assert np.all(merit(found.ndr, found.floor).n_sign > 0)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_error_of_the_mesh_is_that_of_random_actuators() -> None:
    """95 % of 150."""
    found, true = errors(150)
    assert f"{np.quantile(100.0 * found / np.maximum(np.abs(true), 0.1), 0.95):.1f}" == f"{MESH_ERROR_PERCENT:g}"


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_delays_of_alarms(table: ReducedModel) -> None:
    """90 % of nine runs."""
    cycles = [round(float(np.percentile(delays(name, table), 90))) for name in FAULTS]
    says(SHADOW, "within {} staircases or {} continuous cycles, a softening of 5 % in".format(*cycles))
    says(SHADOW, "in 50 cycles within {}, sensors 4 mV apart within {}.".format(*cycles[2:]))


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_more_light_with_both_polarisations() -> None:
    """The least and the greatest of six scenes."""
    found = more_percent()
    says(TRACER, f"{min(found):.1f} to {max(found):.1f} % more power is detected (")


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_guides_found_are_those_of_the_search() -> None:
    """The first 64 actuators drawn, and both guides found, on the mesh of the search and on that of the shadow."""
    first = itertools.islice(drawn(argparse.Namespace(rays=50)), 64)
    growths = [guide.curvature_growth for _, guides in first for guide in guides]
    assert len(growths) > 64
    assert max(growths) < 0.0
    (_, (bent,)), (outcome, _), *lit = repeated(argparse.Namespace(again=FOUND, rays=50_000))
    end_mm = bent.actuator.guide_end_mm
    says(OPTICS, f"reaches {100.0 * bent.curvature_growth:+.1f} %, with end pieces of {end_mm:.0f} mm")
    assert outcome == "unstable above -40 kPa"
    (best, limit), (finer, _) = [(max(guides, key=lambda each: min(each.r2)), guides[0].limit_kpa) for _, guides in lit]
    says(OPTICS, f"with R² {min(best.r2):.3f} ({min(finer.r2):.3f} on the shadow's mesh)")
    assert limit < -55.0
    one = best.actuator
    says(OPTICS, f"{one.cells} cells, a belly of {one.belly_radius_mm:.1f} mm, a wall of {one.wall_mm:.1f} mm, ")
    says(OPTICS, f"guides {one.guide_bow_mm:.0f} mm from the axis and end pieces of {one.guide_end_mm:.0f} mm")
    low = (18.34 - one.lattice_modulus_kpa) / 1.86
    says(OPTICS, f"{one.lattice_modulus_kpa:.1f} kPa, lies {low:.1f} standard deviations low")


@pytest.mark.nightly
def test_buckling_of_other_actuators_is_that_of_shadow_solve(tmp_path: Path) -> None:
    """Other walls, which meet both elongations as far as they are stable; the lattice's modulus; a high pressure."""
    file = tmp_path / "actuator.toml"

    def critical(text: str) -> float:
        file.write_text(text)
        found = called("shadow", "solve", "--pressure", "-1", "--parameters", str(file))
        return float(found["critical_pressure_kpa"])

    for wall, modulus, neck in ((1.8, 1392.8, 4.786), (2.4, 1253.6, 4.094)):
        kpa = critical(f"wall_mm = {wall}\nwall_modulus_kpa = {modulus}\nneck_radius_mm = {neck}\n")
        says(SHADOW, f"{kpa:.0f} kPa for {wall} mm ({modulus} kPa")
        stable = [end for end in ENDS if kpa < float(end)]
        ends = [called("shadow", "solve", "--pressure", end, "--parameters", str(file)) for end in stable]
        assert [one["elongation_mm"] for one in ends] == pytest.approx([3.8, -2.7][: len(ends)], abs=0.001)
    assert called("shadow", "solve", "--pressure", "98")["lowest_eigenvalue"] > 0.0
    says(SHADOW, "Under pressure it is stable to +98 kPa, where the solution ends")
    soft, stiff = (critical(f"lattice_modulus_kpa = {18.34 + change}\n") for change in (-1.86, 1.86))
    says(SHADOW, f"shifts this by {(soft - stiff) / 2:.1f} kPa")


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_ranks_are_those_of_optics_sweep(tmp_path: Path) -> None:
    """The default reading without a turn, with 1,000 rays, and the rows of the number of rays up to 1,000."""
    first, finer = called("optics", "sweep"), called("optics", "sweep", "--rays", "1000")
    ranks, more = first["paper_optimum"]["ranks"], finer["paper_optimum"]["ranks"]
    row = cells(OPTICS, "none")
    assert row[0].startswith(f"{ranks['all']['rank']} of {ranks['all']['of']} ")
    assert row[1].startswith(f"{ranks['paper_map']['rank']} of {ranks['paper_map']['of']} ")
    assert row[2] == f"{more['all']['rank']}, {more['paper_map']['rank']}"
    says(OPTICS, f"a count is exact to {first['error']['of_95_percent']:.0f} rays (95 %)")
    assert len(first["winners"]) == first["fans"] == 7
    values = [finer["best"][key] for key in ("cavities", "width_mm", "depth_mm", "spacing_mm")]
    says(OPTICS, f"400 secondaries the best design is ({', '.join(map(str, values))})")
    assert cells(PAPER, "rank of the paper's pattern among the 36 of figure 3D")[2] == str(ranks["paper_map"]["rank"])
    scene = tmp_path / "scene.toml"
    scene.write_text("secondary = 100\n")
    for rays, name in ((250, "250"), (1000, "1,000")):
        found = called("optics", "sweep", "--rays", str(rays), "--scene", str(scene))
        best, row = found["best"], cells(OPTICS, name)
        keys = ("cavities", "width_mm", "depth_mm", "spacing_mm")
        assert [float(value) for value in row[0].split(",")] == [best[key] for key in keys]
        assert row[1] == "{:.1f} ({:.1f} to {:.1f})".format(best["p"], *best["p_ci"])
        assert row[2] == f"{len(found['tied_with_best'])} of 648"
        assert row[3] == f"{found['paper_optimum']['p']:.2f}"
        assert row[4] == str(found["paper_optimum"]["rank"])


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_bending_and_light_are_those_of_shadow_chain() -> None:
    """Curvature of the guides, change of the light, R2 beside line and parabola."""
    found = called("shadow", "chain")
    curvature, signal = found["curvature_per_mm"], found["signal"]
    for page in (OPTICS, SHADOW):
        says(page, f"curvature {curvature[0]:.4f} to {curvature[-1]:.4f} per mm")
    says(TRACER, f"falls by {-signal['light_change_percent']:.0f} % over the range")
    says(OPTICS, f"by {-signal['light_change_percent']:.0f} %, so that the model follows")
    one = signal["sensors"][0]
    says(TRACER, f"R^2 is {one['r2']:.2f}; a straight line in elongation has {one['line_r2']:.2f}, a parabola ")
    says(TRACER, f"{one['parabola_r2']:.4f}. The remainder, {one['rms_percent_fso']:.0f} % FSO, is model error")
    rises = [each["signal_change_percent"] for each in signal["sensors"]]
    says(TRACER, "published signals rise by {:.1f} and {:.1f} %".format(*rises))


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_readings_within_u_are_those_of_simulated_sensors() -> None:
    """40 sensors of each kind: the column of the table of what is assumed."""
    text = " ".join((ROOT / METHODS).read_text(encoding="utf-8").split())
    for row in table_of_u(40):
        assert row.holds, row
        if np.isfinite(row.within):
            name = row.kind if row.kind in ("cubic", "quintic", "dead zone", "drift", "creep") else row.kind.split()[0]
            said = "U by the others |" if name == "lost" else name
            assert f"{said} {100.0 * row.within:.1f}".removesuffix(".0") in text, row


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_readings_are_those_of_reproduce_optics() -> None:
    """Ranks of every single change of the default reading, and how far it changes the order."""
    found = called("reproduce", "optics")
    axes = {"face": "outer", "thickness_mm": 2.0, "states": "-40 to +50 kPa", "emission": "uniform", "order": "time"}
    names = {"lambertian": "emission: Lambertian", "-50 to +50 kPa": "curves: -50 to +50 kPa",
             "formula": "curves: formula", "1.5": "thickness: 1.5 mm", "bounce": "order: bounces",
             "index": "order: ray number", "inner": "face: inner", "both": "face: both",
             "midline": "face: midline"}  # fmt: skip
    for one in found["readings"]:
        changed = [str(one[axis]) for axis, value in axes.items() if one[axis] != value]
        row = cells(OPTICS, names[changed[0]] if changed else "none")
        ranks, mapped = one["ranks"]["all"], one["ranks"]["paper_map"]
        if one["rays"] == 250:
            for cell, rank in zip(row[:2], (ranks, mapped), strict=True):
                assert cell == f"{rank['rank']} of {rank['of']} ({rank['low']} to {rank['high']})"
        else:
            assert row[2] == f"{ranks['rank']}, {mapped['rank']}"
    assert len(found["influences"]) == 9
    for one in found["influences"]:
        assert cells(OPTICS, names[one["value"]])[3] == f"{one['correlation']:.2f}"


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_the_table_of_the_paper_is_that_of_reproduce(tmp_path: Path) -> None:
    """Every row by its name: what is computed is equal, sensors within both intervals, times within their order."""
    rows = {row["quantity"]: row for row in called("reproduce", "--out", str(tmp_path))["rows"]}
    table = (ROOT / PAPER).read_text(encoding="utf-8").split("| quantity |")[1].split("\n\n")[0].splitlines()[2:]
    assert len(table) > 30
    for line in table:
        name, _, published, ours, interval = (cell.strip() for cell in line.strip("|").split("|"))
        row = rows[name]
        assert float(published) == pytest.approx(row["paper"], rel=1e-5), name
        if interval:
            assert abs(float(ours) - row["ours"]) < 2.0 * (row["high"] - row["low"]), name
        elif name in ("time of the sweep", "shadow: frames"):
            assert 0.1 < float(ours) / row["ours"] < 10.0, name
        elif name.endswith("R²"):
            assert float(ours) == pytest.approx(row["ours"], abs=1e-4), name
        elif name.startswith("elongation"):  # of readings on a grid of 0.02 mm
            assert float(ours) == pytest.approx(row["ours"], abs=0.02), name
        else:
            assert ours == f"{row['ours']:.6g}", name
