"""A calibration as data and as code: what other programs and controllers convert signals with."""
