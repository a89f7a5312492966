import numpy as np

from boat_daq import Recording

time_s = np.arange(0.0, 10.0, 0.01)
run = Recording.from_arrays(time_s, pressure_kpa=10.0 * np.sin(time_s), signal_mv=1600.0 + 40.0 * np.sin(time_s))
print(run.to_frame().head())
