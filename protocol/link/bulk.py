"""Decode whole recordings: the same bytes to the same samples, bit for bit.

The link itself decodes the recorded chunks, joined in batches, so that the overhead of a call is spread over thousands
of samples. Losses, repeats and flags equal those of the live stream: nothing depends on the division into chunks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from protocol.link.events import Link, LinkEvent, LinkStatistics, SampleGap, Samples
from protocol.link.sample_stream import Rows
from protocol.recording import sample_dtype

BATCH_BYTES = 1 << 18  # large enough to hide the overhead of a call, well within the caches


@dataclass(frozen=True, slots=True, eq=False)
class Decoded:
    """Samples in their order, gaps, every other event, and the link's counters."""

    samples: Rows
    gaps: tuple[SampleGap, ...]
    events: tuple[LinkEvent, ...]
    statistics: LinkStatistics


def decode_chunks(chunks: Iterable[tuple[int, bytes]], link: Link) -> Iterator[list[LinkEvent]]:
    """Yield the events of each 256 kB of chunks (host_ns, bytes); `link` is in the state before the first."""
    batch: list[tuple[int, bytes]] = []
    size = 0
    for chunk in chunks:
        batch.append(chunk)
        size += len(chunk[1])
        if size >= BATCH_BYTES:
            yield link.receive_chunks(batch)
            batch, size = [], 0
    if batch:
        yield link.receive_chunks(batch)


def decode_samples(chunks: Iterable[tuple[int, bytes]] | bytes, link: Link) -> Decoded:
    """Return the samples, gaps and events in chunks (host_ns, bytes), or in bytes alone, whose `host_ns` is then 0.

    `samples` is empty, with two sensors, where there are none. Samples of one call have one sensor count.
    """
    if isinstance(chunks, bytes):
        view = chunks
        chunks = ((0, view[at : at + BATCH_BYTES]) for at in range(0, len(view), BATCH_BYTES))
    events = [event for batch in decode_chunks(chunks, link) for event in batch]
    arrays = [event.array for event in events if isinstance(event, Samples)]
    dtype = sample_dtype(link.n_sensors or 2, link.sample_kind, len(link.channels))
    return Decoded(
        samples=np.concatenate(arrays) if arrays else np.empty(0, dtype),
        gaps=tuple(event for event in events if isinstance(event, SampleGap)),
        events=tuple(event for event in events if not isinstance(event, Samples | SampleGap)),
        statistics=link.statistics,
    )
