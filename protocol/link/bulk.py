"""Whole recordings at once: the same bytes to the same samples, bit for bit, as fast as the machine goes.

There is one decoder, the link; a recording's chunks are handed to it joined in batches, so that the cost of a call is
paid once for thousands of samples. What is lost, repeated or flagged comes out as it did while streaming, because
nothing of it depends on the cutting into chunks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from protocol.link.events import Link, LinkEvent, LinkStatistics, SampleGap, Samples
from protocol.link.sample_stream import Rows
from protocol.recording import sample_dtype

BATCH_BYTES = 1 << 18  # past the point where a call's own cost matters, well within the caches


@dataclass(frozen=True, slots=True, eq=False)
class Decoded:
    """What was in the bytes: samples in their order, gaps, every other event, and the link's counters."""

    samples: Rows
    gaps: tuple[SampleGap, ...]
    events: tuple[LinkEvent, ...]
    statistics: LinkStatistics


def decode_chunks(chunks: Iterable[tuple[int, bytes]], link: Link) -> Iterator[list[LinkEvent]]:
    """Give the link's events batch after batch, in bounded memory.

    Parameters
    ----------
    chunks : (host_ns, bytes) as they were recorded, in order.
    link : a link in the state that the recording's was in before its first chunk.

    Yields
    ------
    The events of about 256 kB of bytes.
    """
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
    """Return all that the bytes hold.

    Parameters
    ----------
    chunks : (host_ns, bytes) as they were recorded, in order; or bytes alone, whose `host_ns` is then 0.
    link : as for `decode_chunks`.

    Returns
    -------
    `Decoded`; `samples` is empty, of two sensors, where there are none. Samples of one call have one sensor count.
    """
    if isinstance(chunks, bytes):
        view = chunks
        chunks = ((0, view[at : at + BATCH_BYTES]) for at in range(0, len(view), BATCH_BYTES))
    events = [event for batch in decode_chunks(chunks, link) for event in batch]
    arrays = [event.array for event in events if isinstance(event, Samples)]
    return Decoded(
        samples=np.concatenate(arrays) if arrays else np.empty(0, sample_dtype(link.n_sensors or 2, link.sample_kind)),
        gaps=tuple(event for event in events if isinstance(event, SampleGap)),
        events=tuple(event for event in events if not isinstance(event, Samples | SampleGap)),
        statistics=link.statistics,
    )
