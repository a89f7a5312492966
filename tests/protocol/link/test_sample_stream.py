"""Loss, order, time and flags of samples, from bytes through a connection."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol import Connection, SampleFlag, Samples
from protocol.link.events import BoardEventReceived, BoardRestarted, ClockWentBack, LinkEvent, SampleGap
from protocol.link.messages import BoardEvent, Hello, Sample, encode_message
from protocol.link.sample_stream import SampleStream, implausible
from protocol.recording import sample_dtype
from tests.protocol.link.streams import HELLO, START_DONE, STOP_DONE, hello_and, sample, stream


def rows_of(events: list[LinkEvent]) -> np.ndarray:
    return np.concatenate([event.array for event in events if isinstance(event, Samples)])


def gaps_of(events: list[LinkEvent]) -> list[SampleGap]:
    return [event for event in events if isinstance(event, SampleGap)]


@pytest.mark.fault(5, how="1, 7, 255, 256 and 70,000 samples missing, across the index's wrap too", times=10)
@pytest.mark.parametrize("lost", [1, 7, 255, 256, 70_000])
@pytest.mark.parametrize("before", [3, 2**32 - 3])
def test_a_gap_is_counted_exactly(lost: int, before: int) -> None:
    """Event, counter and flag agree, also across the wrap of the index."""
    link = Connection()
    events = link.receive(stream(HELLO, sample(before), sample(before + 1 + lost), sample(before + 2 + lost)), 0)
    (gap,) = gaps_of(events)
    assert (gap.lost, gap.before_index) == (lost, (before + 1 + lost) % 2**32)
    assert link.statistics.lost == lost
    assert ((rows_of(events)["flags"] & SampleFlag.GAP_BEFORE) != 0).tolist() == [False, True, False]
    assert gap.time_us == rows_of(events)["time_us"][1]


@given(st.lists(st.booleans(), min_size=1, max_size=300), st.integers(0, 2**32 - 1))
def test_lost_and_received_samples_add_up(came: list[bool], first: int) -> None:
    """Any pattern of loss: samples + lost = what was sent between the first and the last that came."""
    sent = [sample(first + n, n * 10_000) for n in range(len(came))]
    delivered = [n for n, here in enumerate(came) if here]
    link = Connection()
    link.receive(stream(HELLO, *[sent[n] for n in delivered]), 0)
    statistics = link.statistics
    assert statistics.samples == len(delivered)
    assert statistics.samples + statistics.lost == (delivered[-1] - delivered[0] + 1 if delivered else 0)


def test_loss_before_the_first_sample_of_a_started_stream_counts() -> None:
    """The index begins at 0 at START: a first sample 5 means five lost."""
    events = Connection().receive(hello_and(sample(5)), 0)
    assert [gap.lost for gap in gaps_of(events)] == [5]


def test_stream_found_running_is_adopted_without_loss() -> None:
    """The samples before are unknown: no loss, until an answer to START shows that this link began the stream."""
    link = Connection()
    assert gaps_of(link.receive(stream(HELLO, sample(40), sample(41)), 0)) == []
    assert [gap.lost for gap in gaps_of(link.receive(stream(START_DONE, sample(42)), 0))] == [40]
    assert link.statistics.lost == 40


def test_a_second_start_begins_at_zero_without_loss() -> None:
    """Old samples end, the index begins again: a new stream, not 41 late samples."""
    link = Connection()
    events = link.receive(hello_and(*[sample(n) for n in range(41)]), 0)
    events += link.receive(stream(STOP_DONE, START_DONE, *[sample(n, 900_000 + n * 10_000) for n in range(5)]), 0)
    assert gaps_of(events) == []
    assert rows_of(events)["index"].tolist() == [*range(41), *range(5)]
    assert (np.diff(rows_of(events)["time_us"]) > 0).all()


def test_a_repeated_answer_to_start_changes_nothing() -> None:
    """The first answer was late and its repeat arrives between samples: the stream continues."""
    link = Connection()
    events = link.receive(hello_and(sample(0), sample(1)) + stream(START_DONE, sample(2)), 0)
    assert gaps_of(events) == []
    assert rows_of(events)["index"].tolist() == [0, 1, 2]


@given(
    indexed=st.booleans(),
    orders=st.lists(st.integers(0, 255), min_size=1, max_size=40),
    cuts=st.lists(st.integers(0, 40), max_size=4),
)
def test_how_samples_are_cut_in_pieces_changes_nothing(indexed: bool, orders: list[int], cuts: list[int]) -> None:
    """Arbitrary indices or times, farther apart than half a wrap too: at once or piece by piece, the same is kept."""

    def account(places: list[int]) -> tuple[object, ...]:
        accounts = SampleStream(index_wrap=256 if indexed else None, time_wrap_us=256, announces_restart=False)
        rows = np.zeros(len(orders), sample_dtype(2, "counts"))
        rows["index" if indexed else "time_us"] = orders
        borders = [0, *sorted(place % (len(orders) + 1) for place in places), len(orders)]
        events = [event for at, to in pairwise(borders) for event in accounts.accept(rows[at:to].copy())]
        kept = [row for e in events if isinstance(e, Samples) for row in e.array[["index", "time_us"]].tolist()]
        reports = [event for event in events if not isinstance(event, Samples)]
        return kept, reports, accounts.counters

    assert account([]) == account(cuts)


@pytest.mark.fault(6, how="frames sent twice, swapped and late", times=1)
def test_repeated_and_reordered_samples_are_dropped_and_counted() -> None:
    """Each index is delivered once, in order."""
    link = Connection()
    order = [0, 1, 1, 2, 4, 3, 5, 5, 5, 6]
    events = link.receive(hello_and(*[sample(n) for n in order]), 0)
    assert rows_of(events)["index"].tolist() == [0, 1, 2, 4, 5, 6]
    assert link.statistics.duplicates == 4
    assert link.statistics.lost == 1


@pytest.mark.fault(6, how="a hundred samples sent twice in one piece", times=1)
def test_repeated_stretch_is_not_a_restart() -> None:
    """A hundred samples sent twice in one piece: their clock is old, so they are repeats."""
    link = Connection()
    data = [sample(n) for n in range(100)]
    events = link.receive(hello_and(*data, *data, sample(100)), 0)
    assert len(rows_of(events)) == 101
    assert link.statistics.duplicates == 100
    assert not any(isinstance(event, BoardRestarted) for event in events)


def test_false_index_costs_no_later_sample() -> None:
    """After a false index with a good checksum the samples are held, and all delivered after a restart."""
    link = Connection()
    after = [sample(n) for n in range(10, 40)]
    events = link.receive(hello_and(*[sample(n) for n in range(9)], sample(3_000_000_00, 90_000), *after), 0)
    assert rows_of(events)["index"].tolist() == [*range(9), 300_000_000, *range(10, 40)]
    assert [type(event) for event in events].count(BoardRestarted) == 1


@pytest.mark.parametrize(
    ("number", "from_us", "equal", "restarts"),
    [(16, 10_000, False, True), (15, 10_000, False, False), (16, 0, False, False), (16, 10_000, True, False)],
)
def test_sixteen_late_samples_on_a_clock_that_continues_are_a_restart(
    number: int, from_us: int, equal: bool, restarts: bool
) -> None:
    """Not fifteen, not from the very time of the last sample kept, not where two have the same time."""
    link = Connection()
    last_us = 9_000_000
    link.receive(hello_and(*[sample(n, last_us - 10_000 * (50 - n)) for n in range(51)]), 0)
    times = [last_us + from_us + 10_000 * n for n in range(number)]
    times[8] -= 10_000 * equal
    events = link.receive(stream(*[sample(5 + n, time) for n, time in enumerate(times)]), 0)
    assert any(isinstance(event, BoardRestarted) for event in events) == restarts
    if restarts:  # of the stream that began unseen five are missing, once its START is known as answered
        (gap,) = gaps_of(link.receive(stream(START_DONE, sample(5 + number, last_us + 200_000)), 0))
        assert gap.lost == 5


def test_samples_without_an_index_are_never_lost() -> None:
    """Numbered on arrival, from 0 again after a restart that 16 late ones show; an answer to START changes nothing."""
    accounts = SampleStream(index_wrap=None, announces_restart=False)
    rows = np.zeros(40, sample_dtype(2, "counts"))
    rows["time_us"] = [*range(1_000, 21_000, 1_000), *range(500, 20_500, 1_000)]
    events = accounts.accept(rows)
    accounts.stream_started()
    more = np.zeros(1, rows.dtype)
    more["time_us"] = 30_000
    events += accounts.accept(more)
    assert gaps_of(events) == []
    assert rows_of(events)["index"].tolist() == [*range(20), *range(21)]
    assert accounts.counters["lost"] == 0


@pytest.mark.fault(7, how="the 32-bit clock wraps once, and three times", times=2)
@pytest.mark.parametrize("wraps", [1, 3])
def test_the_clock_is_unwrapped(wraps: int) -> None:
    """71.6 minutes and more: time continues evenly over each wrap of the board's 32 bits."""
    period = 400_000_000  # 400 s
    n = wraps * 2**32 // period + 3
    events = Connection().receive(hello_and(*[sample(k, k * period) for k in range(n)]), 0)
    assert rows_of(events)["time_us"].tolist() == [k * period for k in range(n)]


