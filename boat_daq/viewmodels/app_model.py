"""The application without Qt: the session, one view model a page, and the services they share.

Rules: parents know children, never the reverse. The window calls `tick()` from its one timer; nothing is pushed into
it, so threads meet Qt nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from analysis.fidelity import Fidelity
from boat_daq.engine.bug_report import write_bug_report
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.viewmodels.common.notices import Notice, Notices, SessionMessages, Severity
from boat_daq.viewmodels.common.open_windows import OpenWindows
from boat_daq.viewmodels.common.preferences import Precision, Preferences, UnitChoice
from boat_daq.viewmodels.common.services import Page, Panel, Place, Services, Tab, UndoHistory
from boat_daq.viewmodels.live.camera import CameraModel
from boat_daq.viewmodels.live.connection import ConnectionModel
from boat_daq.viewmodels.live.layout import Layouts
from boat_daq.viewmodels.live.live_model import LiveModel, OverlayModel
from boat_daq.viewmodels.live.outlets import OutletsModel
from boat_daq.viewmodels.live.readings import ReadingsModel
from boat_daq.viewmodels.live.run_model import CalibrationOffer, ResumeRun, RunModel
from boat_daq.viewmodels.live.sequence import SequenceModel, why_no_command
from boat_daq.viewmodels.live.shadow_live import ShadowLive, ShadowMonitor
from boat_daq.viewmodels.live.unit_in_use import DisagreementWatch, UnitInUse
from boat_daq.viewmodels.models.optics import OpticsModel
from boat_daq.viewmodels.models.tradeoff import TradeoffModel
from boat_daq.viewmodels.results.calibration import CalibrationModel
from boat_daq.viewmodels.results.csv_import import CsvImport
from boat_daq.viewmodels.results.repeatability import RepeatabilityModel
from boat_daq.viewmodels.results.run_result import RunResult
from boat_daq.viewmodels.results.runs import RunsModel
from boat_daq.viewmodels.settings_model import SettingsModel
from boat_daq.workflows.acceptance import Lack, lacking
from boat_daq.workflows.calibration_in_force import NotCalibrated
from boat_daq.workflows.jobs import Job, JobRunner, prepare
from boat_daq.workflows.live_conversion import compile_rest, lacks_code
from boat_daq.workflows.run_analysis import load_analysis
from boat_daq.workflows.unit_control import NotIdentified
from protocol.base.errors import RequestError
from protocol.base.units import ShownUnits


class AppModel:
    """The view models of one window, with the stored units unless others are given."""

    def __init__(self, session: Session, folder: Path, recordings: Path, units: UnitLibrary | None = None) -> None:
        self.session, self.folder, self.units = session, folder, units or UnitLibrary()
        self.notices = Notices()
        self.undo = UndoHistory(self.notices.inform)
        self.preferences = Preferences(folder, partial(self.notices.add, Severity.WARNING))
        self.jobs = JobRunner()
        self.services = Services(self.notices, self.preferences, self.undo, recordings)
        self.connection = ConnectionModel(session, self.preferences, self.units)
        self.windows = OpenWindows(session, lambda: self.unit.name(self.snapshot), self.notices, folder)
        self.layouts = Layouts(self.preferences, self.undo, lambda: self.unit.name(self.snapshot))
        self.live = LiveModel(lambda: session.live.ring, layout=lambda: self.layouts.current)
        self.overlay = OverlayModel(lambda: session.live.ring, session.steps_on_screen, self.live.time_of)
        self.shadow = ShadowLive(self.live, self.jobs)
        self.disagreement = DisagreementWatch(self.live)
        self.monitor = ShadowMonitor(lambda: self.shadow.model, self.overlay)
        self.sequence = SequenceModel(
            session, self.undo, self.preferences, lambda: self.unit.regulator(self.snapshot, session.mv_per_count)
        )  # fmt: skip
        self.readings = ReadingsModel(session, self.undo, self.shadow.nominal_at)
        self.camera = CameraModel(session, self.preferences, lambda: self.connection.virtual_camera)
        self.unit = UnitInUse(self.units, self.connection, self.live)
        self.outlets = OutletsModel(session, self.preferences, self.unit, lambda: self.sequence.plans, recordings)
        self.runs = RunsModel(recordings, self.units, self.jobs, self.notices, self.undo, self._renamed)
        self.csv_import = CsvImport(recordings, self.jobs, self.preferences, self._imported)
        self.repeatability = RepeatabilityModel(self.jobs)
        self.calibration = CalibrationModel(
            session, self.units, self.jobs, self.services, self.runs.newest, self._show_by_kind
        )
        self.optics = OpticsModel(self.jobs, self.notices)
        self.tradeoff = TradeoffModel(self.jobs, folder)
        self.run = RunModel(
            session,
            self.connection,
            self.live,
            self.sequence,
            self.readings,
            ResumeRun(session, self.sequence, self.runs.resume, self.services),
            CalibrationOffer(
                self.readings, self.calibration.analyse_current, partial(prepare, load_analysis), self.services
            ),
            self.services,
        )
        self.settings = SettingsModel(session, self.units, folder, self.undo)
        self.unit_choice = UnitChoice(self.preferences, self._use_units)
        self.precision = Precision(self.preferences, self._use_fidelity)
        self.notices.offers = {
            NotCalibrated: ("Go to Results", lambda: self.services.show(Tab.CALIBRATION)),
            NotIdentified: ("Prepare it", partial(self.notices.attempt, self._prepare_control)),
        }
        self._disagreeing: Notice | None = None
        self._alarms: list[Notice] = []  # of the run that is monitored
        self._continuous = False  # whether a repeatability run is in progress
        self.snapshot = session.snapshot()
        self._messages = SessionMessages(self.notices, self.snapshot)

    def _prepare_control(self) -> None:
        """Identify the unit from the run of its calibration in force."""
        path = self.services.recordings / self.unit.recording
        if not path.is_file():
            raise RequestError(f"{path} is gone", "Put it back, or accept the calibration of another run.")
        self.calibration.prepare_control(path)

    def _use_units(self, units: ShownUnits) -> None:
        self.live.units = self.runs.shown_units = self.sequence.units = self.readings.units = self.notices.units = units
        self.camera.units = units
        self.calibration.show_units(units)

    def _use_fidelity(self, chosen: Fidelity) -> None:
        self.optics.set_fidelity(chosen)
        self.calibration.fidelity = self.repeatability.fidelity = self.runs.fidelity = chosen

    def compile_ahead(self) -> None:
        """Compile what is not in the cache in helper processes."""
        self.jobs.start("missing code", Job("Preparing the analysis", lacks_code), self._compile_missing)

    def _compile_missing(self, job: Job) -> None:
        if job.result:
            compile_once = Job("Compiling (first start only)", compile_rest)
            compile_once.counts = "functions"
            self.jobs.start("compiled code", compile_once, lambda _: None)

    def tick(self) -> SessionSnapshot:
        """Take a snapshot and the results of background work; return the snapshot."""
        snapshot = self.snapshot = self.session.snapshot()
        attempt = self.notices.attempt
        attempt(self.connection.tick)
        self.jobs.poll()
        self.runs.follow(snapshot)
        self.runs.poll()
        self.shadow.poll()
        self.monitor.follow(snapshot, self.unit.conversion)
        attempt(self._report_alarms)
        attempt(self._report_disagreement)
        if self.connected():
            self.shadow.prepare()
        self.repeatability.follow(snapshot)
        self._follow_kind()
        self.run.calibration.follow(snapshot, analysing=self.calibration.working)
        self.run.resumption.follow(snapshot)
        attempt(lambda: self.run.follow(snapshot))
        attempt(lambda: self.camera.follow(snapshot))
        attempt(lambda: self.unit.follow(snapshot, self.calibration.units_revision))
        attempt(lambda: self.outlets.follow(snapshot))
        self._messages.follow(snapshot)
        self.windows.follow()
        return snapshot

    def _follow_kind(self) -> None:
        before, self._continuous = self._continuous, self.repeatability.in_progress
        if self._continuous and not before:
            self.services.choose(Tab.REPEATABILITY)

    def _report_alarms(self) -> None:
        sentences = self.monitor.poll()
        while self._alarms and not self.monitor.alarms:  # another run is followed
            self.notices.dismiss(self._alarms.pop())
        remedy = "Check tubing, zero and the actuator before the next run."
        self._alarms += [self.notices.add(Severity.WARNING, sentence, remedy) for sentence in sentences]

    def _report_disagreement(self) -> None:
        found = self.disagreement.follow(connected=self.connected())
        if found is not None or self.disagreement.over:
            self.notices.dismiss(self._disagreeing)
            self._disagreeing = None
        if found is not None:
            self._disagreeing = self.notices.add(Severity.WARNING, *found)

    def connected(self) -> bool:
        """Return whether samples arrived at the last tick."""
        return self.snapshot.link is LinkState.UP

    def why_not(self) -> str:
        """Return why no board can be recorded or commanded."""
        return why_no_command(self.snapshot)

    def title(self) -> str:
        """Return the window's title; it shows a simulated board too."""
        simulated = "SIMULATED" if self.snapshot.simulated else ""
        recording = self.snapshot.recording.name if self.snapshot.recording is not None else ""
        return " \u2013 ".join(filter(None, ("boat-daq", simulated, recording)))

    def analysed_path(self, place: Place) -> Path | None:
        if place is Tab.REPEATABILITY and self.repeatability.result is not None:
            return Path(self.repeatability.result.path)
        return self.calibration.last_path

    def analysed_curve(self, place: Place) -> str:
        """Return the curve that was chosen for the result on a page; empty for none."""
        return "" if place is Tab.REPEATABILITY else self.calibration.choice

    def _show_by_kind(self, result: RunResult) -> None:
        """Show a run's cycles beside its calibration, and first where it has no plateaus: it is a repeatability run."""
        before = self.repeatability.result
        self.repeatability.show(result)
        if before is None or before.path != result.path:  # the same again leaves the tab
            self.services.choose(Tab.REPEATABILITY if lacking(result) is Lack.PLATEAUS else Tab.CALIBRATION)

    def _renamed(self, old: Path, new: Path) -> None:
        """Follow a renamed recording on the pages that show it."""
        for page in (self.calibration, self.repeatability):
            page.follow_rename(old, new)

    def _imported(self, path: Path, noted: Sequence[str]) -> None:
        """List an imported recording, chosen, and offer to calibrate with it."""
        self.runs.select(path)
        self.services.show(Page.RECORDINGS)
        offer = ("Calibrate", partial(self.services.open, path))
        self.notices.add(Severity.INFORMATION, f"Imported as {path.name}", details="\n".join(noted), action=offer)

    def choose_repeatability(self) -> None:
        self.sequence.choose("repeatability")
        self.services.show(Panel.PLAN)

    def save_bug_report(self, path: Path) -> None:
        """Pack log, settings, versions and the recording's summary, without names and notes, in the background."""
        job = Job("Packing the bug report", write_bug_report, path)
        done = f"Saved {path.name}, without names and notes. Check it before sending"
        self.runs.start(f"bug report {path}", job, lambda _: self.notices.inform(done))

    def close(self) -> None:
        """Vent, close the recording and the link, cancel background work."""
        for part in (
            self.run.enough,
            self.run.end_report,
            self.outlets,
            self.windows,
            self.jobs,
            self.unit,
            self.runs,
            self.shadow,
            self.monitor,
            self.session,
            self.camera,
            self.connection,
        ):
            part.close()
