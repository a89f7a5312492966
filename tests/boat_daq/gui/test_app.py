"""The window starts without the libraries that only its helper processes need."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("scipy", "numba", "emcee", "pandas", "pyarrow", "matplotlib", "dask")


@pytest.mark.parametrize("library", HEAVY)
def test_window_does_not_import_library_of_its_jobs(library, imported):
    """Jobs are passed by reference, and import their libraries when they run."""
    assert library not in imported


@pytest.fixture(scope="module")
def imported():
    """The packages that the window has imported."""
    script = "import sys, boat_daq.gui.app; print(*{name.partition('.')[0] for name in sys.modules})"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert "PySide6" in found
    return found
