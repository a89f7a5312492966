"""Verification: identical for every stream a board can send, and the first difference named for every tampering."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import protocol
from boat_daq.engine.link import opening
from boat_daq.engine.link.block import Block
from boat_daq.engine.link.opening import open_link
from boat_daq.engine.recording import verify
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.verify import verify_recording
from protocol import Connection, Start
from protocol.link.bulk import decode_chunks
from protocol.recording import RunEnd, dtype_from_description, open_recording, read_session, session_dtype
from protocol.simulator.board import VirtualBoard
from protocol.simulator.faults import parse_fault
from protocol.text.connection import TextConnection
from protocol.text.profile import load_profile
from tests.boat_daq.engine.board_link import BoardTransport, Seen, identified, meta_of, record_run
from tests.boat_daq.engine.recording_source import Source, add_result, begin

PROFILE = Path(protocol.__file__).parent / "profiles" / "delimited_lines.toml"


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """A minute with flipped bits, lost bytes and dropped samples."""
    path = tmp_path_factory.mktemp("verify") / "run.boat"
    faults = [parse_fault(text) for text in ("bit_flips@2:0.0005", "index_gap@20:300")]
    record_run(path, VirtualBoard(seed=4, faults=faults), 60.0, rate_hz=200)
    return path


@pytest.fixture
def copy(recording, tmp_path) -> Path:
    path = tmp_path / "run.boat"
    path.write_bytes(recording.read_bytes())
    return path


def change(path: Path, sql: str, values: tuple = ()) -> None:
    db = sqlite3.connect(path)
    assert db.execute(sql, values).rowcount > 0
    db.commit()
    db.close()


def rows(path: Path, sql: str) -> list[tuple]:
    db = open_recording(path)
    found = db.execute(sql).fetchall()
    db.close()
    return found


def test_a_damaged_stream_verifies(recording):
    """With damaged frames and gaps, what was recorded is still derived again bit for bit."""
    verdict = verify_recording(recording)
    assert (verdict.identical, verdict.difference) == (True, "")
    assert verdict.samples == rows(recording, "SELECT sum(n) FROM block")[0][0] > 10_000
    assert verdict.chunks == rows(recording, "SELECT max(id) FROM chunk")[0][0]
    assert rows(recording, "SELECT count(*) > 3, sum(value) > 3 FROM event WHERE kind = 'gap'") == [(1, 1)]


def test_a_recording_begun_in_mid_stream_verifies(tmp_path):
    """Between two bytes of a frame, long after START: the decoder's state in the file makes up for what came before."""
    for number, before_s in enumerate((0.77, 1.3, 2.01)):
        path = tmp_path / f"{number}.boat"
        record_run(path, VirtualBoard(seed=number), 3.0, rate_hz=1000, before_s=before_s)
        verdict = verify_recording(path)
        assert verdict.identical, verdict.difference
        assert rows(path, "SELECT reason FROM segment") == [("opened",)]


@pytest.mark.fault(10, how="virtual board's `reset` into a recording", times=1)
def test_a_board_that_restarts_makes_a_segment_that_verifies(tmp_path):
    """The restart is a segment of its own, with its reason, and the whole is identical."""
    path = tmp_path / "run.boat"
    board = VirtualBoard(seed=1, faults=[parse_fault("reset@3")])
    transport = BoardTransport(board)
    reader, link, seen = identified(transport)
    recorder = Recorder(path, meta_of(link))
    reader.add_recorder(recorder)
    reader.send(Start(100))
    while board.now_us < 6_000_000:
        assert reader._thread.is_alive()
    reader.send(Start(100))
    transport.end_us = board.now_us + 2_000_000
    while board.now_us < transport.end_us:
        assert reader._thread.is_alive()
    reader.stop()
    recorder.close(RunEnd.FINISHED)
    assert [reason for (reason,) in rows(path, "SELECT reason FROM segment")] == [
        "opened",
        "started",
        "board restarted",
        "started",
    ]
    verdict = verify_recording(path)
    assert verdict.identical, verdict.difference
    assert seen.blocks


