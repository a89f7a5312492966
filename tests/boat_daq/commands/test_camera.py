"""`boat-daq camera` and `analyze --video`, through the command line."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from pandas import read_csv

from analysis.data.load import load_recording
from analysis.figures.stored_results import reproduce
from boat_daq.commands.analyze import _filmed
from boat_daq.engine.camera.source import VideoStore
from boat_daq.engine.simulator.picture import CameraScene, Renderer
from boat_daq.workflows import camera_tracking
from boat_daq.workflows.camera_tracking import CameraChoice, camera_choice
from protocol.base.optional import optional
from tests.analysis.boat_builder import write_boat
from tests.analysis.tracking.filmed_run import LEVELS, filmed_run, with_camera
from tests.boat_daq.commands.calls import call, program
from tests.boat_daq.engine.simulator.checkerboard import checkerboard

SCENE = CameraScene(width=160, height=120, px_per_mm=5.0)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a video of two seconds in which the tip moves by 0.5 mm."""
    path = tmp_path_factory.mktemp("video") / "run.mkv"
    store, renderer = VideoStore(path), Renderer(SCENE)
    for n, x in enumerate(np.concatenate([np.zeros(20), np.linspace(0.0, 0.5, 20)])):
        store.write(renderer.frame(n, np.array([x]), n / 30))
    store.close()
    return path


