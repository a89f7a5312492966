from boat_daq import Inverse, fit_calibration

calibration = fit_calibration([0, 1, 2, 3], [1600.0, 1640.0, 1679.0, 1719.0], degree=1)
print(Inverse.of(calibration).evaluate([1650.0, 1900.0]))  # NaN outside the calibrated range
