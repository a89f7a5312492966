import numpy as np
from matplotlib.figure import Figure

from boat_daq import Calibration, fit_calibration

calibration: Calibration = fit_calibration(np.arange(6.0), [1549.0, 1603.2, 1652.0, 1695.4, 1731.1, 1757.3], degree=2)
print(calibration.predict([2.5]), calibration.band([2.5], level=0.95))
drawing = Figure()
calibration.plot(drawing.add_subplot())
drawing.savefig("calibration.png")
