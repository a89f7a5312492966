"""The types of the names that `boat_daq` imports when they are first used."""

from analysis.calibration.fit import Calibration as Calibration
from analysis.calibration.fit import fit_calibration as fit_calibration
from analysis.calibration.inverse import Fusion as Fusion
from analysis.calibration.inverse import Inverse as Inverse
from analysis.calibration.posterior import Posterior as Posterior
from analysis.calibration.posterior import sample_posterior as sample_posterior
from analysis.calibration_export.run_record import elongation_reader as elongation_reader
from analysis.calibration_export.run_record import load_recording as load_recording
from analysis.data.recording import Recording as Recording
from analysis.figures.figure import Figure as Figure
from analysis.figures.pipeline import Analysis as Analysis
from analysis.figures.pipeline import analyse as analyse
from analysis.figures.sensor_analysis import Options as Options
from analysis.history.batch import batch as batch
from analysis.optics.one_scene import Scene as Scene
from analysis.optics.one_scene import trace as trace
from analysis.reports.build import write_report as write_report
from analysis.segmentation.cycles import find_cycles as find_cycles
from analysis.segmentation.plateaus import PlateauSettings as PlateauSettings
from analysis.segmentation.plateaus import find_plateaus as find_plateaus
from analysis.segmentation.plateaus import plateau_table as plateau_table
from analysis.shadow.model.frames import Shadow as Shadow
from boat_daq.engine.plan import Plan as Plan
from boat_daq.engine.session.measured_blocks import MeasuredBlock as MeasuredBlock
from boat_daq.engine.session.reading_sources import enter_simulated_readings as enter_simulated_readings
from boat_daq.engine.session.session import Session as Session
from protocol.base.errors import BoatDaqError as BoatDaqError

__version__: str
__all__: list[str]
