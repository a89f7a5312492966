"""Settings and the unit library: nothing half written, no error ignored, no calibration lost."""

from __future__ import annotations

import dataclasses
import json
import os
import tomllib
from pathlib import Path

import platformdirs
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import (
    HOME_VARIABLE,
    Settings,
    Unit,
    UnitLibrary,
    home,
    load_settings,
    recordings_folder,
    save_settings,
)
from boat_daq.engine.stored_file import take_warnings
from protocol.base.errors import RequestError, StorageError

CUBIC = {"coefficients": [1651.9842, 46.4413, -2.6934, -0.36251], "note": 'a "quoted" ü', "covariance": [[1e-300, 2.0]]}


def test_settings_round_trip(tmp_path: Path) -> None:
    """What is stored is what is loaded; before anything was stored, the defaults."""
    assert load_settings(tmp_path) == Settings()
    changed = Settings(rate_hz=1000, operator='Zoë "Z"', recordings="/data/übung", port="COM3")
    save_settings(changed, tmp_path)
    assert load_settings(tmp_path) == changed


def test_the_one_before_is_kept(tmp_path: Path) -> None:
    """Every save leaves its predecessor as a backup, and nothing else behind."""
    save_settings(Settings(rate_hz=1), tmp_path)
    save_settings(Settings(rate_hz=2), tmp_path)
    assert "rate_hz = 1\n" in (tmp_path / "settings.toml.bak").read_text()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["settings.toml", "settings.toml.bak"]


