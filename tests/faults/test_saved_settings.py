"""Settings and units killed with -9 while they are saved."""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from boat_daq.engine.settings import Settings, UnitLibrary, load_settings
from tests.faults.drill import ROOT
from tests.faults.nightly_counts import few_and_many

SAVES = """
import dataclasses, sys
from pathlib import Path
from boat_daq.engine.settings import Settings, UnitLibrary, save_settings
folder = Path(sys.argv[1])
library = UnitLibrary(folder / "units")
print("go", flush=True)
for number in range(1, 10**9):
    save_settings(Settings(operator=f"{number} " + "x" * 5000), folder)
    library.add_calibration("SA1", {"number": number, "filler": "y" * 3000})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9")
@pytest.mark.parametrize("times", few_and_many(30, "settings and units killed with -9 while they are saved", 3, 100))
def test_settings_and_units_survive_a_kill(tmp_path: Path, times: int) -> None:
    """File and backup are always complete; no stored calibration is ever missing."""
    rng = random.Random(times)
    most = 0
    for number in range(times):
        folder = tmp_path / str(number)
        with subprocess.Popen([sys.executable, "-c", SAVES, str(folder)], stdout=subprocess.PIPE, cwd=ROOT) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"go\n"
            time.sleep(rng.uniform(0.02, 0.3))
            process.send_signal(signal.SIGKILL)
        for backup in folder.rglob("*.bak"):
            if not backup.with_suffix("").exists():
                pytest.fail("a backup without its file")
        saved = load_settings(folder)
        history = UnitLibrary(folder / "units").load("SA1").history
        assert [entry.content["number"] for entry in history] == list(range(1, len(history) + 1))
        assert saved == Settings() or int(saved.operator.split()[0]) in (len(history), len(history) + 1)
        if (folder / "settings.toml.bak").exists():
            shutil.copy(folder / "settings.toml.bak", folder / "settings.toml")
            assert load_settings(folder).operator.endswith("x")
        most = max(most, len(history))
    assert most > 0
