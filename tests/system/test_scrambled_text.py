"""Nothing is decided by the text of a message: with every sentence of the program scrambled it does the same."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

LEAST_SENTENCES = 1500  # of the modules that the journeys import


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_scrambled_sentences_change_no_decision(tmp_path: Path) -> None:
    """Runs under faults, a broken and a resumed run, an analysis and every page of the window end in the same codes."""
    env = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    commands = {
        mode: [sys.executable, "-m", "tests.system.text_journeys", str(tmp_path / mode), mode]
        for mode in ("plain", "scrambled")
    }
    running = {
        mode: subprocess.Popen(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for mode, command in commands.items()
    }
    found = {}
    for mode, process in running.items():
        out, err = process.communicate(timeout=200)
        assert process.returncode == 0, err[-3000:]
        found[mode] = json.loads(out)
    assert found["plain"].pop("sentences") == 0
    assert found["scrambled"].pop("sentences") >= LEAST_SENTENCES
    assert found["plain"] == found["scrambled"]
