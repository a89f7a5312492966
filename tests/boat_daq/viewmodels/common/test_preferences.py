"""Values kept between starts."""

from __future__ import annotations

from boat_daq.viewmodels.common.preferences import Preferences


def test_preferences_last_and_a_broken_file_is_ignored(tmp_path):
    """What was set is there at the next start; a file that is no JSON begins anew; another kind is the default."""
    Preferences(tmp_path).set("window_s", 30.0)
    assert Preferences(tmp_path).get("window_s", 60.0) == 30.0
    assert Preferences(tmp_path).get("window_s", "text") == "text"
    (tmp_path / "window.json").write_text("{", encoding="utf-8")
    assert Preferences(tmp_path).get("window_s", 60.0) == 60.0


def test_value_set_later_is_written_with_the_next(tmp_path):
    """A border that is dragged costs the disk nothing until something is set, the same value as before included."""
    preferences = Preferences(tmp_path)
    preferences.set("geometry", "abc")
    preferences.set_later("shares", [0.4, 0.6])
    assert preferences.get("shares", []) == [0.4, 0.6]
    assert Preferences(tmp_path).get("shares", []) == []
    preferences.set("geometry", "abc")
    assert Preferences(tmp_path).get("shares", []) == [0.4, 0.6]