@pytest.mark.fault(7, how="gaps with two and seven wraps in them, and with one in a gap of one sample", times=3)
@pytest.mark.parametrize(("period_us", "lost"), [(100_000, 9 * 3600 * 10), (100_000, 9 * 3600 * 36), (2 * 10**9, 1)])
def test_a_gap_in_which_the_clock_wrapped_keeps_its_length(period_us: int, lost: int) -> None:
    """Nine hours lost at 10 Hz: the index gives the number of wraps, by the last two neighbours before."""
    link = Connection()
    events = link.receive(hello_and(*[sample(n, n * period_us) for n in (0, 1, 3, 5)]), 0)
    events += link.receive(stream(sample(6 + lost, (6 + lost) * period_us)), 0)
    assert rows_of(events)["time_us"].tolist() == [n * period_us for n in (0, 1, 3, 5, 6 + lost)]


def test_a_clock_that_runs_backward_is_kept_and_flagged() -> None:
    """The sample is kept as sent, and left out of every figure."""
    events = Connection().receive(hello_and(sample(0, 50_000), sample(1, 40_000), sample(2, 60_000)), 0)
    rows = rows_of(events)
    assert rows["time_us"].tolist() == [50_000, 40_000, 60_000]
    assert ((rows["flags"] & SampleFlag.IMPLAUSIBLE) != 0).tolist() == [False, True, False]


