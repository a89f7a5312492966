"""VENT ALL: every session that answers is vented, whatever another one does."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading

import pytest

from boat_daq.engine.session import shared_vent
from boat_daq.engine.session.shared_vent import FOLDER, SharedVent, VentAnswer


@pytest.fixture
def join(tmp_path):
    """Return a function that takes part under a name, and the names that were vented."""
    joined, vented = [], []

    def take_part(name: str) -> SharedVent:
        joined.append(SharedVent(lambda: vented.append(name), lambda: name, tmp_path / "home"))
        return joined[-1]

    yield take_part, vented
    for each in joined:
        each.close()


def test_every_other_session_is_vented_and_confirms(join, tmp_path):
    """Three sessions: one asks, the two others vent and answer with their names; one that left is not asked."""
    take_part, vented = join
    one, two, three = (take_part(name) for name in ("SA1", "SA2", "SA3"))
    assert sorted(one.others()) == ["SA2", "SA3"]
    assert sorted(answer.name for answer in one.vent_others() if answer.vented) == ["SA2", "SA3"]
    assert sorted(vented) == ["SA2", "SA3"]
    three.close()
    assert two.others() == ["SA1"]
    assert all(
        path.stat().st_mode & 0o077 == 0 for path in (tmp_path / "home" / FOLDER).iterdir() if os.name == "posix"
    )


def test_a_stranger_vents_nothing(join, tmp_path):
    """Without the key a request is not answered: neither another user's nor a wrong one."""
    take_part, vented = join
    take_part("SA1")
    content = json.loads(next((tmp_path / "home" / FOLDER).iterdir()).read_text(encoding="utf-8"))
    for line in (b"vent\n", b"0000 vent\n", b"\xff\xfe\n"):
        with socket.create_connection(("127.0.0.1", content["port"]), timeout=5) as link:
            link.sendall(line)
            assert link.recv(100) == b""
    assert vented == []


def test_one_that_does_not_answer_delays_no_other(join, tmp_path, monkeypatch):
    """A program that hangs is named as not vented; broken files and those of ended programs are left out."""
    monkeypatch.setattr(shared_vent, "ANSWER_S", 0.3)
    take_part, vented = join
    one = take_part("SA1")
    take_part("SA2")
    hangs = socket.create_server(("127.0.0.1", 0))
    folder = tmp_path / "home" / FOLDER
    (folder / "hangs.json").write_text(json.dumps({"port": hangs.getsockname()[1], "key": "x"}), encoding="utf-8")
    (folder / "broken.json").write_text("{", encoding="utf-8")
    gone = socket.create_server(("127.0.0.1", 0))
    (folder / "gone.json").write_text(json.dumps({"port": gone.getsockname()[1], "key": "x"}), encoding="utf-8")
    gone.close()
    answers = one.vent_others()
    hangs.close()
    assert set(answers) == {VentAnswer("SA2", vented=True), VentAnswer("hangs", vented=False)}
    assert vented == ["SA2"]
    assert not (folder / "gone.json").exists()


@pytest.mark.parametrize("answer", ["name SA9", "refused SA9", "ventilated SA9"])
def test_only_its_own_answer_says_that_another_has_vented(join, tmp_path, answer):
    """A program that answers the request otherwise has not vented: its name is given, so that somebody looks."""
    take_part, _ = join
    one = take_part("SA1")
    other = socket.create_server(("127.0.0.1", 0))

    def reply() -> None:
        link, _ = other.accept()
        with link:
            link.recv(400)
            link.sendall(answer.encode() + b"\n")

    thread = threading.Thread(target=reply)
    thread.start()
    content = json.dumps({"port": other.getsockname()[1], "key": "x"})
    (tmp_path / "home" / FOLDER / "other.json").write_text(content, encoding="utf-8")
    assert one.vent_others() == [VentAnswer("SA9", vented=False)]
    thread.join(5)
    other.close()


@pytest.mark.parametrize("answers", [True, False])
def test_a_file_that_another_window_removes_first_is_no_failure(join, tmp_path, monkeypatch, answers):
    """Two windows ask at once about a process that was killed, its port free or another program's."""
    take_part, vented = join
    one = take_part("SA1")
    take_part("SA2")
    path = tmp_path / "home" / FOLDER / "gone.json"
    gone = socket.create_server(("127.0.0.1", 0))
    port = gone.getsockname()[1]
    path.write_text(json.dumps({"port": port, "key": "x"}), encoding="utf-8")
    connect = socket.create_connection

    def removed_meanwhile(address, timeout):
        if address[1] != port:
            return connect(address, timeout)
        path.unlink()
        if not answers:
            raise ConnectionRefusedError
        near, far = socket.socketpair()
        far.shutdown(socket.SHUT_WR)  # it closes without a word
        far.detach()
        return near

    monkeypatch.setattr(shared_vent.socket, "create_connection", removed_meanwhile)
    assert one.vent_others() == [VentAnswer("SA2", vented=True)]
    assert vented == ["SA2"]
    gone.close()


def test_many_killed_processes_hide_no_other(join, tmp_path):
    """Files of sixty, all before those of the session that is there, by name."""
    take_part, vented = join
    one, _ = take_part("SA1"), take_part("SA2")
    gone = socket.create_server(("127.0.0.1", 0))
    content = json.dumps({"port": gone.getsockname()[1], "key": "x"})
    gone.close()
    for n in range(60):
        (tmp_path / "home" / FOLDER / f"0-{n}.json").write_text(content, encoding="utf-8")
    assert one.vent_others() == [VentAnswer("SA2", vented=True)]
    assert vented == ["SA2"]
    assert len(list((tmp_path / "home" / FOLDER).iterdir())) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL and SIGSTOP")
def test_killed_process_is_left_out(join, tmp_path):
    """A second process takes part, vents on request while its main thread is busy, and is gone once it is killed."""
    take_part, _ = join
    one = take_part("SA1")
    code = (
        "import sys, pathlib, time\n"
        "from boat_daq.engine.session.shared_vent import SharedVent\n"
        "s = SharedVent(lambda: print('vented', flush=True), lambda: 'SA2', pathlib.Path(sys.argv[1]))\n"
        "print('ready', flush=True)\n"
        "time.sleep(float(sys.argv[2]))\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "home")]
    subprocess.run([*command, "0"], check=True, timeout=30)  # it ends though it closes nothing
    with subprocess.Popen([*command, "60"], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "ready\n"
        assert one.vent_others() == [VentAnswer("SA2", vented=True)]
        assert other.stdout.readline() == "vented\n"
        other.send_signal(signal.SIGKILL)
        other.wait()
        assert one.vent_others() == []
    assert all(thread.daemon for thread in threading.enumerate() if thread.name == "shared vent")
    assert threading.active_count() < 20


def test_unwritable_folder_ends_no_session(tmp_path) -> None:
    """A file stands where the folder would be: nobody finds this session, and it works."""
    (tmp_path / "home").write_text("")
    shared = SharedVent(lambda: None, lambda: "SA1", tmp_path / "home")
    try:
        assert shared.others() == []
        assert shared.vent_others() == []
    finally:
        shared.close()
