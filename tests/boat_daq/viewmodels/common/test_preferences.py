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