@pytest.mark.fault(62, how="the clock set back by 50 ms to 50 min, to 0, before its own beginning", times=5)
@pytest.mark.parametrize(
    ("before_s", "after_s"), [(100.0, 99.95), (100.0, 40.0), (3_100.0, 100.0), (4_000.0, 0.0), (1.0, 4_294.0)]
)
def test_a_clock_that_goes_back_begins_a_segment(before_s: float, after_s: float) -> None:
    """The index continues, the clock is that of another time: an event with the time, then even samples, no gap."""
    at, to = round(before_s * 1e6), round(after_s * 1e6)
    samples = [sample(n, at + 10_000 * n) for n in range(5)]
    samples += [sample(5 + n, to + 10_000 * n) for n in range(5)]
    events = Connection().receive(hello_and(*samples), 0)
    (went_back,) = [event for event in events if isinstance(event, ClockWentBack)]
    assert went_back.by_us == (at + 50_000 - to) % 2**32
    assert gaps_of(events) == []
    rows = rows_of(events)
    assert rows["index"].tolist() == list(range(10))
    assert (rows["flags"] == 0).all()
    steps = np.diff(rows["time_us"])
    assert steps[4] == 10_000 - went_back.by_us
    assert (np.delete(steps, 4) == 10_000).all()


def test_a_clock_that_goes_back_in_a_gap_keeps_the_gap() -> None:
    """Five samples are lost where it goes back: counted, before the first sample of the new clock."""
    samples = [*(sample(n, 10**8 + 10_000 * n) for n in range(5)), *(sample(n, 10_000 * n) for n in range(10, 15))]
    events = Connection().receive(hello_and(*samples), 0)
    assert [(gap.lost, gap.before_index) for gap in gaps_of(events)] == [(5, 10)]
    assert sum(isinstance(event, ClockWentBack) for event in events) == 1


