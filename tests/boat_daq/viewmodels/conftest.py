"""A recording from the virtual board, and what its analysis returns."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from boat_daq.viewmodels.results.run_result import analyse_run
from tests.boat_daq.viewmodels.helpers import SAMPLE


@pytest.fixture(scope="session")
def recording(tmp_path_factory):
    """Two cycles of SA1 on the virtual board, every plateau read, alone in its folder."""
    return Path(shutil.copy(SAMPLE, tmp_path_factory.mktemp("runs") / "SA1.boat"))


@pytest.fixture(scope="session")
def result(recording):
    """The analysis of that recording."""
    return analyse_run(str(recording))


@pytest.fixture
def closed(tmp_path):
    """A copy of the sample recording, closed."""
    return Path(shutil.copy(SAMPLE, tmp_path / "older.boat"))
