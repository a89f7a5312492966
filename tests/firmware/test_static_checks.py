"""Static checks of the firmware: MISRA C:2012 by cppcheck, and the paths that gcc follows through each function."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.firmware.emulated_chip import CORTEX_M3, MACHINE, START
from tests.firmware.firmware_build import FIRMWARE, HERE, PORTABLE

pytestmark = pytest.mark.nightly

PROGRAMS = {"emulated": [START, MACHINE], "psoc": [FIRMWARE / "psoc_main.c"]}
INCLUDED = [f"-I{FIRMWARE}", f"-I{HERE / 'c'}"]


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="cppcheck is not on this computer (Debian: cppcheck)")
@pytest.mark.parametrize("program", PROGRAMS)
def test_cppcheck_and_its_misra_addon_find_nothing(program: str) -> None:
    """Every finding is mended, justified on its line, or justified in protocol/firmware/deviations.txt."""
    done = subprocess.run(
        [
            *("cppcheck", "-q", "--std=c99", "--enable=all", "--inconclusive", "--platform=unix32", "--addon=misra"),
            *("--inline-suppr", f"--suppressions-list={FIRMWARE / 'deviations.txt'}"),
            *("--suppress=missingIncludeSystem", "--suppress=unusedFunction", "--suppress=unmatchedSuppression"),
            *("--template={file}:{line} [{id}] {message}", *INCLUDED, *map(str, [*PORTABLE, *PROGRAMS[program]])),
        ],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is not on this computer")
@pytest.mark.parametrize("source", [*PORTABLE, *(one for sources in PROGRAMS.values() for one in sources)], ids=str)
def test_gcc_analyzer_finds_nothing(source: Path, tmp_path: Path) -> None:
    """`-fanalyzer` with every warning an error, for the chip."""
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-fanalyzer", *CORTEX_M3]
    made = tmp_path / "object.o"
    subprocess.run(["arm-none-eabi-gcc", *flags, *INCLUDED, "-c", str(source), "-o", str(made)], check=True)
    assert made.stat().st_size > 0
