"""The calibration, repeatability and runs pages."""