def test_a_reconnection_verifies(tmp_path):
    """A second link into the same recording begins with its own decoder state."""
    path = tmp_path / "run.boat"
    recorder = None
    for seed in (1, 2):
        transport = BoardTransport(VirtualBoard(seed=seed))
        reader, link, _ = identified(transport)
        recorder = recorder or Recorder(path, meta_of(link))
        seen = Seen()
        reader.add_recorder(recorder)
        reader.add_sink(seen)
        reader.send(Start(100))
        transport.end_us = transport.board.now_us + 2_000_000
        while transport.board.now_us < transport.end_us:
            assert reader._thread.is_alive()
        reader.stop()
    recorder.close(RunEnd.FINISHED)
    assert [row[0] for row in rows(path, "SELECT reason FROM segment")] == [
        "opened",
        "started",
        "reconnected",
        "started",
    ]
    verdict = verify_recording(path)
    assert verdict.identical, verdict.difference
    assert verdict.samples > 350


def tampered_sample(path: Path) -> None:
    db = sqlite3.connect(path)
    dtype = dtype_from_description(
        json.loads(db.execute("SELECT value FROM session WHERE key = 'sample_dtype'").fetchone()[0])
    )
    samples = np.frombuffer(db.execute("SELECT samples FROM block WHERE id = 2").fetchone()[0], dtype).copy()
    samples["lit"][5, 1] += 1
    db.execute("UPDATE block SET samples = ? WHERE id = 2", (samples.tobytes(),))
    db.commit()
    db.close()


@pytest.mark.fault(32, how="bytes, samples, times, gaps and overview changed", times=8)
@pytest.mark.parametrize(
    ("sql", "text"),
    [
        ("UPDATE chunk SET crc32 = crc32 + 1 WHERE id = 40", "raw bytes of chunk 40 do not match"),
        ("DELETE FROM chunk WHERE id = 50", "chunk 50 is missing"),
        ("DELETE FROM block WHERE id = (SELECT max(id) FROM block)", "the bytes hold more samples than the file"),
        ("UPDATE block SET n = n + 1 WHERE id = 3", "block 3 is for"),
        ("UPDATE block SET last_time_us = 0 WHERE id = 3", "times of block 3 differ"),
        ("UPDATE overview SET pressure_max_kpa = 99 WHERE id = 2", "row 2 of the overview"),
        ("DELETE FROM event WHERE kind = 'gap' AND id = (SELECT max(id) FROM event WHERE kind = 'gap')", "gap"),
        ("UPDATE chunk SET host_ns = host_ns + 1 WHERE id = 60", "host_ns is"),
    ],
)
def test_every_tampering_is_named(copy, sql, text):
    """Bytes, samples, times, gaps, overview: whatever was changed, the verdict names the first difference."""
    change(copy, sql)
    verdict = verify_recording(copy)
    assert not verdict.identical
    assert text in verdict.difference


def test_a_changed_sample_is_named_with_both_values(copy):
    """The reader learns which sample, which field, and what it should have been."""
    tampered_sample(copy)
    verdict = verify_recording(copy)
    n_before = rows(copy, "SELECT n FROM block WHERE id = 1")[0][0]
    assert verdict.difference.startswith(f"sample {n_before + 6}: lit is [")


def test_changed_bytes_with_a_forged_checksum_are_found_in_the_samples(copy):
    """With the chunk's checksum corrected, the frame's own fails, and then the samples differ."""
    sql = "SELECT id, raw FROM chunk WHERE direction = 0 AND id > 1000 AND length(raw) > 100 LIMIT 5"
    for number, raw in rows(copy, sql):  # five, because one might be in a frame that was damaged already
        forged = raw[:20] + bytes([raw[20] ^ 4 or 1]) + raw[21:]
        change(copy, "UPDATE chunk SET raw = ?, crc32 = ? WHERE id = ?", (forged, crc32(forged), number))
    assert not verify_recording(copy).identical


def test_stored_results_are_derived_again(copy):
    """With a function that analyses, its stored results must come out the same; unknown kinds are passed over."""
    add_result(copy, "mean", {"of": "n"}, {"n": 3})
    add_result(copy, "other", {}, {})
    same = verify_recording(copy, reanalyse=lambda _path, r: {"n": 3} if r.kind == "mean" else None)
    assert same.identical
    assert same.results == 1
    other = verify_recording(copy, reanalyse=lambda _path, r: {"n": 4} if r.kind == "mean" else None)
    assert "result 1 (mean)" in other.difference


