"""A camera's record over its run: delay, rest, plateaus, warnings; and the analysis with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.data.recording import Recording
from analysis.tracking.run import filmed
from analysis.warning import WarningCode
from tests.analysis.tracking.filmed_run import LEVELS, FilmedRun, camera_analysis, filmed_run, with_camera


@pytest.fixture(scope="module")
def run() -> FilmedRun:
    """Return one cycle of five levels."""
    return filmed_run((*LEVELS, *LEVELS[-2::-1]), dwell_s=1.5)


def test_delay_and_rest_are_removed(run: FilmedRun) -> None:
    """Frames late by 60 ms from a camera that began at 1 mm."""
    film = filmed(with_camera(run))
    assert film.delay is not None
    assert film.delay.delay_s == pytest.approx(0.06, abs=0.01)
    assert film.rest_mm == pytest.approx(1.0, abs=0.002)
    record = film.record
    assert np.abs(record.elongation_mm - run.elongation_mm(record.time_s)).max() < 0.02
    assert film.warnings == ()


def test_a_camera_that_missed_rest_and_lost_marks_is_warned_of(run: FilmedRun) -> None:
    """Each by its code."""
    recording = with_camera(run, first_s=4.0)
    assert recording.camera is not None
    faulty = np.arange(recording.camera.time_s.size) < 10
    record = replace(
        recording.camera,
        elongation_mm=np.where(faulty, np.nan, recording.camera.elongation_mm),
        fault=np.where(faulty, "covered", ""),
    )
    codes = [warning.code for warning in filmed(replace(recording, camera=record)).warnings]
    assert codes == [WarningCode.CAMERA_REST, WarningCode.CAMERA_NO_VALUE]


def test_a_camera_of_another_run_is_warned_of(run: FilmedRun) -> None:
    """An elongation that falls with pressure is not of this unit."""
    recording = with_camera(run)
    assert recording.camera is not None
    record = replace(recording.camera, elongation_mm=-recording.camera.elongation_mm)
    codes = [warning.code for warning in filmed(replace(recording, camera=record)).warnings]
    assert WarningCode.CAMERA_CONTRADICTS in codes


def test_analysis_calibrates_with_the_camera(run: FilmedRun) -> None:
    """Plateaus without a typed reading, the continuous record beside them, the scale in the budget."""
    analysis = analyse(with_camera(run), options=Options(mcmc=False))
    (first, second) = analysis.sensors
    assert first.calibration is not None
    assert second.calibration is not None
    truth = {"s1": 39.3206, "s2": 29.2161}  # end to end over the whole range; -30 to 50 kPa here
    assert analysis.elongations is not None
    assert analysis.elongations.source == "camera"
    assert np.isfinite(analysis.elongations.elongation_mm).all()
    assert analysis.camera is not None
    for sensor, continuous in zip(analysis.sensors, analysis.camera.sensors, strict=True):
        plateaus = sensor.figures["sensitivity_mv_per_mm"].value
        assert continuous.sensitivity_mv_per_mm == pytest.approx(plateaus, rel=0.02)
        assert plateaus == pytest.approx(truth[sensor.name], rel=0.06)
        assert sensor.calibration is not None
        assert sensor.calibration.r2 > 0.9997
        assert 0.0 < continuous.hysteresis_percent_fso < 3.0
    assert analysis.to_json()["camera"]["valid"] == analysis.camera.film.record.time_s.size
    assert analysis.budgets is not None
    names = [component.name for component in analysis.budgets.budgets[0].components]
    assert any("scale" in name for name in names)


def test_a_reading_of_the_operator_counts_before_the_camera(run: FilmedRun) -> None:
    """And a withdrawn one leaves the plateau without."""
    recording = with_camera(run)
    rows = [(1, "", 3, 1.25, 0.5, "typed", "", ""), (2, "", 4, None, 0.5, "typed", "", "")]
    readings = recording.readings.reindex(range(2))
    readings[:] = rows
    analysis = analyse(replace(recording, readings=readings), options=Options(mcmc=False))
    assert analysis.elongations is not None
    steps = [plateau.step for plateau in analysis.plateaus]
    by_step = dict(zip(steps, analysis.elongations.elongation_mm.tolist(), strict=True))
    assert by_step[3] == 1.25
    assert np.isnan(by_step[4])
    assert np.isfinite([by_step[1], by_step[2]]).all()


@pytest.mark.nightly
def test_a_tracked_video_calibrates_within_a_third_of_a_percent() -> None:
    """The whole way from pictures to sensitivities, at 10 px/mm."""
    levels = (50, 35, 20, 5, -10, -25, -40)
    analysis = analyse(
        filmed_run((*levels, *levels[-2::-1]), dwell_s=2.0).filmed(begin_s=0.3), options=Options(mcmc=False)
    )
    for sensor, truth in zip(analysis.sensors, (39.3206, 29.2161), strict=True):
        assert sensor.figures["sensitivity_mv_per_mm"].value == pytest.approx(truth, rel=0.003)
        assert sensor.calibration is not None
        assert sensor.calibration.r2 > 0.9999


def test_a_plateau_that_ends_with_the_recording_is_read(run: FilmedRun) -> None:
    """Its last sample is the recording's."""
    last = int(np.argmax(run.recording.time_s > run.recording.steps["ended_s"].iloc[-1] - 0.3))
    whole = with_camera(run)
    short = Recording.from_arrays(
        whole.time_s[:last], whole.pressure_kpa[:last], whole.signal_mv[:last], steps=whole.steps, meta=whole.meta
    )
    analysis = analyse(replace(short, camera=whole.camera), options=Options(mcmc=False))
    assert analysis.elongations is not None
    assert np.isfinite(analysis.elongations.elongation_mm[-1])


