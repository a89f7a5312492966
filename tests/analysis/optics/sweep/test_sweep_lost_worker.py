"""A sweep on the cluster of the how-to: a scheduler and two workers, started by its commands."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from threading import Thread

import pytest

from analysis.optics.scene.parameters import Light
from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep
from protocol.base.errors import RequestError

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(find_spec("distributed") is None, reason="no Dask"),
]  # each process imports Dask and the tracer: half a minute in all


def started(stack: ExitStack, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a part of the cluster; it is killed at the end of the test."""
    dask = Path(sys.executable).with_name("dask")
    process = subprocess.Popen([dask, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


@pytest.fixture
def cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler's address, and two workers without a nanny that would start them again."""
    from distributed import Client

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    with ExitStack() as stack:
        started(stack, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
        workers = [started(stack, "worker", address, *options) for _ in range(2)]
        with Client(address, timeout=60) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, workers


def kill_when_busy(address: str, workers: list[subprocess.Popen[bytes]]) -> None:
    """Kill workers while they compute their first tasks."""
    from distributed import Client

    with Client(address) as client:
        while not any(client.processing().values()):
            time.sleep(0.01)
    for worker in workers:
        os.kill(worker.pid, signal.SIGKILL)


def test_any_worker_may_die_while_one_is_left(cluster: tuple[str, list[subprocess.Popen[bytes]]]) -> None:
    """Killed during the first tasks, one worker leaves the sweep to the other, with the bits of this computer."""
    address, workers = cluster
    request = SweepRequest(tuple(paper_grid((3,))), light=Light(rays=500, secondary=200))
    killer = Thread(target=kill_when_busy, args=(address, workers[:1]))
    killer.start()
    found = run_sweep(request, scheduler=address)
    killer.join()
    assert workers[0].wait(10) == -signal.SIGKILL
    here = run_sweep(request)
    assert found.counts.tobytes() == here.counts.tobytes()
    assert found.energy.tobytes() == here.energy.tobytes()


def test_without_any_worker_left_the_sweep_ends_with_the_remedy(
    cluster: tuple[str, list[subprocess.Popen[bytes]]],
) -> None:
    """Both killed: no endless wait."""
    address, workers = cluster
    killer = Thread(target=kill_when_busy, args=(address, workers))
    killer.start()
    with pytest.raises(RequestError, match="were lost"):
        run_sweep(SweepRequest(tuple(paper_grid((3,))), light=Light(rays=2_000, secondary=800)), scheduler=address)
    killer.join()
