"""Hostile settings, units, plans, profiles and window state: refused in bounded memory."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.shadow.fem.parameters import read_parameters
from boat_daq.engine.plan import load_plan
from boat_daq.engine.settings import UnitLibrary, load_settings
from boat_daq.engine.toml_values import read_json
from boat_daq.viewmodels.common.preferences import Preferences
from protocol.base.errors import RequestError
from protocol.base.toml_file import KEY_PARTS_MAX, read_toml
from protocol.text.profile import load_profile
from tests.faults.decoders import REFUSALS
from tests.faults.drill import ROOT

WHOLE = "1" + "0" * 400  # no float
HOSTILE = {
    "a number of 5,000 digits": f"rate_hz = {'9' * 5000}",
    "a number beyond a float": f"resolution_mm = {WHOLE}",
    "a hexadecimal number without end": f"rate_hz = 0x{'f' * 8000}",
    "no number": "resolution_mm = nan",
    "an infinite number": "zero_tolerance_kpa = inf",
    "nested arrays": f"rate_hz = {'[' * 5000}",
    "nested tables": f"rate_hz = {'{a=' * 3000}1{'}' * 3000}",
    "a key of parts": f"{'.'.join(['a'] * 4000)} = 1",
    "a quoted key of parts": f"""{'."a b" . '.join(["'a'"] * 1000)} = 1""",
    "a heading of parts": f"[{'.'.join(['a'] * 4000)}]",
    "text for a number": 'rate_hz = "100"',
    "true for a number": "rate_hz = true",
    "a key of one long part": f"{'a' * 9000} = 1",
    "a date that is none": "rate_hz = 2026-99-99",
    "a NUL": "rate_hz = 1\0",
}


@pytest.mark.fault(53, how="settings, unit, plan, profile and actuator that are hostile TOML", times=75)
@pytest.mark.parametrize("name", sorted(HOSTILE))
def test_hostile_toml_is_refused_in_three_lines(tmp_path: Path, name: str) -> None:
    """Every reader of TOML refuses it with a cause of at most three lines."""
    path = tmp_path / "settings.toml"
    path.write_text(HOSTILE[name], encoding="utf-8")
    (tmp_path / "SA1.toml").write_text(HOSTILE[name], encoding="utf-8")
    readers = (
        lambda: load_settings(tmp_path), lambda: UnitLibrary(tmp_path).load("SA1"), lambda: load_plan(str(path)),
        lambda: load_profile(path), lambda: read_parameters(path),
    )  # fmt: skip
    for read in readers:
        with pytest.raises(REFUSALS) as refusal:
            read()
        assert 0 < len(refusal.value.cause) < 400


def test_actuator_parameter_must_be_finite(tmp_path: Path) -> None:
    """A parameter of the actuator must be a finite number."""
    for text in (f"wall_mm = {WHOLE}", f"cells = 0x{'f' * 8000}", "wall_mm = nan"):
        (tmp_path / "a.toml").write_text(text, encoding="utf-8")
        with pytest.raises(REFUSALS, match=r"wall_mm|64 bits"):
            read_parameters(tmp_path / "a.toml")


def test_keys_of_ordinary_length_pass() -> None:
    """Both sides of the bound on a key's parts, and dots outside keys."""
    few = ".".join(["a"] * KEY_PARTS_MAX)
    assert read_toml(f"{few} = 1")
    with pytest.raises(ValueError, match=f"more than {KEY_PARTS_MAX} parts .at line 2"):
        read_toml(f"x = 1\n{few}.a = 1")
    assert (
        read_toml('note = "1.5 mm. Then 2.5 mm ... and so on."\nrows = [' + "1.5, " * 1000 + "]")["rows"]
        == [1.5] * 1000
    )
    assert read_toml(f"a = {2**63 - 1}")["a"] == 2**63 - 1
    with pytest.raises(ValueError, match="64 bits"):
        read_toml(f"a = [{{b = {2**63}}}]")


BOUNDED = """
import resource, sys
from protocol.base.toml_file import read_toml
resource.setrlimit(resource.RLIMIT_AS, (150 << 20, 150 << 20))
for key in (".".join(["a"] * 40_000), '"a".' * 40_000 + "a"):
    for text in (f"{key} = 1", f"[{key}]", f"x = {{{key} = 1}}"):
        try:
            read_toml(text)
            print("TAKEN")
        except ValueError:
            pass
"""


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS is Linux's")
@pytest.mark.fault(52, how="TOML keys of 40,000 parts with 150 MB of memory", times=6)
def test_long_key_takes_bounded_memory() -> None:
    """The standard library's reader takes gigabytes for the same 80 kB."""
    done = subprocess.run([sys.executable, "-c", BOUNDED], capture_output=True, text=True, cwd=ROOT, timeout=100)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr[-1000:]


JSONS = {
    "nested": "[" * 100_000,
    "a number of 5,000 digits": "9" * 5000,
    "no UTF-8": '"\udcff"',
    "no table": "[1]",
    "too long": '{"a": "' + "x" * 1_100_000 + '"}',
}


@pytest.mark.fault(53, how="the window's stored state, as hostile JSON", times=5)
@pytest.mark.parametrize("name", sorted(JSONS))
def test_unreadable_window_state_gives_defaults(tmp_path: Path, name: str) -> None:
    """Defaults hold, and the next value stored makes a valid file."""
    (tmp_path / "window.json").write_text(JSONS[name], encoding="utf-8", errors="surrogateescape")
    remembered = Preferences(tmp_path)
    assert remembered.get("page", "Live") == "Live"
    remembered.set("page", "Runs")
    assert json.loads((tmp_path / "window.json").read_text(encoding="utf-8")) == {"page": "Runs"}


def test_json_beyond_its_bound_is_refused(tmp_path: Path) -> None:
    """Both sides of it."""
    path = tmp_path / "a.json"
    path.write_text('"' + "x" * 98 + '"', encoding="utf-8")
    assert read_json(path, 100) == "x" * 98
    with pytest.raises(RequestError, match="larger than") as refusal:
        read_json(path, 99)
    assert refusal.value.remedy
