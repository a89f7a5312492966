"""Optional libraries: absent, each is named with the extra that brings it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.cluster import connect
from analysis.optional import EXTRAS, optional
from boat_daq.cli import app
from protocol.base.errors import RequestError
from tests.conftest import ROOT

EXAMPLE = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"


def test_parquet_without_its_library_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The export is refused, and leaves no file."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    target = tmp_path / "run.parquet"
    ran = CliRunner().invoke(app, ["export", str(EXAMPLE), "--format", "parquet", "--out", str(target)])
    assert isinstance(ran.exception, RequestError)
    assert ran.exception.cause == "pyarrow is not installed"
    assert "boat-daq[parquet]" in ran.exception.remedy
    assert list(tmp_path.iterdir()) == []


def test_cluster_without_its_library_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before any address is tried."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RequestError, match="Dask is not installed") as refused:
        connect("tcp://127.0.0.1:1")
    assert "boat-daq[cluster]" in refused.value.remedy


def test_bundle_names_no_pip(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program without Python has no pip to install with."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    with pytest.raises(RequestError) as refused:
        optional("pyarrow")
    assert "program without Python" in refused.value.remedy


@pytest.mark.parametrize("module", EXTRAS)
def test_damaged_library_is_no_absent_one(module: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A library that is there and fails while it is loaded keeps its own error."""
    (tmp_path / f"{module}.py").write_text("raise ImportError('a symbol is missing')")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(ImportError, match="a symbol is missing"):
        optional(module)
