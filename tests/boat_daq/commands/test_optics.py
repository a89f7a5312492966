"""`boat-daq optics`: JSON keys, files and refusals."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.fidelity import Level
from boat_daq.cli import app
from boat_daq.commands import optics
from boat_daq.commands.optics import released_rays
from tests.boat_daq.commands.calls import call, exit_code, refusal, shown_progress

LEDGER = {"released", "detected", "escaped", "trapped", "cut", "corner", "dropped"}


def scene(folder: Path, text: str) -> tuple[str, str]:
    """Return the option of a scene file."""
    (path := folder / "scene.toml").write_text(text)
    return "--scene", str(path)


def test_trace_prints_the_documented_keys() -> None:
    """Design, state, rays, NDR, power, ledger and hits; the ledger closes."""
    out = call("optics", "trace", "--state", "0", "--secondary", "0")
    assert {
        "cavities",
        "width_mm",
        "depth_mm",
        "spacing_mm",
        "state",
        "rays",
        "ndr",
        "power",
        "ledger",
        "hits",
    } <= set(out)
    ledger = out["ledger"]
    assert isinstance(ledger, dict)
    assert set(ledger) == LEDGER
    assert ledger["released"] == 250 == sum(ledger[k] for k in LEDGER - {"released"})


def test_trace_turns_the_fan_and_drops_the_faintest(tmp_path: Path) -> None:
    """The phase is the paper's 0 for 250 rays and else a quarter; rays that are dropped early are not followed."""
    plain, turned = call("optics", "trace"), call("optics", "trace", *scene(tmp_path, "phase = 0.25"))
    assert (plain["phase"], turned["phase"]) == (0.0, 0.25)
    assert plain["power"] != turned["power"]
    assert call("optics", "trace", "--rays", "100")["phase"] == 0.25
    assert plain["jitter"] is None
    assert call("optics", "trace", "--tolerance", "20")["jitter"] == 1
    few = ("optics", "trace", "--rays", "10", "--secondary", "5000")
    every = [call(*few, *scene(tmp_path, f"faintest = {power}")) for power in ("1e-2", "1e-5")]
    followed = [each["secondaries"]["followed"] for each in every]  # type: ignore[index]
    assert followed[0] < followed[1]
    assert every[0]["power"] == pytest.approx(every[1]["power"], abs=0.05)


def test_a_single_ray_has_no_error_of_zero() -> None:
    """What was not measured is named, not left out."""
    shown = CliRunner().invoke(app, ["optics", "trace", "--rays", "1"]).stdout
    assert "errors unknown with a single ray" in shown
    assert "(k = " not in shown


def test_a_count_of_reflected_parts_is_not_given_as_rays_of_250() -> None:
    """With more secondaries than rays the text gives power, and why the count is no measure."""
    result = CliRunner().invoke(app, ["optics", "trace", "--rays", "10", "--secondary", "5000"])
    assert "of 250" not in result.stdout
    assert "detected rays, power 0." in result.stdout
    assert " ± 0." in result.stdout
    assert "compare the power" in result.stderr


def test_a_count_is_written_to_two_digits_of_its_spread() -> None:
    """However fine: 88.71 with 0.012 is no 88.7 with 0.0; few rays keep their decimal place."""
    runner = CliRunner()
    fine = runner.invoke(app, ["optics", "trace", "--tolerance", "0.02"]).stdout
    assert re.search(r"NDR \d+\.\d{4,5} ± 0\.00\d{2,3} of 250", fine), fine
    coarse = runner.invoke(app, ["optics", "trace", "--rays", "150"]).stdout
    assert re.search(r"NDR \d+\.\d ± \d+\.\d of 250", coarse), coarse


@pytest.mark.parametrize("option", [("--rays", 20_000), ("--tolerance", 0.2)])
def test_trace_shows_its_progress(option: tuple[str, float]) -> None:
    """Many rays take long; the last one is reported."""
    with shown_progress("optics") as shown:
        call("optics", "trace", *option)
    assert shown["rays"][-1] == 1.0


def test_trace_reads_a_curve_file(tmp_path: Path, curves: np.ndarray) -> None:
    """The parametric curves, written to a file and read again, give the same NDR; the default ones give another."""
    path = tmp_path / "curves.csv"
    path.write_text("x,z\n" + "\n".join(f"{x!r},{z!r}" for s in curves.tolist() for g in s for x, z in g))
    written = call("optics", "trace", "--state", "14", "--curves", str(path))["power"]
    assert written == call("optics", "trace", "--state", "14", "--curves", "parametric")["power"]
    assert written != call("optics", "trace", "--state", "14")["power"]


def test_trace_writes_an_image(tmp_path: Path) -> None:
    """An image of the rays is written as PNG and as SVG."""
    for name in ("rays.png", "rays.svg"):
        call("optics", "trace", "--out", str(tmp_path / name), "--rays", "40")
        assert (tmp_path / name).stat().st_size > 5000


def test_scene_writes_version_5(tmp_path: Path) -> None:
    """The scene goes to a file, or to standard output with --json."""
    call("optics", "scene", "--out", str(tmp_path / "scene.json"))
    assert json.loads((tmp_path / "scene.json").read_text())["version"] == 5
    every, none = (call("optics", "scene", "--secondary", budget) for budget in ("-1", "0"))
    assert every["version"] == 5
    assert ('partialReflect": true' in json.dumps(every), 'partialReflect": true' in json.dumps(none)) == (True, False)


