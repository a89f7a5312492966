from boat_daq import fit_calibration

x, y, u = [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.0, 9.1], [0.1, 0.1, 0.2, 0.1, 0.1]
print(fit_calibration(x, y, degree=1, standard_uncertainty=u))
