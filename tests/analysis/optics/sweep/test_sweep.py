"""Sweeps: the same bits from threads, a stopped run and a cluster."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import event

from analysis.optics.scene.curves import frame_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light, Waveguide, light_by
from analysis.optics.sweep.report import sweep_json, sweep_text
from analysis.optics.sweep.sweep import Common, Results, SweepRequest, SweepResult, paper_grid, run_item, run_sweep
from analysis.optics.tracer.simulation import trace
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from tests.analysis.optics.sweep.conftest import same


def test_the_papers_grid_is_648_designs_in_15_states() -> None:
    """216 designs for each of 3, 5 and 7 cavities; the paper's optimum is among them."""
    grid = paper_grid()
    assert len(grid) == len(set(grid)) == 648
    assert PAPER_OPTIMUM in grid


def test_a_sweeps_simulation_is_the_traced_one(small_result: SweepResult) -> None:
    """Every number of a sweep is that of the same scene traced alone, to the last bit."""
    for i in (0, len(small_result.designs) - 1):
        for state in (0, 9):
            frame = frame_of(small_result.request.curves, state, Waveguide())
            out = trace(frame, small_result.designs[i], Waveguide(), Light(rays=100))
            assert out.ndr == small_result.ndr[i, state]
            assert out.power == small_result.power[i, state]
            assert out.power_sd == pytest.approx(small_result.power_sd[i, state], rel=1e-12)
            assert out.ndr_sd == pytest.approx(small_result.ndr_sd[i, state], rel=1e-12)


def test_power_ranks_with_every_reflection_followed() -> None:
    """By power the figures are of detected power, larger than with 100 secondaries; what is missing is bounded."""
    designs = (PAPER_OPTIMUM, Design(7, 1.0, 0.5, 0.6))
    few = run_sweep(SweepRequest(designs, light=light_by("count", 100)))
    found = run_sweep(SweepRequest(designs, light=light_by("power", 100), by="power"))
    np.testing.assert_array_equal(found.merit().p, found.merit_of_power().p)
    assert not np.array_equal(found.merit().p, replace(found, request=replace(found.request, by="count")).merit().p)
    assert np.max(found.given_up) < 0.05 < np.min(few.given_up)
    assert np.mean(found.power) > 1.02 * np.mean(few.power)
    finer = run_sweep(SweepRequest(designs, light=replace(light_by("power", 100), faintest=1e-4), by="power"))
    assert np.all(np.abs(finer.power - found.power) <= found.given_up)
    assert np.all(found.counts[..., -1] == 0)
    assert "not followed" in sweep_text(found)
    assert sweep_json(found)["not_followed"]["greatest"] == np.max(found.given_up)


def test_threads_and_their_number_change_no_bit(small_request: SweepRequest, small_result: SweepResult) -> None:
    """One thread gives what all give."""
    assert same(run_sweep(small_request, threads=1), small_result)


def test_states_of_a_design_simulated_apart_change_no_bit(
    small_request: SweepRequest, small_result: SweepResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the rays are many an item is one design in some states, so that a stop takes effect within one."""
    items: list[tuple[int, int]] = []

    def counted(common: Common, patterns: FloatArray, states: slice) -> Results:
        found = run_item(common, patterns, states)
        items.append(found[0].shape[:2])
        return found

    monkeypatch.setattr("analysis.optics.sweep.sweep._RAYS_PER_ITEM", 4 * small_request.light.rays)
    monkeypatch.setattr("analysis.optics.sweep.sweep.run_item", counted)
    assert same(run_sweep(small_request), small_result)
    assert sorted(set(items)) == [(1, 3), (1, 4)]


def test_no_thread_of_the_pool_compiles(small_request: SweepRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tracer is compiled in the thread that Ctrl-C reaches; the pool's would end only when it is compiled."""
    ends_threads: set[int] = set()

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None: ...

        def on_end(self, event: object) -> None:
            ends_threads.add(threading.get_ident())

    def nothing(frames, patterns, rules, fan, shares, work, counts, energy, changes):  # type: ignore[no-untyped-def]
        counts[:] = 1

    monkeypatch.setattr("analysis.optics.sweep.sweep.simulate_many", numba.njit(nogil=True)(nothing))
    with event.install_listener("numba:compile", Listener()):
        run_sweep(small_request)
    assert ends_threads == {threading.get_ident()}


def test_progress_reaches_its_end(small_request: SweepRequest) -> None:
    """Progress rises to the number of simulations."""
    seen: list[tuple[float, float]] = []
    run_sweep(small_request, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (90, 90)
    assert seen == sorted(seen)


def test_a_design_that_fits_no_state_stops_the_sweep_before_it_starts() -> None:
    """The design is refused by name."""
    with pytest.raises(RequestError, match="cuts through"):
        run_sweep(SweepRequest((Design(5, 1.0, 1.0, 0.9),), Waveguide(thickness_mm=1.0)))
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
def test_a_cluster_gives_the_same_bits(small_request: SweepRequest, small_result: SweepResult, processes: bool) -> None:
    """Two Dask workers behind TCP, threads or processes, give what this process gives, bit for bit."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=processes, protocol="tcp", dashboard_address=None, silence_logs=50
    ) as cluster:
        assert same(run_sweep(small_request, scheduler=cluster.scheduler_address), small_result)


def test_an_absent_scheduler_is_rejected_with_a_remedy(
    small_request: SweepRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An address without a scheduler is refused with how to start one."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("analysis.cluster.CONNECT_S", 1.0)
    with pytest.raises(RequestError, match="no Dask scheduler") as refused:
        run_sweep(small_request, scheduler="tcp://127.0.0.1:9")
    assert "dask scheduler" in refused.value.remedy


def test_lost_workers_are_named_and_the_sweep_resumes_here(
    small_request: SweepRequest, small_result: SweepResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a worker, and when the last is lost, cause and remedy are given; the sweep resumes here bit for bit."""
    distributed = pytest.importorskip("distributed")
    file = tmp_path / "sweep.sqlite"

    def lost(common: object, patterns: object, states: object) -> None:
        raise TimeoutError("no answer")

    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None, silence_logs=50
    ) as cluster:
        with pytest.raises(RequestError, match="no worker"):
            run_sweep(small_request, scheduler=cluster.scheduler_address, file=file)
        cluster.scale(1)
        cluster.wait_for_workers(1)
        with monkeypatch.context() as patch, pytest.raises(RequestError, match="were lost") as refused:
            patch.setattr("analysis.optics.sweep.sweep.run_item", lost)
            run_sweep(small_request, scheduler=cluster.scheduler_address, file=file)
    assert "--out" in refused.value.command
    assert same(run_sweep(small_request, file=file), small_result)
