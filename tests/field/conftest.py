"""Runs as other programs write them, of one known truth, and the folder of cases where it is there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.field.truth import Run, staircase


@pytest.fixture(scope="session")
def cases(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the made cases, which are not part of the repository."""
    maker = shared_data / "field_cases" / "make_cases.py"
    if not maker.is_file():
        pytest.skip("the folder of field cases is not beside this checkout")
    folder = tmp_path_factory.mktemp("cases")
    subprocess.run([sys.executable, str(maker), str(folder)], check=True)
    return folder


@pytest.fixture(scope="session")
def run() -> Run:
    """Return four cycles of a staircase, 50 Hz."""
    return staircase()
