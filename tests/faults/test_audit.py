"""`make audit` never takes a missing answer for "nothing found"."""

from __future__ import annotations

import json

import pytest

from tests.faults import audit

GOOD = {"name": "numpy", "version": "2.0", "vulns": []}
WEAK = {"name": "old", "version": "1.0", "vulns": [{"id": "PYSEC-1", "fix_versions": ["1.1"]}]}
SKIPPED = {"name": "odd", "skip_reason": "not found"}
OURS = {"name": "boat-daq", "skip_reason": "distribution marked as editable"}  # as pip-audit 2.10 writes it


@pytest.mark.parametrize(
    ("packages", "code", "text"),
    [
        ([GOOD], 0, "1 packages looked up, 0 known"),
        ([GOOD, WEAK], 1, "WEAK old 1.0: PYSEC-1, fixed in 1.1"),
        ([GOOD, OURS], 0, "1 packages looked up, 0 known"),
        ([GOOD, SKIPPED], 3, "NOT AUDITED: 1 packages"),
        (None, 3, "NOT AUDITED: the advisory service gave no answer"),
    ],
)
def test_audit_distinguishes_four_verdicts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], packages: object, code: int, text: str
) -> None:
    """No vulnerability, some, unknown packages and no answer are four different verdicts."""
    output = "" if packages is None else json.dumps({"dependencies": packages})

    class Done:
        stdout, stderr = output, "connection refused"

    monkeypatch.setattr(audit.subprocess, "run", lambda *_, **__: Done())
    assert audit.main() == code
    assert text in capsys.readouterr().out
