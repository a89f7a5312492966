"""The reading thread: every byte to every sink in order, whatever a sink, the board or the port does."""

from __future__ import annotations

import os
import sys
import threading

import numpy as np
import pytest

from boat_daq.engine.link.block import Block, PortLost, PortSilent, SinkFailed
from boat_daq.engine.link.reader import URGENT_NICE, PortReader
from protocol import CommandDone, CommandLost, Connection, Heartbeat, Identify, Samples, Start, Vent
from protocol.base.errors import DeviceError
from protocol.simulator.board import VirtualBoard
from tests.boat_daq.engine.board_link import BoardTransport, Seen, identified, urgent_nice


class FakeClock:
    """A monotonic clock that advances by 10 ms at every reading."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        self.now_ns += 10_000_000
        return self.now_ns


def test_blocks_are_the_bytes_with_their_samples():
    """The blocks joined are the bytes that came, and their samples those of a link fed with the same bytes."""
    transport = BoardTransport(VirtualBoard(seed=3), end_us=10_000_000)
    reader, _, seen = identified(transport)
    reader.send(Start(200))
    assert seen.wait(PortSilent)
    reader.stop()
    came = [block for block in seen.blocks if block.raw and not block.sent]
    assert b"".join(block.raw for block in came) == b"".join(transport.received)
    plain = Connection()
    again = [event.array for event in plain.receive(b"".join(transport.received), 0) if isinstance(event, Samples)]
    live = np.concatenate([event.array for event in seen.events(Samples)])
    for name in ("index", "time_us", "pressure_pa", "lit", "dark"):
        assert np.array_equal(live[name], np.concatenate(again)[name])
    assert all(
        (block.host_ns == event.array["host_ns"]).all()
        for block in came
        for event in block.events
        if isinstance(event, Samples)
    )


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a thread's priority cannot be read")
def test_reader_runs_first_where_the_system_allows_it():
    """A port holds some milliseconds of samples: what waits longer for the processor is lost."""
    reader, _, _ = identified(BoardTransport(VirtualBoard(), end_us=1_000_000))
    assert os.getpriority(os.PRIO_PROCESS, reader._thread.native_id) == urgent_nice()
    assert os.getpriority(os.PRIO_PROCESS, os.getpid()) > URGENT_NICE
    assert reader.urgent == (urgent_nice() == URGENT_NICE)
    reader.stop()


def test_reader_without_the_right_to_a_priority_says_so(monkeypatch):
    """It reads all the same, and the log names the thread."""
    noted = []

    def refuse(*_: int) -> None:
        raise PermissionError

    monkeypatch.setattr("boat_daq.engine.link.reader.note", lambda level, text: noted.append((level, text)))
    monkeypatch.setattr(os, "setpriority", refuse)
    monkeypatch.setattr(sys, "platform", "linux")
    reader, _, _ = identified(BoardTransport(VirtualBoard(), end_us=1_000_000))
    assert not reader.urgent
    assert noted == [("warning", f"{reader._thread.name} has normal priority: this user may not raise it")]
    reader.stop()


def test_a_sink_that_raises_is_reported_once_and_the_others_continue():
    """A page's fault is an event in the stream; recorder and plots see every block."""
    transport = BoardTransport(VirtualBoard(), end_us=3_000_000)
    reader = PortReader(transport, Connection())
    calls, seen = [], Seen()

    def bad(block: Block) -> None:
        calls.append(block)
        raise ZeroDivisionError

    reader.add_sink(bad)
    reader.add_sink(seen)
    reader.start()
    reader.send(Identify())
    assert seen.wait(CommandDone)
    reader.send(Start(100))
    assert seen.wait(PortSilent)
    reader.stop()
    failures = seen.events(SinkFailed)
    assert [failure.sink for failure in failures] == [bad.__qualname__]
    assert isinstance(failures[0].error, ZeroDivisionError)
    assert sum(map(len, (event.array for event in seen.events(Samples)))) > 200
    assert [b for b in calls if b.raw] == [b for b in seen.blocks if b.raw]


def test_an_unplugged_port_ends_the_reading_with_one_event():
    """PortLost carries the reason, nothing follows it, and the port is closed by its reader."""
    transport = BoardTransport(VirtualBoard())
    reader, _, seen = identified(transport)
    transport.unplug = True
    assert seen.wait(PortLost)
    reader.stop()
    assert isinstance(seen.blocks[-1].events[0].error, DeviceError)
    assert len(seen.events(PortLost)) == 1
    assert transport.closed
    assert not reader._thread.is_alive()


def test_what_was_heard_is_as_old_as_the_bytes_that_wait() -> None:
    """While bytes wait in the port, the time by which all was read stands still; an empty read moves it."""
    transport = BoardTransport(VirtualBoard(), end_us=0)
    reader = PortReader(transport, Connection(), clock_ns=FakeClock())
    reader._turn()
    before_ns = reader.heard_ns
    transport.waiting = True
    transport.end_us = None
    reader.send(Start(100))
    for _ in range(5):
        reader._turn()
    assert reader.heard_ns == before_ns
    transport.waiting = False
    reader._turn()
    assert reader.heard_ns > before_ns


@pytest.mark.fault(12, how="a port that stays open and sends nothing", times=1)
def test_silence_is_reported_once_and_again_after_data():
    """An open port without data for a second is reported once, not an endless alarm."""
    board = VirtualBoard()
    transport = BoardTransport(board, end_us=0)
    seen, reader = Seen(), PortReader(transport, Connection(), clock_ns=FakeClock())
    reader.add_sink(seen)
    reader.start()
    assert seen.wait(PortSilent)
    assert not seen.wait(PortSilent, 2, timeout_s=0.3)
    reader.send(Identify())
    transport.end_us = board.now_us + 200_000
    assert seen.wait(PortSilent, 2)
    reader.stop()
    assert all(event.silent_s > 1.0 for event in seen.events(PortSilent))


