"""How fast the virtual board makes and frames samples, beside framing them one by one, and what the port costs."""

from __future__ import annotations

import time

import numpy as np
import pytest

from protocol.link.messages import Sample, SetPressure, Start, encode_command, encode_message
from protocol.simulator.board import VirtualBoard
from protocol.simulator.sample_frames import body_dtype, encode_samples, frame_length
from tests.benchmarks.lengths import length


def samples_per_second(rate_hz: int, board_s: float, step_us: int) -> float:
    """Generate and frame samples in steps of board time, pressure moving; return samples over CPU seconds."""
    board = VirtualBoard()
    board.receive(encode_command(Start(rate_hz), 0) + encode_command(SetPressure(50_000, 10_000), 1))
    board.advance(step_us)
    began, sent = time.process_time(), 0
    for _ in range(length(round(board_s * 1e6 / step_us), 3)):
        sent += len(board.advance(step_us))
    return sent / frame_length(board.n_sensors) / (time.process_time() - began)


@pytest.mark.parametrize(
    ("speed", "rate_hz", "step_ms", "board_s"), [(1, 10_000, 5, 20), (100, 100, 200, 2000), (1000, 100, 2000, 10_000)]
)
def test_generation(speed, rate_hz, step_ms, board_s, capsys):
    """Samples a second of one core, in the steps in which the server requests them."""
    rate = samples_per_second(rate_hz, board_s, step_ms * 1000)
    with capsys.disabled():
        share = 100 * speed * rate_hz / rate
        print(f"\n{rate_hz} Hz at {speed}x in steps of {step_ms} ms: {rate:,.0f} samples/s ({share:.1f} % of a core)")
    assert rate > 0


def test_framing(capsys):
    """Frames by the block beside frames one by one."""
    n = length(20_000, 200)
    bodies = np.zeros(n, body_dtype(2))
    bodies["index"], bodies["counts"] = np.arange(n), np.random.default_rng(0).integers(0, 4096, (n, 2, 2))
    began = time.process_time()
    block = encode_samples(bodies, 0).tobytes()
    by_block = time.process_time() - began
    began = time.process_time()
    plain = b"".join(
        encode_message(Sample(i, 0, 0, 0, 0, (int(c[0, 0]), int(c[1, 0])), (int(c[0, 1]), int(c[1, 1]))), i)
        for i, c in enumerate(bodies["counts"])
    )
    one_by_one = time.process_time() - began
    with capsys.disabled():
        ratio = one_by_one / by_block
        print(f"\nframes by the block {n / by_block:,.0f}/s, one by one {n / one_by_one:,.0f}/s, ratio {ratio:.1f}")
    assert block == plain
