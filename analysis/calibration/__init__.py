"""The calibration: fit, posterior, inverse, checks, comparison of two."""
