"""Sweeps: the same bits from threads, a stopped run and a cluster."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.errors import RequestError
from analysis.optics.scene.curves import frame_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, paper_grid, run_sweep
from analysis.optics.tracer.simulation import trace

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


def test_the_papers_grid_is_648_designs_in_15_states() -> None:
    """216 designs for each of 3, 5 and 7 cavities; the paper's optimum is among them."""
    grid = paper_grid()
    assert len(grid) == len(set(grid)) == 648
    assert PAPER_OPTIMUM in grid


def test_a_sweeps_simulation_is_the_traced_one(result: SweepResult) -> None:
    """Every number of a sweep is that of the same scene traced alone, to the last bit."""
    for i in (0, len(DESIGNS) - 1):
        for state in (0, 9):
            frame = frame_of(result.request.curves, state, Waveguide())
            out = trace(frame, DESIGNS[i], Waveguide(), Light(rays=100))
            assert out.ndr == result.ndr[i, state]
            assert out.power == result.power[i, state]
            assert out.ndr_sd == pytest.approx(result.ndr_sd[i, state], rel=1e-12)


def test_threads_and_their_number_change_no_bit(request_: SweepRequest, result: SweepResult) -> None:
    """One thread gives what all give."""
    assert same(run_sweep(request_, threads=1), result)


def test_progress_reaches_its_end(request_: SweepRequest) -> None:
    """Progress rises to the number of simulations."""
    seen: list[tuple[float, float]] = []
    run_sweep(request_, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (15 * len(DESIGNS), 15 * len(DESIGNS))
    assert seen == sorted(seen)


def test_a_design_that_fits_no_state_stops_the_sweep_before_it_starts() -> None:
    """The design is refused by name."""
    with pytest.raises(RequestError, match="cuts through"):
        run_sweep(SweepRequest((Design(5, 1.0, 1.0, 0.9),), guide=Waveguide(thickness_mm=1.0)))
    with pytest.raises(RequestError, match="without designs"):
        run_sweep(SweepRequest(()))


def test_counted_rays_scatter_within_their_standard_deviation(curves: np.ndarray) -> None:
    """Fans turned by parts of a step scatter no more than the stated standard deviation, and not by nothing."""
    frame = frame_of(curves, 6, Waveguide())
    outs = [
        trace(frame, Design(), Waveguide(), Light(rays=250, secondary=0, phase=p)) for p in np.linspace(-0.49, 0.49, 40)
    ]
    scatter, stated = np.std([o.ndr for o in outs]), np.mean([o.ndr_sd for o in outs])
    assert 0.15 * stated < scatter < 1.3 * stated


@pytest.mark.parametrize("processes", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_cluster_gives_the_same_bits(request_: SweepRequest, result: SweepResult, processes: bool) -> None:
    """Two Dask workers behind TCP, threads or processes, give what this process gives, bit for bit."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=processes, protocol="tcp", dashboard_address=None, silence_logs=50
    ) as cluster:
        assert same(run_sweep(request_, scheduler=cluster.scheduler_address), result)


def test_an_absent_scheduler_is_rejected_with_a_remedy(request_: SweepRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """An address without a scheduler is refused with how to start one."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("analysis.cluster.CONNECT_S", 1.0)
    with pytest.raises(RequestError, match="no Dask scheduler") as refused:
        run_sweep(request_, scheduler="tcp://127.0.0.1:9")
    assert "dask scheduler" in refused.value.remedy