def test_track_gives_every_frame(video: Path, tmp_path: Path) -> None:
    """Value and uncertainty, or null; the same in a table; the grid gives the scale where no side is stated."""
    found = call("camera", "track", video, "--mark-mm", 8, "--out", tmp_path / "x.csv")
    assert (found["frames"], found["valid"], found["dropped"]) == (40, 26, 0)
    assert found["elongation_mm"][0] is None
    assert found["elongation_mm"][-1] - found["elongation_mm"][16] == pytest.approx(0.5, abs=0.02)
    assert found["warnings"] == [{"code": "learning", "subject": "camera", "text": "14 frames"}]
    rows = (tmp_path / "x.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "time_s,elongation_mm,u_mm,fault"
    assert rows[1] == "0.000000,,,learning"
    assert len(rows) == 41


def test_a_camera_may_be_a_file(video: Path, tmp_path: Path) -> None:
    """It names the source beside it, a number or an address, and the marks; an option precedes it."""
    (video.parent / "camera.toml").write_text('source = "run.mkv"\nmark_mm = 8\nu_mark_mm = 0.05\nvideo = "out.avi"')
    choice = camera_choice(str(video.parent / "camera.toml"), "SA1")
    assert (choice.source, choice.mark_mm, choice.u_mark_mm, choice.unit) == (str(video), 8, 0.05, "SA1")
    assert choice.video == video.parent / "out.avi"
    assert camera_choice(str(video.parent / "camera.toml"), mark_mm=9).mark_mm == 9
    (tmp_path / "number.toml").write_text("source = 0")
    assert camera_choice(str(tmp_path / "number.toml")) == camera_choice("0") == CameraChoice("0")


def test_marks_that_contradict_the_grid_are_refused(video: Path) -> None:
    """6 mm are stated, the grid shows 8."""
    ended = program("camera", "track", video, "--mark-mm", 6)
    assert ended.code == 1
    assert "by the millimetre grid in the picture, 6 mm are stated" in ended.err


def test_a_video_without_marks_is_refused(tmp_path: Path) -> None:
    """Cause and remedy; so is a file that is not a video, and a lens that is none."""
    store = VideoStore(tmp_path / "blank.mkv")
    rng = np.random.default_rng(0)
    for _ in range(5):
        store.write(rng.integers(0, 255, (120, 160), np.uint8))
    store.close()
    (tmp_path / "text.mkv").write_text("text", encoding="utf-8")
    for name, given in (
        ("lens", 'source = "blank.mkv"\nlens = "text.mkv"'), ("side", "mark = 8"), ("none", "mark_mm = 8"),
        ("text", 'source = "blank.mkv"\nu_mark_mm = "wide"'),
    ):  # fmt: skip
        (tmp_path / f"{name}.toml").write_text(given, encoding="utf-8")
    for words, cause in (
        (("blank.mkv",), "a mark is not in the picture, or is covered in 5 of 5 frames"),
        (("text.mkv",), "text.mkv is not a video"),
        (("lens.toml",), "is not a lens"),
        (("side.toml",), "side.toml has 'mark', which is not a parameter of the camera"),
        (("none.toml",), "names no source"),
        (("text.toml",), "u_mark_mm = 'wide' is not possible"),
        (("blank.mkv", "--mark-mm", 900), "marks of 900 mm are not possible"),
    ):
        ended = program("camera", "track", tmp_path / words[0], *words[1:])
        assert ended.code == (2 if "marks of" in cause else 1)
        assert cause in ended.err


def test_a_lens_is_calibrated_and_stored_with_the_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From pictures of a board to the unit's file."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    scene = CameraScene(width=320, height=240, px_per_mm=10.0)
    for n, tilt in enumerate((-20.0, -10.0, 0.0, 10.0, 20.0)):
        assert optional("cv2").imwrite(str(tmp_path / f"{n}.png"), checkerboard(scene, tilt))
    pictures = sorted(tmp_path.glob("*.png"))
    lens = call("camera", "calibrate", *pictures, "--pitch", 3, "--out", tmp_path / "lens.json", "--unit", "SA1")
    assert lens["views"] == 5
    assert lens["reprojection_px"] < 0.2
    from boat_daq.engine.settings import UnitLibrary

    assert UnitLibrary().load("SA1").lens["matrix"] == lens["matrix"]


def test_marks_and_cameras(tmp_path: Path) -> None:
    """A sheet is written; the cameras of this computer are listed."""
    sheet = tmp_path / "marks.pdf"
    assert call("camera", "marks", "--out", sheet) == {"file": str(sheet), "mark_mm": 10.0}
    assert sheet.read_bytes().startswith(b"%PDF")
    assert isinstance(call("camera", "list"), list)


def test_options_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    """Usage errors, before anything is opened."""
    for words in (
        ("board", "--pty", "--video", "v.mkv", "--mjpeg", "0"),
        ("board", "--pty", "--camera", "tilt_deg=3"),
        ("camera", "calibrate", "a.png", "--out", "l.json", "--corners", "8"),
    ):
        assert program(*words).code == 2


def test_a_video_of_a_run_is_kept_in_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Tracked once: a later analysis, report and export see it; another video replaces it, which is said."""
    run, path = filmed_run((*LEVELS, *LEVELS[-2::-1]), dwell_s=1.0), tmp_path / "run.boat"
    steps = run.recording.steps
    marks = zip(*(steps[name] for name in ("id", "number", "cycle", "branch", "target_kpa")), strict=True)
    times = ((steps[name] * 1e6).round().astype(int) for name in ("started_s", "ended_s"))
    write_boat(path, run.recording, steps=[(*a, *b) for a, b in zip(marks, zip(*times, strict=True), strict=True)])
    seen = with_camera(run).camera
    assert seen is not None
    monkeypatch.setattr(camera_tracking, "track_video", lambda choice, progress=None: (seen, {"source": choice.source}))
    found = call("analyze", path, "--video", "a.mkv", "--no-mcmc", "--no-shadow")
    assert found["camera"]["source"] == "a.mkv"
    with closing(sqlite3.connect(path)) as db:
        kept = db.execute("SELECT parameters, content FROM result ORDER BY id").fetchall()
    assert reproduce(path, json.loads(kept[-1][0])) == json.loads(kept[-1][1])
    recording = load_recording(path)
    assert recording.camera is not None
    assert _filmed(recording, path, "b.mkv", store=False)[1] is False
    assert "the result is not stored, nor are the readings of the video" in capsys.readouterr().err
    assert load_recording(path).meta["camera"]["source"] == "a.mkv"
    recording, stored = _filmed(recording, path, "b.mkv", store=True)
    assert (recording.meta["camera"]["source"], stored) == ("b.mkv", True)
    assert "the readings of b.mkv count before those of the video a.mkv, whose readings" in capsys.readouterr().err
    call("export", path, "--format", "csv", "--out", tmp_path / "run.csv")
    exported = read_csv(tmp_path / "run.csv", comment="#")
    known = exported[exported["camera_mm"].notna()]
    assert len(known) > 0.9 * len(exported)
    assert np.abs(known["camera_mm"] - run.elongation_mm(known["time_s"].to_numpy())).max() < 0.05
    assert (known["camera_u_mm"] > 0).all()
    assert exported["elongation_mm"].notna().mean() > 0.5  # by the calibration of the camera's plateaus
