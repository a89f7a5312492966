"""What every test may use."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest

import boat_daq  # noqa: F401  before numpy: it gives the BLAS one thread, as the program does

pytest_plugins = ("tests.outside_writes",)
ROOT = Path(__file__).resolve().parents[1]


def pytest_collection_finish() -> None:
    """Leave what is loaded by now out of later collections: full ones are cheap then, and come often enough."""
    gc.collect()
    gc.freeze()
    gc.collect()  # counts what is left: next to nothing


@pytest.fixture(scope="session", autouse=True)
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Settings, units and logs of no user of this machine, also for the programs that a test starts."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BOAT_DAQ_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Recordings and certified data that nobody on this project made; they are not part of the repository."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the shared data folder is not beside this checkout")
    return folder
