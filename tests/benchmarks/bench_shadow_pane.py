"""What a frame of the shadow's page costs while it moves, and a step of the optics' slider; against a screen's 60 a
second.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.benchmarks.lengths import benchmark_shadow, length
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring

BUDGET_MS = 1000 / 60
FRAMES = length(300, 10)
SKIPPED = length(20, 2)
HISTORY_S = 300.0


@pytest.fixture
def app_model(qtbot, tmp_path):
    """A model with five minutes of signals, a calibration and the shadow."""
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.gui.app import make_application
    from boat_daq.viewmodels.app_model import AppModel
    from boat_daq.workflows.live_conversion import LiveElongation

    make_application()
    session = RecordedSession(connected(), filled_ring(HISTORY_S))
    made = AppModel(session, tmp_path, tmp_path, UnitLibrary(tmp_path / "units"))

    def inverse(signal_mv):
        mm = (signal_mv.mean(axis=1) - 1638.0) / 40.0
        return LiveElongation(mm, np.full(mm.shape, 0.3), np.zeros(mm.shape, bool))

    made.live.inverse = inverse
    made.shadow.model = benchmark_shadow()
    made.shadow.prepare = lambda: None
    yield made
    made.close()


class RingPart:
    """Some samples in place of a ring: the frame shows their last."""

    def __init__(self, columns):
        self.columns = columns

    @property
    def newest_s(self):
        return float(self.columns["time_s"][-1])

    def view(self, since_s=None, last=None):
        return self.columns


class Watch:
    """Milliseconds of each step, by the clock and by the processor."""

    def __init__(self):
        self.wall, self.cpu = [], []

    def __enter__(self):
        self.began = time.perf_counter(), time.process_time()

    def __exit__(self, *_):
        self.wall.append(1000 * (time.perf_counter() - self.began[0]))
        self.cpu.append(1000 * (time.process_time() - self.began[1]))


def report(capsys, what, watch):
    """Print median and 99th percentile, and how often the latter fits into a frame of the screen."""
    wall, cpu = (np.percentile(values[SKIPPED:], [50, 99]) for values in (watch.wall, watch.cpu))
    with capsys.disabled():
        print(
            f"\n{what}: median {wall[0]:.2f} ms, 99th percentile {wall[1]:.2f} ms "
            f"(processor {cpu[0]:.2f}, {cpu[1]:.2f}), {BUDGET_MS / wall[1]:.1f} x within 60/s"
        )


@pytest.mark.parametrize("quantity", ["displacement", "strain"])
def test_frame_of_the_moving_shadow(qtbot, app_model, capsys, quantity):
    """Every frame another state: measured, solved by the reduced model, drawn and painted."""
    from boat_daq.gui.plotting.shadow_pane import ShadowPane

    pane = ShadowPane(app_model.shadow, app_model.services)
    qtbot.addWidget(pane)
    pane.resize(440, 660)
    pane.show()
    qtbot.waitExposed(pane)
    app_model.shadow.quantity = quantity
    ring, watch, drawn = filled_ring(HISTORY_S), Watch(), []
    whole = ring.view()
    for frame in range(FRAMES + SKIPPED):
        at = 10 + 37 * frame
        app_model.session.live.ring = RingPart({name: values[at : at + 10] for name, values in whole.items()})
        with watch:
            pane.draw()
            pane.view.repaint()
        drawn.append(pane.view.picture)
    assert len({id(picture) for picture in drawn}) > FRAMES * 0.9  # nearly every frame is another picture
    report(capsys, f"frame of the shadow, {quantity}", watch)


def test_frame_under_strong_vacuum(qtbot, app_model, capsys):
    """Held at about -40 kPa off the nominal curve: each state is looked up among those that come with the program;
    beside it the cost of finding them, which no frame has.
    """
    from boat_daq.gui.plotting.shadow_pane import ShadowPane
    from boat_daq.workflows.live_conversion import LiveElongation
    from tests.analysis.shadow.make_default_table import unstable_places

    model, looked, search = app_model.shadow.model, Watch(), Watch()
    for step in length(range(-42, -37), range(-42, -41)):
        with search:
            unstable = unstable_places(model, [step])
    app_model.shadow._unstable = unstable
    pane = ShadowPane(app_model.shadow, app_model.services)
    qtbot.addWidget(pane)
    pane.resize(440, 660)
    pane.show()
    qtbot.waitExposed(pane)
    for frame in range(FRAMES + SKIPPED):
        pressure, mm = -40.0 + 2.0 * np.sin(frame / 20), length(2.5, 0.0) + length(1.0, 0.1) * np.sin(frame / 7)
        part = {"time_s": np.arange(10.0), "pressure_kpa": np.full(10, pressure)} | dict.fromkeys(
            ("target_kpa", "s1_mv", "s2_mv"), np.full(10, pressure)
        )
        app_model.session.live.ring = RingPart(part)
        found = LiveElongation(np.full(1, mm), np.full(1, 0.3), np.zeros(1, bool))
        app_model.live.inverse = lambda signal_mv, found=found: found
        with looked:
            pane.draw()
            pane.view.repaint()
    assert pane.view.picture.corners.size
    report(capsys, "frame of the shadow under strong vacuum", looked)
    with capsys.disabled():
        print(f"search for the unstable places of one pressure, in a job: {np.median(search.cpu):.0f} ms of processor")


def test_step_of_the_optics_slider(qtbot, app_model, capsys):
    """From one state to the next: four polylines of some thousand points drawn and painted."""
    from boat_daq.gui.models.optics_page import OpticsPage
    from boat_daq.viewmodels.models.optics import PAPER_DESIGN, trace_design

    page = OpticsPage(app_model.optics, app_model.services)
    qtbot.addWidget(page)
    app_model.optics.result = trace_design(PAPER_DESIGN, 250)
    page.resize(1150, 660)
    page.show()
    qtbot.waitExposed(page)
    page.refresh(app_model.snapshot)
    watch, painted = Watch(), {}
    for step in range(length(150, 15 + SKIPPED)):
        with watch:
            page.slider.setValue(step % 15)
            picture = page.scene.view.grab()  # painted whole, into a picture
        painted[step % 15] = picture.toImage()
    assert len({bytes(image.constBits()) for image in painted.values()}) == 15  # every state is another picture
    report(capsys, "step of the optics slider", watch)
