"""Frames made by the block, against frames made one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.link.messages import Sample, encode_message
from protocol.simulator.sample_frames import body_dtype, encode_samples, frame_length

RARE_AND_PLAIN = st.one_of(st.sampled_from([0, 1, 255, 256]), st.integers(0, 65_535))


@pytest.mark.parametrize("n_sensors", [1, 2, 3, 4])
@settings(max_examples=30)
@given(data=st.data())
def test_every_frame_equals_the_plain_encoder(n_sensors, data):
    """Whatever the values, zeros above all, and wherever the sequence number wraps."""
    n, seq = data.draw(st.integers(0, 5)), data.draw(st.integers(0, 1000))
    bodies, plain = np.zeros(n, body_dtype(n_sensors)), []
    for row in range(n):
        index, time_us = data.draw(st.integers(0, 2**32 - 1)), data.draw(st.integers(0, 2**32 - 1))
        pressure_pa, state = data.draw(st.integers(-(2**31), 2**31 - 1)), data.draw(st.integers(0, 4))
        flags = data.draw(st.integers(0, 255))
        lit = tuple(data.draw(RARE_AND_PLAIN) for _ in range(n_sensors))
        dark = tuple(data.draw(RARE_AND_PLAIN) for _ in range(n_sensors))
        bodies[row] = (0, 0, index, time_us, pressure_pa, state, flags, np.array([lit, dark]).T)
        plain.append(encode_message(Sample(index, time_us, pressure_pa, state, flags, lit, dark), seq + row))
    frames = encode_samples(bodies, seq)
    assert frames.shape == (n, frame_length(n_sensors))
    assert frames.tobytes() == b"".join(plain)