def test_seconds_of_a_sweep_begin_before_its_imports(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is loaded and compiled for it is part of its time."""
    at: list[float] = []
    monkeypatch.setattr(optics, "load", lambda *names: at.append(time.perf_counter()))
    monkeypatch.setattr(optics, "_sweep", lambda request, begun, *rest, **options: at.append(begun))
    assert exit_code("optics", "sweep", "--cavities", "3") == 0
    loaded, begun = at
    assert begun < loaded


@pytest.mark.nightly
def test_sweep_prints_all_designs(tmp_path: Path) -> None:
    """216 designs in 15 states, with the best, the ties and the paper's optimum."""
    out = call("optics", "sweep", "--cavities", "5", "--rays", "50", "--out", str(tmp_path))
    assert out["simulations"] == 3240
    assert isinstance(out["designs"], list)
    assert len(out["designs"]) == 216
    assert {"best", "tied_with_best", "paper_optimum", "seconds", "hits"} <= set(out)
    assert call("optics", "sweep", "--cavities", "5", "--rays", "50", "--out", str(tmp_path))["simulated_now"] == 0


@pytest.mark.nightly
def test_sweep_of_both_faces_leaves_out_cavities_that_would_meet(tmp_path: Path) -> None:
    """Two opposite cavities 1 mm deep would cut the 2 mm guide: 36 of 216 designs."""
    out = call("optics", "sweep", "--cavities", "3", "--rays", "2", *scene(tmp_path, 'face = "both"'))
    assert isinstance(out["designs"], list)
    assert len(out["designs"]) == 180
    assert max(design["depth_mm"] for design in out["designs"]) == 0.9


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (("trace", "--state", "15"), "no state 15"),
        (("trace", "--depth", "2"), "cuts through"),
        (("trace", "--spacing", "0"), "overlap"),
        (("trace", "--spacing", "1e-15"), "below the wavelength"),
        (("trace", "--index", "0.5"), "index"),
        (("trace", "--rays", "0"), "rays"),
        (("trace", "--order", "colour"), "order"),
        (("trace", "--curves", "absent.csv"), "no curve file"),
        (("trace", "--rays", "10000001"), "rays"),
        (("trace", "--rays", "2", "--out", "absent/rays.png"), "cannot be written"),
        (("trace", "--rays", "2", "--out", "rays.xyz"), "the format of a picture"),
        (("scene", "--out", "absent/scene.json"), "cannot be written"),
        (("optimise", "--seconds", "nan"), "nan s"),
        (("optimise", "--out", "/dev/null"), "cannot be written"),
        (("optimise", "--rays", "0"), "rays"),
    ],
)
def test_failures_name_cause_and_remedy(words: tuple[str, ...], cause: str) -> None:
    """Each bad request is refused with a cause that names it."""
    assert cause in refusal("optics", *words).cause


@pytest.mark.parametrize(
    ("words", "text", "cause"),
    [
        (("trace", "--depth", "1"), 'face = "both"', "cuts through"),
        (("trace",), 'face = "top"', "face is 'top'"),
        (("scene",), 'face = "midline"', "voids"),
        (("optimise",), 'face = "midline"', "face 'midline'"),
        (("trace",), "thickness_mm = 40", "touch"),
        (("scene", "--rays", "20001"), 'emission = "lambertian"', "one by one"),
        (("sweep",), "thickness = 2", "has 'thickness'"),
        (("sweep",), 'rank_by = "hits"', "rank_by is 'hits'"),
        (("trace",), 'curves = "absent.csv"', "no curve file"),
    ],
)
def test_scene_files_are_refused_with_a_cause(tmp_path: Path, words: tuple[str, ...], text: str, cause: str) -> None:
    """A value or a key that cannot be is named."""
    assert cause in refusal("optics", *words, *scene(tmp_path, text)).cause


def test_options_precede_the_scene_file(tmp_path: Path) -> None:
    """`--index` and `--order` replace the values of the file; what a command does not use is named."""
    given = scene(tmp_path, 'index = 1.4\norder = "bounce"\nattenuation_db_per_cm = 1.0')
    assert {key: call("optics", "trace", *given)[key] for key in ("index", "order")} == {
        "index": 1.4,
        "order": "bounce",
    }
    assert call("optics", "trace", "--index", "1.6", *given)["index"] == 1.6
    assert "attenuation_db_per_cm" in CliRunner().invoke(app, ["optics", "scene", "--json", *given]).stderr


@pytest.mark.parametrize("words", [("--tolerance", "20"), ("--confidence", "0.95")])
def test_a_phase_is_refused_where_the_fan_is_turned(tmp_path: Path, words: tuple[str, str]) -> None:
    """Tolerance and race turn the fan themselves."""
    assert exit_code("optics", "sweep", *words, *scene(tmp_path, "phase = 0.1")) == 2


@pytest.mark.parametrize("cavities", ["many", "3,0", ""])
def test_malformed_list_of_cavities_is_a_usage_error(cavities: str) -> None:
    """Exit code 2 for text, a number below 1 and nothing."""
    assert exit_code("optics", "sweep", "--cavities", cavities) == 2


def test_a_time_limit_is_of_a_race() -> None:
    """`sweep --seconds` needs a confidence, and more than no time."""
    assert exit_code("optics", "sweep", "--seconds", "5") == 2
    assert "0 s" in refusal("optics", "sweep", "--confidence", "0.95", "--seconds", "0").cause


@pytest.mark.parametrize(
    ("given", "level", "released"),
    [
        ((None, None), None, (250, 100)),
        ((None, None), "reference", (1_000, 400)),
        ((600, None), "reference", (600, 240)),
        ((600, None), None, (600, 240)),
        ((600, 7), "draft", (600, 7)),
    ],
)
def test_options_precede_the_fidelity_and_the_fidelity_the_paper(
    given: tuple[int | None, int | None], level: Level | None, released: tuple[int, int]
) -> None:
    """Rays and secondary rays, with and without --fidelity; the documented defaults are 250, and 100 for each 250."""
    assert released_rays(*given, level, lambda chosen: chosen.rays) == released
