"""Optional libraries: absent, each is named with the extra that brings it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.cluster import connect
from boat_daq.cli import app
from protocol.base import optional as optional_module
from protocol.base.errors import RequestError
from protocol.base.optional import EXTRAS, install_command, optional
from tests.conftest import ROOT

EXAMPLE = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"


def test_parquet_without_its_library_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The export is refused, and leaves no file."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    target = tmp_path / "run.parquet"
    ran = CliRunner().invoke(app, ["export", str(EXAMPLE), "--format", "parquet", "--out", str(target)])
    assert isinstance(ran.exception, RequestError)
    assert ran.exception.cause == "pyarrow is not installed"
    assert '"pyarrow>=15"' in ran.exception.command
    assert list(tmp_path.iterdir()) == []


def test_cluster_without_its_library_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before any address is tried."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RequestError, match="Dask is not installed") as refused:
        connect("tcp://127.0.0.1:1")
    assert '"distributed>=' in refused.value.command


def test_command_installs_where_the_program_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """By this interpreter's pip; by pipx into its own environment; by uv where there is no pip."""
    monkeypatch.setattr(sys, "executable", "/opt/env 1/bin/python")
    assert install_command('"h5py>=3.10"') == '"/opt/env 1/bin/python" -m pip install "h5py>=3.10"'
    prefix = tmp_path / "pipx" / "venvs" / "boat-daq"
    prefix.mkdir(parents=True)
    (prefix / "pipx_metadata.json").write_text("{}", encoding="utf-8")
    with monkeypatch.context() as pipx:
        pipx.setattr(sys, "prefix", str(prefix))
        assert install_command('"h5py>=3.10"') == 'pipx inject boat-daq "h5py>=3.10"'
        assert install_command("--no-binary", "cobs", "cobs") == "pipx runpip boat-daq install --no-binary cobs cobs"
    monkeypatch.setattr(optional_module, "find_spec", lambda _: None)
    assert install_command("cobs") == 'uv pip install --python "/opt/env 1/bin/python" cobs'


def test_bundle_names_no_pip(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program without Python has no pip to install with."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    with pytest.raises(RequestError) as refused:
        optional("pyarrow")
    assert "standalone program" in refused.value.remedy


@pytest.mark.parametrize("module", EXTRAS)
def test_damaged_library_is_no_absent_one(module: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A library that is there and fails while it is loaded keeps its own error."""
    (tmp_path / f"{module}.py").write_text("raise ImportError('a symbol is missing')")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(ImportError, match="a symbol is missing"):
        optional(module)
