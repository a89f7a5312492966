"""`boat-daq certificate` and `metadata`: the example recording, and what is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from boat_daq.cli import app
from boat_daq.engine.settings import HOME_VARIABLE

EXAMPLE = Path(__file__).parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the example, and settings of its own."""
    monkeypatch.setenv(HOME_VARIABLE, str(tmp_path / "home"))
    return Path(shutil.copy(EXAMPLE, tmp_path / "run.boat"))


def call(*words: str | Path) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.output


def test_metadata_are_stated_once_and_kept_for_the_unit(run: Path) -> None:
    """A value is stored, and remembered for the simulated unit."""
    code, _ = call("metadata", run, "--set", "customer=A & B", "--set", "rig=2")
    assert code == 0
    code, output = call("metadata", run, "--json")
    assert json.loads(output)["customer"] == "A & B"
    assert json.loads(output)["fields"] == {"rig": "2"}
    home = run.parent / "home"
    assert 'customer = "A & B"' in (home / "units" / "simulated" / "SA1.toml").read_text(encoding="utf-8")
    assert call("metadata", run, "--set", "customer")[0] == 2


@pytest.mark.nightly
def test_certificate_of_the_example_has_the_laboratory_and_its_mark(run: Path) -> None:
    """Laboratory from its file, item as given, XML and JSON of one number; unusable files are refused."""
    laboratory = run.parent / "lab.toml"
    laboratory.write_text('name = "Lab"\ncountry_code = "DE"\n', encoding="utf-8")
    target = run.parent / "c.xml"
    code, output = call("certificate", run, "--out", target, "--laboratory", laboratory, "--item", "Rod", "--json")
    assert code == 0
    made = json.loads(output)
    assert (made["laboratory"]["name"], made["items"][0]["item"]) == ("Lab", "Rod")
    assert made["marks"] == ["SIMULATED", "NO CERTIFICATE"]
    assert f">{made['number']}<" in target.read_text(encoding="utf-8")
    laboratory.write_text('nam = "Lab"\n', encoding="utf-8")
    code, output = call("certificate", run, "--out", target, "--laboratory", laboratory)
    assert code == 1
    assert call("certificate", run, "--out", run.parent / "c.doc")[0] == 2
