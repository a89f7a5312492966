"""Nothing is decided by the text of a message: with every sentence of the program scrambled it does the same."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.system.text_journeys import journeys

LEAST_SENTENCES = 1500  # of the modules that the journeys import


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
@pytest.mark.nightly
@pytest.mark.usefixtures("qapp")
def test_scrambled_sentences_change_no_decision(tmp_path: Path) -> None:
    """Runs under faults, a broken and a resumed run, an analysis and every page of the window end in the same codes."""
    command = [sys.executable, "-m", "tests.system.text_journeys", str(tmp_path / "scrambled")]
    env = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr[-3000:]
    scrambled, plain = json.loads(done.stdout), json.loads(journeys(tmp_path / "plain"))
    assert plain.pop("sentences") == 0
    assert scrambled.pop("sentences") >= LEAST_SENTENCES
    assert scrambled == plain