def test_a_result_of_older_code_may_lack_keys_and_be_worded_otherwise(copy):
    """Keys are added and texts change from version to version; numbers, codes and what was stored do not."""
    add_result(copy, "mean", {"code": "old"}, {"n": 3, "items": [{"code": "few", "text": "too few"}]})

    def found(again: dict) -> str:
        return verify_recording(copy, reanalyse=lambda *_: again, code="new").difference

    assert found({"n": 3, "more": 1, "items": [{"code": "few", "text": "only 3", "subject": "s1"}]}) == ""
    assert "the first is n" in found({"n": 4, "items": [{"code": "few", "text": "too few"}]})
    assert "items[0].code" in found({"n": 3, "items": [{"code": "many", "text": "too few"}]})
    assert found({"items": [{"code": "few", "text": "too few"}]})


@pytest.mark.parametrize(
    ("read_utc", "corrected"),
    [
        ("2026-11-01T13:59:59.999+02:00", False),  # 11:59:59.999 UTC, a millisecond before the result
        ("2026-11-01T14:00:00.001+02:00", True),
        ("2026-11-01T06:59:59.999-05:00", False),
        ("2026-11-01T07:00:00.001-05:00", True),
        ("2026-11-01T11:59:59.999+00:00", False),
        ("2026-11-01T12:00:00.001+00:00", True),
    ],
)
def test_a_result_from_before_a_correction_is_left_out(copy, read_utc, corrected):
    """Readings carry the offset of where they were read, results are in UTC: as text they do not compare."""
    add_result(copy, "mean", {}, {"n": 3})
    change(copy, "INSERT INTO reading (utc, step, source) VALUES (?, 99, 'test')", (read_utc,))
    assert verify_recording(copy, reanalyse=lambda *_: {"n": 3}).results == (not corrected)


def test_equal_parameters_are_computed_once(copy):
    """As many results as a file may hold take the time of one."""
    for n in (3, 3, 4):
        add_result(copy, "mean", {"of": "n"}, {"n": n})
    computed = []
    difference = verify_recording(copy, reanalyse=lambda *_: computed.append(1) or {"n": 3}).difference
    assert difference.startswith("result 3 (mean)")
    assert len(computed) == 1


@pytest.mark.parametrize("text", ["[1]", "{", "[" * 100_000])
def test_a_result_that_is_no_table_is_named(copy, text):
    """Forged parameters: a difference, not a traceback."""
    add_result(copy, "mean", {}, {})
    change(copy, "UPDATE result SET parameters = ?", (text,))
    assert verify_recording(copy, reanalyse=lambda *_: {}).difference.startswith("result 1 (mean) ")


def test_a_recording_without_bytes_is_not_identical(copy):
    """An imported recording has nothing to be derived from, and is not called identical."""
    change(copy, "DELETE FROM chunk")
    assert "no raw bytes" in verify_recording(copy).difference


def test_memory_and_progress_are_bounded(recording):
    """Progress rises to the whole, and raising from it cancels."""
    seen: list[tuple[float, float]] = []
    verify_recording(recording, progress=lambda done, total: seen.append((done, total)))
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert seen[-1][0] == seen[-1][1]

    def cancel(_done: float, _total: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        verify_recording(recording, progress=cancel)


@pytest.mark.parametrize("channels", [True, False])
def test_a_text_profile_recording_verifies(tmp_path, monkeypatch, channels):
    """Lines of text are derived again with the recording's profile, from mid-stream too.

    A recording from before there were extra channels has none, whatever its profile names.
    """
    profile = PROFILE.read_text()
    link = TextConnection(load_profile(profile))
    text = b"".join(b"%d,%d,%.2f,2107,41,1988,37,23.4\n" % (10 * n, n, 0.1 * n) for n in range(400))
    link.receive(text[:1001], 1)
    more = {"vref_mv": 3300, "adc_bits": 12, "profile": profile}
    more |= {"channels": [["temperature", "degC"]]} if channels else {}
    meta = {"n_sensors": link.n_sensors, "sample_kind": link.sample_kind, "simulated": False, **more}
    path = tmp_path / "text.boat"
    recorder = Recorder(path, meta)
    recorder.attached(link.decoder_state())
    for at in range(1001, len(text), 97):
        data = text[at : at + 97]
        recorder(Block(at, data, events=tuple(link.receive(data, at))))
    recorder.close(RunEnd.FINISHED)
    segment = "INSERT INTO segment SELECT NULL, host_ns, 1000, reason, 0, decoder FROM segment"
    change(path, segment)
    change(path, segment)
    opening._profile_in.cache_clear()
    loaded = []
    monkeypatch.setattr(
        "boat_daq.engine.link.opening.load_profile", lambda text: loaded.append(text) or load_profile(text)
    )
    verdict = verify_recording(path)
    assert verdict.identical, verdict.difference
    assert 200 < verdict.samples < 400
    with closing(open_recording(path)) as db:
        dtype = session_dtype(read_session(db))
        samples = np.frombuffer(db.execute("SELECT samples FROM block").fetchone()[0], dtype)
    assert ("channel" in dtype.names) is channels
    assert not channels or (samples["channel"] == [23.4]).all()
    assert loaded == [profile + "\n"]  # once, and as a text: 50,000 segments took a hundred seconds


# ---- the commands ----------------------------------------------------------------------------------------------------


def run(command, *arguments: str):
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, list(arguments))