def test_a_save_that_fails_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk fails while writing: an error with cause, the old settings untouched, no litter."""
    save_settings(Settings(rate_hz=7), tmp_path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="No space left"):
        save_settings(Settings(rate_hz=8), tmp_path)
    assert load_settings(tmp_path).rate_hz == 7
    assert [p.name for p in tmp_path.iterdir()] == ["settings.toml"]


@pytest.mark.fault(53, how="settings with an unknown key, a wrong type, an impossible value, a newer version", times=10)
@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("colour = 3", "'colour' is not a known key"),
        ('rate_hz = "fast"', "'rate_hz' must be of type int"),
        ("rate_hz = 0", "'rate_hz' must be 1"),
        ("zero_tolerance_kpa = nan", "finite"),
        ("zero_tolerance_kpa = -1", "'zero_tolerance_kpa'"),
        ("version = 2", "'version' is 2"),
        ("allow_remote = 1", "'allow_remote' must be of type bool"),
        ("rate_hz = ", "not a readable TOML"),
        ("changes = 3", "'changes' must be a list of tables"),
        ("changes = [{ utc = 1, key = 'baud', before = '', after = '' }]", "'utc' must be of type str"),
    ],
)
def test_a_hand_edited_file_is_refused_by_key(tmp_path: Path, line: str, part: str) -> None:
    """Unknown key, wrong type, impossible value, newer version: named, never guessed."""
    (tmp_path / "settings.toml").write_text(line)
    with pytest.raises(RequestError) as refusal:
        load_settings(tmp_path)
    assert part in refusal.value.cause


@pytest.mark.fault(53, how="a unit's limits swapped", times=3)
@pytest.mark.parametrize(("low", "high"), [(50.0, -40.0), (5.0, 50.0), (0.0, 0.0)])
def test_swapped_limits_of_a_unit_are_refused(tmp_path: Path, low: float, high: float) -> None:
    """A limit is never put right by itself."""
    library = UnitLibrary(tmp_path)
    library.save(Unit("SA1"))
    path = tmp_path / "SA1.toml"
    text = (
        path.read_text().replace("min_kpa = -40.0", f"min_kpa = {low}").replace("max_kpa = 50.0", f"max_kpa = {high}")
    )
    path.write_text(text)
    with pytest.raises(RequestError, match="min_kpa"):
        library.load("SA1")


@pytest.mark.fault(53, how="a unit's limit deleted", times=1)
def test_a_limit_has_no_default_in_a_file(tmp_path: Path) -> None:
    """A stored unit whose limit was deleted is refused, not given another."""
    library = UnitLibrary(tmp_path)
    library.save(Unit("SA1"))
    path = tmp_path / "SA1.toml"
    path.write_text(path.read_text().replace("max_kpa = 50.0\n", ""))
    with pytest.raises(RequestError, match="'max_kpa' is missing"):
        library.load("SA1")


def test_calibrations_are_added_and_the_last_accepted_one_is_in_force(tmp_path: Path) -> None:
    """Three entries: content bit for bit, in order; a withdrawn one leaves none in force."""
    library = UnitLibrary(tmp_path)
    assert library.load("SA1").calibration is None
    library.add_calibration("SA1", CUBIC, recording="a.boat", operator="me")
    unit = library.add_calibration("SA1", {"b0": 1.5}, note="second")
    assert library.load("SA1") == unit
    assert unit.calibration is not None and unit.calibration.content == {"b0": 1.5}
    assert unit.history[0].content == CUBIC
    assert library.add_calibration("SA1", {"b0": 1.5}, accepted=False).calibration is None
    assert len(library.load("SA1").history) == 3
    assert library.names() == ["SA1"]


def test_list_of_changes_is_bounded(tmp_path: Path) -> None:
    """It would outgrow the largest file that is read, and a unit with long notes would be lost."""
    library = UnitLibrary(tmp_path)
    for number in range(12):
        library.save(Unit("SA1", note=f"{number} " + "x" * 9_990))
    kept = library.load("SA1").changes
    assert len((tmp_path / "SA1.toml").read_text()) < 120_000
    assert len(kept) == 4 and kept[-1].after.startswith("11 ")
    with pytest.raises(RequestError, match="at most 20000 letters"):
        Unit("SA1", note="x" * 20_001)


def test_recordings_are_in_a_named_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Not in the folder that the program happens to be started in: each start used to have its own list of runs."""
    monkeypatch.delenv(HOME_VARIABLE, raising=False)
    monkeypatch.setattr(platformdirs, "user_documents_path", lambda: tmp_path / "Documents")
    monkeypatch.chdir(tmp_path)
    assert recordings_folder(Settings()) == tmp_path / "Documents" / "boat-daq"
    monkeypatch.setenv(HOME_VARIABLE, str(tmp_path / "home"))
    assert recordings_folder(Settings()) == tmp_path / "home" / "recordings"
    assert recordings_folder(Settings(recordings=str(tmp_path / "mine"))) == tmp_path / "mine"


def test_simulated_calibration_is_not_one_of_the_real_unit(tmp_path: Path) -> None:
    """One made on the virtual SA1 used to be in force on a real board with a unit of that name."""
    real = UnitLibrary(tmp_path)
    simulated = real.of(simulated=True)
    simulated.add_calibration("SA1", CUBIC | {"simulated": True})
    assert (real.load("SA1").history, real.names()) == ((), [])
    real.add_calibration("SA1", {"b0": 1.5, "simulated": False})
    assert real.load("SA1").calibration.content["b0"] == 1.5
    assert [entry.content for entry in simulated.load("SA1").history] == [CUBIC | {"simulated": True}]
    assert simulated.folder == tmp_path / "simulated"
    for library, mark in ((real, True), (simulated, False)):
        with pytest.raises(RequestError, match="is not one of"):
            library.add_calibration("SA1", {"simulated": mark})


