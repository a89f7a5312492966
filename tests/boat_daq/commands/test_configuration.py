"""`boat-daq config` and `unit`: values by key, with their descriptions, and what changed when."""

from __future__ import annotations

from pathlib import Path

import pytest

from boat_daq.engine.settings import Settings, UnitLibrary, load_settings, read_unit, save_settings, stored_settings
from protocol.base.errors import RequestError
from tests.boat_daq.commands.calls import call, program


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """A folder of its own for settings and units."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))


def test_settings_are_set_and_shown():
    """Each with its range, unit, default and meaning; the changes are kept in order."""
    shown = call("config", "get", "--json")["settings"]
    assert shown["baud"] == {
        "value": 115_200,
        "default": 115_200,
        "unit": "Bd",
        "range": "300 to 12000000 Bd",
        "meaning": "Serial ports only; 8N1",
        "applies": "at the next connection",
    }
    assert call("config", "set", "rate_hz=1000", "resolution_mm=0,25", "allow_remote=on", "--json")["settings"][
        "resolution_mm"
    ]["value"] == pytest.approx(0.25)
    assert (load_settings().rate_hz, load_settings().allow_remote) == (1000, True)
    call("config", "set", "rate_hz=100", "--json")
    changes = stored_settings()[1]
    assert (changes[-1].key, changes[-1].before, changes[-1].after) == ("rate_hz", "1000", "100")
    assert len(changes) == 4


@pytest.mark.parametrize(
    ("words", "cause", "remedy"),
    [
        (("config", "set", "rate_hz=0"), "must be 1 to 65535 Hz, not 0", ""),
        (("config", "set", "rate_hz=1.5"), "a whole number", ""),
        (("config", "set", "allow_remote=perhaps"), "must be on or off", ""),
        (("config", "set", "colour=3"), "'colour' is not a known key", "choose one of rate_hz, baud"),
        (("config", "get", "colour"), "'colour' is not a known key", "choose one of rate_hz, baud"),
        (("unit", "new", "../SA1"), "'name'", ""),
        (("unit", "set", "SA9", "min_kpa=-25"), "no unit 'SA9' is stored", "boat-daq unit new SA9"),
        (("unit", "new", "SA7", "min_kpa=5"), "'min_kpa'", ""),
        (("unit", "new", "SA7", "polarity=0"), "'polarity' must be -1", ""),
    ],
)
def test_a_bad_value_is_refused_by_key(words, cause, remedy):
    """A wrong call: nothing is stored then."""
    ended = program(*words)
    assert ended.code == 2
    assert cause in ended.err and remedy in ended.err
    assert UnitLibrary().names() == []


def test_a_unit_is_added_changed_and_carried_to_another_computer(tmp_path: Path, monkeypatch):
    """With its changes; a unit that is there already, and a file without its calibrations, are refused."""
    call("unit", "new", "SA7", "min_kpa=-25", "note=thin wall", "--json")
    assert program("unit", "new", "SA7").code == 1
    UnitLibrary().add_calibration("SA7", {"b0": 1.5, "simulated": False})
    call("unit", "set", "SA7", "max_kpa=10", "--json")
    shown = call("unit", "set", "SA7", "max_kpa=20", "--json")
    assert (shown["min_kpa"], shown["max_kpa"], shown["calibrations"]) == (-25.0, 20.0, 1)
    assert [change["key"] for change in shown["changes"]] == ["min_kpa", "note", *["max_kpa"] * 2]
    file = tmp_path / "SA7.toml"
    file.write_text(UnitLibrary().text("SA7"))
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path / "other"))
    UnitLibrary().save(read_unit(file))
    assert call("unit", "show", "SA7", "--json") == shown
    assert [row["name"] for row in call("unit", "list", "--json")["units"]] == ["SA7"]
    UnitLibrary().add_calibration("SA7", {"b0": 1.6, "simulated": False})
    with pytest.raises(RequestError, match="a stored calibration is missing"):
        UnitLibrary().save(read_unit(file))


def test_refused_files_are_named(tmp_path: Path):
    """Settings by key; a unit does not hide the others."""
    (tmp_path / "settings.toml").write_text("colour = 3\n")
    assert "'colour'" in program("config", "get").err
    assert program("config", "set", "rate_hz=10").code == 1
    save_settings(Settings())
    assert (tmp_path / "settings.toml.refused").read_text() == "colour = 3\n"
    (tmp_path / "units").mkdir()
    (tmp_path / "units" / "SA1.toml").write_text("name = 3")
    listed = program("unit", "list")
    assert "unit SA1 cannot be used" in listed.err and listed.code == 0
