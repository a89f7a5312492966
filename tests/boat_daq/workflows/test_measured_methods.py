"""Methods measured in a helper process."""

from __future__ import annotations

import json

from analysis.studies.tradeoff.measure import Method, Setting
from boat_daq.viewmodels.models.tradeoff import read_report
from boat_daq.workflows import measured_methods


def test_measured_methods_are_read_by_the_page(monkeypatch):
    """Two methods measured in the helper come back in one result, progress rising to all of them."""
    settings = [Setting("good", lambda _: 0.0, float), Setting("bad", lambda _: 1.0, float)]
    fake = Method(
        "fake", "Fake", "truth", True, "reader", 0.1, "mm", "a call",
        lambda level: "bad" if level.level == "draft" else "good", lambda quick: settings,
    )  # fmt: skip
    monkeypatch.setattr(measured_methods, "tradeoff_methods", lambda: {"fake": fake, "other": fake})
    seen = []
    content = measured_methods.measure_methods(progress=lambda done, total: seen.append(done))
    assert seen == sorted(seen)
    assert seen[-1] == 2
    (fake, _) = content["methods"]
    assert {p["setting"]: p["error"] for p in fake["points"]} == {"good": 0.0, "bad": 1.0}
    assert (fake["default"], fake["chosen"]) == ("good", "good")
    assert read_report(json.loads(json.dumps(content)))