def test_a_command_without_an_answer_goes_out_three_times_and_is_lost():
    """The reading thread repeats and gives up on the clock it is given."""

    class NoAnswer(BoardTransport):
        written: list[bytes] = []  # noqa: RUF012 - one instance

        def write(self, data: bytes) -> None:
            self.written.append(data)

    transport = NoAnswer(VirtualBoard(), end_us=0)
    seen, reader = Seen(), PortReader(transport, Connection(), clock_ns=FakeClock())
    reader.add_sink(seen)
    reader.start()
    reader.send(Vent())
    assert seen.wait(CommandLost)
    reader.stop()
    assert len(transport.written) == 3
    assert len(set(transport.written)) == 1
    sent = [block.raw for block in seen.blocks if block.sent]
    assert sent == transport.written


def test_an_answer_that_waits_in_the_port_through_a_stall_is_read_before_the_command_is_given_up():
    """The board answers the last repeat at once; this program stalls for two seconds, behind 100 reads."""

    class Clock:
        now_ns = 0

        def __call__(self) -> int:
            return self.now_ns

    clock = Clock()

    class Stalled(BoardTransport):
        written, backlog = 0, 0

        def read(self) -> bytes:
            if self.written < 3:
                clock.now_ns += 50_000_000
                return b""
            if self.backlog == 0:
                clock.now_ns += 2_000_000_000
            self.backlog += 1
            clock.now_ns += 1_000_000
            return super().read() if self.backlog > 100 else b"\0"

        def write(self, data: bytes) -> None:
            self.written += 1
            if self.written == 3:
                super().write(data)

    transport = Stalled(VirtualBoard())
    seen, reader = Seen(), PortReader(transport, Connection(in_turn=True), clock_ns=clock)
    reader.add_sink(seen)
    reader.send(Heartbeat(5000))
    reader.start()
    assert seen.wait(CommandDone)
    reader.stop()
    assert not seen.events(CommandLost)


def test_an_answer_behind_a_slowly_read_backlog_counts():
    """Answered at once, behind fifty reads of 20 ms each: no stall, but a program that is behind the port all along."""

    class Clock:
        now_ns = 0

        def __call__(self) -> int:
            return self.now_ns

    clock = Clock()

    class Behind(BoardTransport):
        backlog = 50

        @property
        def unread(self) -> bool:
            return self.backlog > 0

        def read(self) -> bytes:
            clock.now_ns += 20_000_000
            self.backlog -= 1
            return super().read() if self.backlog < 0 else b"\0"

    seen, reader = Seen(), PortReader(Behind(VirtualBoard()), Connection(in_turn=True), clock_ns=clock)
    reader.add_sink(seen)
    reader.send(Heartbeat(5000))
    reader.start()
    assert seen.wait(CommandDone)
    reader.stop()
    assert not seen.events(CommandLost)


def test_commands_from_many_threads_reach_the_sinks_in_the_order_sent():
    """`send` is thread-safe; what the sinks receive as sent is what the port received."""
    transport = BoardTransport(VirtualBoard())
    written, plain_write = [], transport.write

    def write(data: bytes) -> None:
        written.append(data)
        plain_write(data)

    transport.write = write
    reader, _, seen = identified(transport)
    threads = [threading.Thread(target=lambda: [reader.send(Heartbeat(1000)) for _ in range(20)]) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert seen.wait(CommandDone, 101)
    reader.stop()
    assert [block.raw for block in seen.blocks if block.sent] == written


def test_a_recorder_gets_the_decoder_at_the_instant_it_is_added():
    """State and following blocks together decode to exactly the samples that follow."""

    class DecodingSink(Seen):
        state = None

        def attached(self, decoder_state):
            self.state = decoder_state

    board = VirtualBoard(seed=5)
    transport = BoardTransport(board, step_us=3_333)
    reader, _, seen = identified(transport)
    reader.send(Start(1000))
    assert seen.wait(Samples, 50)
    sink = DecodingSink()
    reader.add_recorder(sink)
    assert sink.wait(Samples, 50)
    reader.stop()
    link = Connection(decoder_state=sink.state)
    again = [event for block in sink.blocks if not block.sent for event in link.receive(block.raw, block.host_ns)]
    derived = np.concatenate([event.array for event in again if isinstance(event, Samples)])
    assert derived.tobytes() == np.concatenate([event.array for event in sink.events(Samples)]).tobytes()
    assert derived["index"][0] > 0


def test_a_removed_sink_receives_nothing_and_stop_is_idempotent():
    """Sinks come and go while the thread reads; stopping is idempotent, even before the start."""
    transport = BoardTransport(VirtualBoard())
    reader, _, seen = identified(transport)
    reader.remove_sink(seen)
    other = Seen()
    reader.add_sink(other)
    reader.send(Start(100))
    assert other.wait(Samples)
    assert not seen.events(Samples)
    reader.stop()
    reader.stop()
    unused = BoardTransport(VirtualBoard())
    PortReader(unused, Connection()).stop()
    assert unused.closed


def test_a_command_to_a_port_that_is_gone_raises_at_the_caller():
    """The sender learns at once that nothing was sent."""

    class Unplugged(BoardTransport):
        def write(self, data: bytes) -> None:
            raise DeviceError("virtual is gone", "Plug it in.")

    reader = PortReader(Unplugged(VirtualBoard()), Connection())
    with pytest.raises(DeviceError, match="gone"):
        reader.send(Vent())
    reader.stop()