@pytest.mark.parametrize("wrong_us", [-3_000_000, 3_000_000, 2**31 - 50_000, -(2**31) + 50_000])
def test_one_wrong_time_is_no_other_clock(wrong_us: int) -> None:
    """One sample behind or ahead of the others, and the clock goes on: no segment, all samples kept."""
    samples = [sample(n, 10**8 + 10_000 * n + (wrong_us if n == 5 else 0)) for n in range(12)]
    events = Connection().receive(hello_and(*samples), 0)
    assert not any(isinstance(event, ClockWentBack) for event in events)
    rows = rows_of(events)
    assert rows["index"].tolist() == list(range(12))
    assert (rows["time_us"][[0, 4, 6, 11]] - 10**8).tolist() == [0, 40_000, 60_000, 110_000]


def test_the_last_sample_waits_for_the_clock_of_the_next() -> None:
    """A sample behind is kept once the next one shows its clock, or the end of the stream that none does."""
    link = Connection()
    events = link.receive(hello_and(sample(0, 50_000), sample(1, 60_000), sample(2, 10_000)), 0)
    assert rows_of(events)["index"].tolist() == [0, 1]
    again = Connection(decoder_state=link.decoder_state())
    (row,) = rows_of(link.receive(stream(STOP_DONE, START_DONE, sample(0, 70_000)), 0))[:1]
    assert (row["index"], bool(row["flags"] & SampleFlag.IMPLAUSIBLE)) == (2, True)
    after = again.receive(stream(sample(3, 20_000)), 0)
    assert [type(event) for event in after] == [ClockWentBack, Samples]
    assert rows_of(after)["time_us"].tolist() == [10_000, 20_000]


def test_an_event_has_its_time_on_the_samples_clock() -> None:
    """After a wrap, an event between two samples lies between them."""
    link = Connection()
    edge = 2**32
    events = link.receive(hello_and(sample(0, edge - 5_000), sample(1, edge + 5_000)), 0)
    (event,) = link.receive(stream(BoardEvent(7_000, 5, 0)), 0)
    assert event == BoardEventReceived(BoardEvent(7_000, 5, 0), edge + 7_000)
    assert rows_of(events)["time_us"].tolist() == [edge - 5_000, edge + 5_000]
    # where the board may have restarted, an earlier time is one of a new clock; that of the last sample is not
    link.receive(stream(STOP_DONE), 0)
    found = [link.receive(stream(BoardEvent(time, 5, 0)), 0)[0].time_us for time in (5_000, 4_999)]
    assert found == [edge + 5_000, 4_999]


ABSURD = [
    ({"pressure_pa": 5_000_000}, True),
    ({"pressure_pa": -120_000}, True),
    ({"pressure_pa": 250_000}, False),  # too much for the rig, and real: the interlock's business, not an absurdity
    ({"lit": (65_535, 2100)}, True),
    ({"lit": (4096, 2100)}, True),
    ({"lit": (4095, 2100)}, False),
    ({"dark": (40, 4096)}, True),
    ({"lit": (100, 2100), "dark": (40, 4000)}, True),
    ({"lit": (30, 2100), "dark": (40, 50)}, False),  # noise near zero light
    ({"lit": (30, 2100), "dark": (46, 50)}, False),  # 16 of 4096 counts
    ({"lit": (30, 2100), "dark": (47, 50)}, True),
]