def test_the_command_prints_identical_and_exits_0_or_1(copy):
    """`verify` suits scripts: one line, one JSON object, one exit code."""
    from boat_daq.commands.recordings import verify

    assert run(verify, str(copy)).stdout.strip() == "identical"
    as_json = run(verify, str(copy), "--json")
    assert json.loads(as_json.stdout)["identical"] is True
    change(copy, "DELETE FROM chunk WHERE id = 50")
    failed = run(verify, str(copy), "--json")
    assert failed.exit_code == 1
    assert json.loads(failed.stdout) | {"seconds": 0} == {
        "identical": False, "difference": "chunk 50 is missing", "samples": 0, "chunks": 49, "results": 0, "seconds": 0,
            "missing": {"samples": [], "rows": []},
    }  # fmt: skip


def test_info_sums_a_recording_up(recording):
    """Times, rate, gaps and segments as the file holds them."""
    from boat_daq.commands.recordings import info

    shown = json.loads(run(info, str(recording), "--json").stdout)
    samples = rows(recording, "SELECT sum(n) FROM block")[0][0]
    assert shown["samples"] == samples
    assert shown["lost_samples"] == rows(recording, "SELECT sum(value) FROM event WHERE kind = 'gap'")[0][0]
    assert shown["rate_hz"] == pytest.approx((samples - 1) / shown["duration_s"])
    assert shown["rate_asked_hz"] == 200
    assert shown["status"] == "closed"
    assert shown["simulated"] is True
    text = run(info, str(recording)).stdout
    assert "SIMULATED" in text
    assert f"{samples} in " in text


def test_recover_prints_what_it_did(recording):
    """A closed recording: nothing to do, exit 0."""
    from boat_daq.commands.recordings import recover

    done = run(recover, str(recording), "--json")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["status"] == "closed"
    assert "nothing to do" in run(recover, str(recording)).stdout


def test_a_recording_without_a_decoder_state_is_opened_by_its_description(recording):
    """The link for a recording's bytes has its number of sensors without a HELLO among them."""
    db = open_recording(recording)
    meta = read_session(db)
    db.close()
    link = open_link(meta, None)
    assert isinstance(link, Connection)
    assert link.n_sensors == meta["n_sensors"] == 2


def test_a_recording_in_progress_is_compared_up_to_its_last_commit(tmp_path, monkeypatch):
    """A commit between the reading of the bytes and that of the samples gave a false alarm."""
    source = Source()
    recorder = begin(tmp_path / "run.boat", source)

    def decode_and_record(chunks, link):
        yield from decode_chunks(chunks, link)
        recorder(source.next(200_000))
        assert recorder.flush()

    recorder(source.next(1_000_000))
    assert recorder.flush()
    monkeypatch.setattr(verify, "decode_chunks", decode_and_record)
    verdict = verify_recording(tmp_path / "run.boat")
    monkeypatch.undo()
    recorder.close(RunEnd.STOPPED)
    assert (verdict.difference, verdict.samples) == ("", 100)
    assert verify_recording(tmp_path / "run.boat").samples == 120
