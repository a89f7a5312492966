"""The results file of a sweep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.errors import FileError, RequestError
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, paper_grid, run_sweep

DESIGNS = (PAPER_OPTIMUM, *paper_grid((3,))[::60], Design(7, 0.7, 0.6, 0.8, "inner"))


@pytest.fixture(scope="module")
def request_() -> SweepRequest:
    return SweepRequest(DESIGNS, light=Light(rays=100))


@pytest.fixture(scope="module")
def result(request_: SweepRequest) -> SweepResult:
    return run_sweep(request_)


def same(a: SweepResult, b: SweepResult) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in ("ndr", "ndr_sd", "power", "counts", "energy")
    )


def test_a_stopped_sweep_resumes_where_it_was(request_: SweepRequest, result: SweepResult, tmp_path: Path) -> None:
    """Stopped by its progress call, the sweep leaves what was finished, simulates only the rest, and ends with the same
    bits.
    """
    file = tmp_path / "sweep.sqlite"
    big = SweepRequest(request_.designs, light=Light(rays=2000))

    def stop(done: float, total: float) -> None:
        if done >= 30:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(big, file=file, threads=1, progress=stop)
    again = run_sweep(big, file=file)
    assert 0 < again.simulated < again.ndr.size
    assert same(again, run_sweep(big))
    assert run_sweep(big, file=file).simulated == 0


def test_a_results_file_keeps_to_its_parameters(request_: SweepRequest, tmp_path: Path) -> None:
    """A file of another sweep, or of no sweep, is refused; more designs of the same sweep are welcome."""
    file = tmp_path / "sweep.sqlite"
    run_sweep(SweepRequest(DESIGNS[:2], light=request_.light), file=file)
    assert run_sweep(SweepRequest(DESIGNS[:3], light=request_.light), file=file).simulated == 15
    with pytest.raises(RequestError, match="other parameters"):
        run_sweep(SweepRequest(DESIGNS[:2], light=Light(rays=99)), file=file)
    (tmp_path / "text").write_text("not a database, but long enough to be read as one " * 20)
    with pytest.raises(FileError) as refused:
        run_sweep(request_, file=tmp_path / "text")
    assert refused.value.remedy