@pytest.mark.fault(4, how="good frames with absurd values, both sides of each border", times=11)
@pytest.mark.parametrize(("change", "flagged"), ABSURD)
def test_impossible_values_are_kept_and_flagged(change: dict, flagged: bool) -> None:
    """A good checksum does not make 5 MPa, 65535 counts of 12 bits or light that darkens true; nothing is altered."""
    plain = sample(0)
    message = Sample(
        0, 0, change.get("pressure_pa", 0), 2, 0, change.get("lit", plain.lit), change.get("dark", plain.dark)
    )
    (row,) = rows_of(Connection().receive(hello_and(message), 0))
    assert bool(row["flags"] & SampleFlag.IMPLAUSIBLE) == flagged
    assert (row["pressure_pa"], tuple(row["lit"]), tuple(row["dark"])) == (
        message.pressure_pa,
        message.lit,
        message.dark,
    )


def test_signal_nan_is_flagged() -> None:
    """NaN from a text profile, in the pressure or any sensor."""
    rows = np.zeros(4, sample_dtype(2, "signal"))
    rows["pressure_pa"][1] = np.nan
    rows["signal_mv"][2, 1] = np.inf
    assert implausible(rows, 12).tolist() == [False, True, True, False]


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_one_to_four_sensors(n: int) -> None:
    """With the number from HELLO each reading is in its place; a longer payload gives the same."""
    values = {field: getattr(HELLO, field) for field in Hello.__dataclass_fields__}
    lit, dark = tuple(range(1001, 1001 + n)), tuple(range(1, 1 + n))
    message = Sample(0, 0, -123, 1, 4, lit, dark)
    events = Connection().receive(stream(Hello(**{**values, "n_sensors": n}), START_DONE, message), 9)
    (row,) = rows_of(events)
    assert (tuple(row["lit"]), tuple(row["dark"]), row["host_ns"]) == (lit, dark, 9)
    assert (row["pressure_pa"], row["state"], row["flags"]) == (-123, 1, 4)


def test_samples_longer_than_known_and_shorter_than_needed() -> None:
    """A newer minor version's longer SAMPLE is used, one too short is malformed, in one batch with plain ones."""
    link = Connection(n_sensors=1)
    longer = encode_message(sample(1), 0)  # two sensors: for one, a longer payload
    plain = [encode_message(Sample(n, n, 0, 0, 0, (5,), (1,)), 0) for n in (0, 2)]
    short = encode_message(Sample(3, 3, 0, 0, 0, (), ()), 0)
    events = link.receive(plain[0] + longer + plain[1] + short, 0)
    assert rows_of(events)["index"].tolist() == [0, 1, 2]
    assert rows_of(events)["lit"][:, 0].tolist() == [5, 2001, 5]
    assert link.statistics.malformed == 1


def test_samples_before_a_hello_are_counted_as_unknown() -> None:
    """Their number of sensors is unknown and is not guessed."""
    link = Connection()
    assert link.receive(stream(sample(0), sample(1)), 0) == []
    assert link.statistics.unknown == 2


def test_samples_come_as_one_block_split_only_by_other_messages() -> None:
    """Order is kept: a message between two samples is between their blocks, and blocks are read-only."""
    event = BoardEvent(15_000, 5, 0)
    events = Connection().receive(hello_and(sample(0), sample(1), event, sample(2)), 0)
    assert [type(e).__name__ for e in events] == ["HelloReceived", "Samples", "BoardEventReceived", "Samples"]
    for block in (e.array for e in events if isinstance(e, Samples)):
        with pytest.raises(ValueError, match="read-only"):
            block["index"] = 0
