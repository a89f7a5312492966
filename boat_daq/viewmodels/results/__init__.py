"""View models of the calibration, repeatability and runs pages."""