def test_hysteresis_of_every_cycle_is_over_elongation() -> None:
    """Of the continuous record, not lifted by the noise of single bins: the unit's own is 0.80 and 0.48 % FSO."""
    camera = camera_analysis().camera
    assert camera is not None
    assert camera.cycles == (1, 2)
    for one, truth in zip(camera.sensors, (0.80, 0.48), strict=True):
        assert one.per_cycle == pytest.approx((truth, truth), abs=0.35)
        assert one.hysteresis_percent_fso == pytest.approx(truth, abs=0.25)
        assert np.isfinite(one.by_speed).all()
        assert one.by_speed[:, 0].min() < -0.3 < 0.3 < one.by_speed[:, 0].max()
    content = camera.as_json()
    assert content["cycles"] == [1, 2]
    assert len(content["sensors"][0]["loop"]["signal_mv"]) == 2
    assert set(content["sensors"][0]["by_speed"][0]) == {"speed_mm_per_s", "signal_mv", "u_mv"}


@pytest.mark.parametrize("seen_at_rest", [True, False])
def test_a_camera_that_began_anew_has_its_own_rest(run: FilmedRun, *, seen_at_rest: bool) -> None:
    """After a break it counts from another position: at rest it is measured again, else its frames are void."""
    recording = with_camera(run)
    assert recording.camera is not None
    record, low = recording.camera, float(recording.time_s[np.argmin(recording.pressure_kpa)])
    vented = np.abs(recording.time_s - low) < 6.0 if seen_at_rest else np.zeros(recording.n, bool)
    pressure = np.where(vented, 0.0, recording.pressure_kpa)
    again = record.time_s > low - 1.0
    fault = np.where(again & (record.time_s < low - 0.5), "learning", "")
    x = np.where(fault != "", np.nan, record.elongation_mm + np.where(again, 5.0, 0.0))
    record = replace(record, elongation_mm=x, fault=fault)
    film = filmed(replace(recording, camera=record, pressure_kpa=pressure))
    later = film.record.time_s > low + 6.0
    assert [w.text for w in film.warnings if w.code is WarningCode.CAMERA_REST and "began anew" in w.text] != []
    if not seen_at_rest:
        assert not film.record.valid[later].any()
        assert film.record.faults["no_rest"] > later.sum() / 2
        return
    rest_mm = run.elongation_mm(np.array([low + 5.0]))[0]
    true_mm = run.elongation_mm(film.record.time_s[later])
    assert film.record.elongation_mm[later] + rest_mm == pytest.approx(true_mm, abs=0.3)