def test_old_library_is_divided_by_the_mark_of_its_entries(tmp_path: Path) -> None:
    """A withdrawal has no mark: it is of the kind of the entry before it; no entry is lost when one is added."""
    contents = ({"b0": 1, "simulated": True}, {}, {"b0": 2}, {"b0": 3, "simulated": True}, {"b0": 4})
    entries = [{"utc": "2026", "accepted": bool(c), "content": json.dumps(c)} for c in contents]
    limits = {"name": "SA1", "min_kpa": -40.0, "max_kpa": 20.0, "polarity": -1, "note": "", "version": 1}
    path, library = tmp_path / "SA1.toml", UnitLibrary(tmp_path)
    path.write_text(tomli_w.dumps(limits | {"history": entries}))

    simulated = library.of(simulated=True)
    assert [e.content.get("b0") for e in library.load("SA1").history] == [2, 4]
    assert [e.content.get("b0") for e in simulated.load("SA1").history] == [1, None, 3]
    assert simulated.load("SA1").max_kpa == 20.0
    library.add_calibration("SA1", {"b0": 5})
    simulated.add_calibration("SA1", {"b0": 6, "simulated": True})
    simulated.add_calibration("SA1", {}, accepted=False)
    assert [e.content.get("b0") for e in library.load("SA1").history] == [2, 4, 5]
    assert [e.content.get("b0") for e in simulated.load("SA1").history] == [1, None, 3, 6, None]
    assert simulated.load("SA1").calibration is None
    assert len(tomllib.loads(path.read_text())["history"]) == 6


def test_history_is_never_shortened(tmp_path: Path) -> None:
    """Saving a unit without its stored calibrations is refused."""
    library = UnitLibrary(tmp_path)
    unit = library.add_calibration("SA1", CUBIC)
    with pytest.raises(RequestError, match="missing"):
        library.save(dataclasses.replace(unit, history=()))
    library.save(dataclasses.replace(unit, note="renamed", min_kpa=-30.0))
    assert library.load("SA1").calibration == unit.calibration


@pytest.mark.fault(51, how="names of units that are paths, reserved, or none", times=9)
@pytest.mark.parametrize("name", ["", "../SA1", "a/b", "CON", "nul", ".hidden", "x" * 41, "a\nb", "SA1."])
def test_a_name_cannot_leave_its_folder(tmp_path: Path, name: str) -> None:
    """Names that are paths, reserved, or none are refused before any file is touched."""
    with pytest.raises(RequestError, match="'name'"):
        UnitLibrary(tmp_path).load(name)


