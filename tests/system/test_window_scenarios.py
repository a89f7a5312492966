"""Scenarios of the real window, under Xvfb: from the first start to a calibration, a report, a recovery."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from protocol.recording import open_recording

ROOT = Path(__file__).resolve().parents[2]
PLAY = "import sys; from tests.system.window_scenarios import play; play(*sys.argv[1:])"
"""No module: the helper processes would import it, and with it the window."""
SHOTS = "BOAT_DAQ_SHOTS"  # a folder for the screenshots

pytestmark = pytest.mark.skipif(
    shutil.which("Xvfb") is None, reason="Xvfb is not installed: no screen to open a window on"
)


@pytest.fixture(scope="module", params=["1280x800"])
def screen(request):
    """A screen of that size; yields its DISPLAY."""
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{request.param}x24", "-nolisten", "tcp"],
        pass_fds=(write,), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(write)
    with os.fdopen(read) as pipe:
        display = pipe.readline().strip()
    yield f":{display}"
    server.terminate()
    server.wait()


@pytest.fixture
def run_scenario(screen, tmp_path):
    """Return a function that runs a scenario in its own process and home and returns what it printed."""

    def go(name: str, *, expect: int = 0, timeout_s: float = 220) -> dict[str, object]:
        folder = Path(os.environ.get(SHOTS, str(tmp_path)))
        folder.mkdir(parents=True, exist_ok=True)
        home = tmp_path / "home"
        home.mkdir(exist_ok=True)
        env = os.environ | {
            "DISPLAY": screen, "QT_QPA_PLATFORM": "xcb", "BOAT_DAQ_HOME": str(home), "PYTHONPATH": str(ROOT),
        }  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", PLAY, name, str(folder)],
            cwd=home, env=env, capture_output=True, text=True, timeout=timeout_s,
        )  # fmt: skip
        assert done.returncode == expect, done.stdout + done.stderr
        return json.loads(done.stdout.splitlines()[-1]) if expect == 0 else {}

    return go


@pytest.mark.nightly
@pytest.mark.timeout(240)
@pytest.mark.parametrize("name", ["first_session", "first_session:sampled"])
def test_first_start_to_accepted_calibration_and_report(run_scenario, capsys, name):
    """Connect the virtual board, run a cycle, type every reading, accept, show millimetres, make a report."""
    seen = run_scenario(name)
    with capsys.disabled():
        print(f"\nwhole session, seconds from the start: {seen['times']}")
    assert seen["readings"] == 19
    assert seen["report"] == "%PDF-"
    assert min(seen["r2"]) > 0.99
    assert seen["sensitivity"] == pytest.approx([39.3, 29.2], rel=0.05)
    assert seen["simulated"] is True


def test_killed_session_is_offered_and_recovered(run_scenario, capsys):
    """After a kill in a run the next start offers recovery; a click closes the file, another arms the rest."""
    run_scenario("killed", expect=-9)
    seen = run_scenario("recover")
    with capsys.disabled():
        print(f"\nrecovery, seconds from the start: {seen['times']}")
    assert "was not closed" in seen["offer"]
    assert seen["status"] == ["recovered"]
    assert seen["samples"] >= 1200 - 400  # 12 s of board time, less 0.2 s of wall time at 20x
    assert (seen["same_file"], seen["target"]) == (True, False)  # no target before Start


@pytest.mark.nightly
@pytest.mark.parametrize("carrier", ["pty", "tcp"])
def test_unplugged_board_is_reported_and_found_again(run_scenario, capsys, carrier):
    """The loss is reported and no sample lost; the board's return is shown, and no pressure until requested."""
    seen = run_scenario(f"unplug:{carrier}")
    with capsys.disabled():
        print(
            f"\n{carrier}: shown {seen['shown_s']} s after the loss, back {seen['back_s']} s after the board was there"
        )
    assert seen["message"]
    assert seen["state"] == "fault"
    assert seen["targets"] == [False, False]
    assert seen["at_rest_kpa"] < 2.0
    with closing(open_recording(Path(seen["recording"]))) as db:
        samples = [n for (n,) in db.execute("SELECT sum(n) FROM block GROUP BY segment ORDER BY segment")]
        (status,) = db.execute("SELECT value FROM session WHERE key = 'status'").fetchone()
    assert samples[0] >= 100 * seen["recorded_s"] - 1
    assert sum(samples[1:]) >= 300
    assert "closed" in status


@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("xdotool") is None, reason="xdotool is not installed: no mouse for the screen")
def test_session_by_mouse_takes_ten_clicks(run_scenario, capsys):
    """From the first start to the PDF by mouse and keyboard of the screen, with at most ten clicks."""
    seen = run_scenario("by_mouse")
    with capsys.disabled():
        print(
            f"\nby mouse: {seen['clicks']} clicks, {seen['keys']} keys for {seen['readings']} readings: {seen['times']}"
        )
    assert (seen["readings"], seen["report"]) == (37, "%PDF-")
    assert seen["clicks"] <= 10


@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("xdotool") is None, reason="xdotool is not installed: no mouse for the screen")
def test_quick_trial_takes_fewer_than_five_clicks(run_scenario, capsys):
    """From the first start to the PDF of a simulated calibration."""
    seen = run_scenario("trial")
    with capsys.disabled():
        print(f"\nquick trial: {seen['clicks']} clicks: {seen['times']}")
    assert seen["report"] == "%PDF-"
    assert seen["clicks"] < 5


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_hundred_cycles_are_shown_with_their_figures(run_scenario, capsys):
    """The page shows cycles during the run and all of them at its end, with figures near the specimen's."""
    seen = run_scenario("hundred_cycles", timeout_s=800)
    with capsys.disabled():
        print(f"\na hundred cycles: {seen['times']}, {seen['figures']}")
    assert seen["ended"] == "finished"
    assert 2 <= seen["while_running"] < 100
    assert [f["cycles"] for f in seen["figures"]] == [100, 100]
    assert [f["snr_db"] for f in seen["figures"]] == pytest.approx([44.8, 45.3], abs=3.0)
    assert {f["unit"] for f in seen["figures"]} == {"mV/kPa"}
    assert seen["lost"] == 0


@pytest.mark.skipif(
    shutil.which("xdotool") is None, reason="xdotool is not installed: no key can be sent to the screen"
)
def test_vent_key_vents_in_every_state(run_scenario, capsys):
    """F4 vents from the page, over an open menu, from a field, and while a helper process computes."""
    seen = run_scenario("vent")
    with capsys.disabled():
        print(f"\nvented, seconds from the key: {seen['vented_s']}")
    assert set(seen["vented_s"]) == {"page", "menu", "field", "working"}