@given(st.binary(max_size=200))
def test_any_bytes_are_refused_or_read(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    """Whatever the file holds: settings, or an RequestError."""
    folder = tmp_path_factory.mktemp("s")
    (folder / "settings.toml").write_bytes(content)
    try:
        assert isinstance(load_settings(folder), Settings)
    except RequestError as refusal:
        assert refusal.cause


def test_home_can_be_put_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """BOAT_DAQ_HOME moves both folders; without it they are the system's."""
    monkeypatch.delenv("BOAT_DAQ_HOME", raising=False)
    assert "boat-daq" in str(home()) and "boat-daq" in str(home("data"))
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    assert home() == home("data") == tmp_path


@pytest.mark.parametrize("left", [None, b"", b"\0" * 200, b"\n \n", b"\xff\xfe\x00broken"])
def test_a_file_that_a_disk_destroyed_is_replaced_by_its_backup_with_a_warning(
    tmp_path: Path, left: bytes | None
) -> None:
    """Settings and limits are the backup's, no default; a session warns; the next save leaves a good backup."""
    library = UnitLibrary(tmp_path / "units")
    for limit in (20.0, 30.0):  # the backup is the one before: a unit stored twice
        library.save(Unit("SA1", min_kpa=-10.0, max_kpa=limit))
        save_settings(Settings(rate_hz=int(limit)), tmp_path)
    for path in (tmp_path / "settings.toml", tmp_path / "units" / "SA1.toml"):
        path.unlink() if left is None else path.write_bytes(left)
    take_warnings()
    assert load_settings(tmp_path).rate_hz == 20
    assert library.load("SA1").max_kpa == 20.0
    assert library.names() == ["SA1"]
    session = Session(load_settings(tmp_path), library)
    causes = [message.cause for message in session.snapshot().messages if message.level == "warning"]
    session.close()
    assert [text.endswith("its backup is used") for text in causes] == [True, True]
    save_settings(Settings(rate_hz=44), tmp_path)
    assert load_settings(tmp_path).rate_hz == 44
    assert "rate_hz = 20\n" in (tmp_path / "settings.toml.bak").read_text()
    take_warnings()


def test_an_edit_that_broke_a_unit_is_refused_and_its_backup_not_used(tmp_path: Path) -> None:
    """An edit that tightened a limit and lacks a quote must not run with the older, wider one."""
    library = UnitLibrary(tmp_path)
    for limit in (50.0, 40.0):
        library.save(Unit("SA1", max_kpa=limit))
    path = tmp_path / "SA1.toml"
    path.write_text(path.read_text().replace("max_kpa = 40.0", "max_kpa = 20.0 kPa"))
    with pytest.raises(RequestError, match="not a readable TOML file"):
        library.load("SA1")
    assert take_warnings() == []


def test_a_refused_file_names_its_backup_where_that_is_good(tmp_path: Path) -> None:
    """The one before is a way out, when there is one that would be taken."""
    save_settings(Settings(operator="Ada"), tmp_path)
    path = tmp_path / "settings.toml"
    path.write_text("colour = 1\n", encoding="utf-8")
    with pytest.raises(RequestError) as alone:
        load_settings(tmp_path)
    assert ".bak" not in alone.value.remedy
    path.unlink()
    for operator in ("Ada", "Bea"):
        save_settings(Settings(operator=operator), tmp_path)
    path.write_text("colour = 1\n", encoding="utf-8")
    with pytest.raises(RequestError, match="colour") as found:
        load_settings(tmp_path)
    assert "settings.toml.bak" in found.value.remedy
    library = UnitLibrary(tmp_path)
    for limit in (20.0, 30.0):
        library.save(Unit("SA1", max_kpa=limit))
    (tmp_path / "SA1.toml").write_text("name = 3\n", encoding="utf-8")
    with pytest.raises(RequestError) as unit:
        library.load("SA1")
    assert "SA1.toml.bak" in unit.value.remedy
    (tmp_path / "SA1.toml.bak").write_text("name = 3\n", encoding="utf-8")
    with pytest.raises(RequestError) as neither:
        library.load("SA1")
    assert ".bak" not in neither.value.remedy


def test_both_destroyed_is_refused(tmp_path: Path) -> None:
    """Then nothing is known of the limits, and none is made up."""
    library = UnitLibrary(tmp_path)
    for limit in (50.0, 40.0):
        library.save(Unit("SA1", max_kpa=limit))
    for path in (tmp_path / "SA1.toml", tmp_path / "SA1.toml.bak"):
        path.write_bytes(b"\0" * 50)
    with pytest.raises(RequestError, match="its backup are destroyed"):
        library.load("SA1")


def test_type_b_tables_of_a_unit_survive_a_calibration(tmp_path: Path) -> None:
    """Contributions in a unit's file are kept when a calibration is added; a text in their place is refused."""
    library = UnitLibrary(tmp_path)
    library.save(Unit("SA1"))
    path = tmp_path / "SA1.toml"
    path.write_text(path.read_text() + "\n[type_b.scale]\nu_percent = 0.1\ncertificate = 'DKD 4711'\n")
    stated = {"scale": {"u_percent": 0.1, "certificate": "DKD 4711"}}
    assert library.load("SA1").type_b == stated
    assert library.add_calibration("SA1", {"b0": 1.5}).type_b == stated
    assert library.load("SA1").type_b == stated
    path.write_text("type_b = 'none'\n" + path.read_text().partition("[type_b")[0].replace("[type_b]\n", ""))
    with pytest.raises(RequestError, match="'type_b' must hold tables"):
        library.load("SA1")
